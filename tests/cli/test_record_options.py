"""``scenegate record``: options of the other kind of file, and sources that cannot be recorded, are refused."""

import argparse
from pathlib import Path

import pytest

from scenegate.camera import stream
from scenegate.cli import record
from scenegate.recording import sources
from tests.support.command import scenegate


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["a.lcmlog", "--camera", "robot", "--max-mb", "5"], "--camera, --max-mb needs an MCAP file: --mcap OUT.mcap"),
        (["--mcap", "a.mcap", "--max-mb", "0.0000001"], "--max-mb is 1e-07; it must be 0, or at least 1: messages"),
        (["--mcap", "."], "--mcap: '.' is a folder, not a file"),
        (["--mcap", "a.mcap", "--lcm-url", "udpm://"], "--lcm-url needs an LCM log: OUT.lcmlog"),
    ],
)
def test_options_of_the_other_file(arguments: list[str], sentence: str) -> None:
    parser = argparse.ArgumentParser()
    record.add_arguments(parser)
    with pytest.raises(argparse.ArgumentTypeError, match=sentence):
        record.run(parser.parse_args(arguments))


def test_what_cannot_be_recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module, name in ((sources, "WAIT_SECONDS"), (sources, "RETRY_SECONDS"), (stream, "CONNECT_SECONDS")):
        monkeypatch.setattr(module, name, 0.1)
    out = tmp_path / "a.mcap"
    out.write_text("an earlier recording")
    for options, sentence in (
        (("--no-scene",), "nothing is recorded: --no-scene needs --camera"),
        (("--keep", "2"), "--keep needs --max-mb"),
        (("--gateway", "ftp://x"), "the address of the gateway is 'ftp://x'; it must be like http://HOST:PORT"),
        (("--gateway", "http://127.0.0.1:1"), "http://127.0.0.1:1 gives no scene: "),
        (("--channels", "A"), "--channels needs an LCM log: OUT.lcmlog"),
        (
            ("--gateway", "http://x:1", "--tls"),
            "http://x:1: --tls, --ca and --certificate need an address with https://",
        ),
        (("--no-scene", "--camera", "127.0.0.1:9", "--seconds", "0.3"), "no answer from 127.0.0.1:9"),
        (("a.lcmlog",), "one of OUT.lcmlog and --mcap OUT.mcap is needed, not both"),
    ):
        result = scenegate("record", "--mcap", str(out), *options)
        assert result.exit_code, options
        assert sentence in result.stderr
        assert out.read_text() == "an earlier recording"
