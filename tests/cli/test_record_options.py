"""``scenegate record``: options of the other kind of file are refused."""

import argparse

import pytest

from scenegate.cli import record


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
