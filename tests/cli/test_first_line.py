"""The first line of ``scenegate serve``: at once, in the format of the log."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from gateway import __version__
from gateway.cli import first_line

EVENT = f"Scenegate {__version__} starts: loading its libraries"


@pytest.fixture(autouse=True)
def _no_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("SCENEGATE_CONFIG", "SCENEGATE_LOG_FORMAT", "SCENEGATE_LOG_LEVEL"):
        monkeypatch.delenv(name, raising=False)


def written(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    first_line.write(arguments)
    return capsys.readouterr().err


def test_in_a_pipe_it_is_json(capsys: pytest.CaptureFixture[str]) -> None:
    entry = json.loads(written(capsys, "serve", "--demo"))
    assert (entry["event"], entry["level"], entry["logger"]) == (EVENT, "info", "gateway")


def test_on_a_terminal_it_is_text(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert written(capsys, "serve").endswith(f"[info     ] {EVENT} ...\n")
    json.loads(written(capsys, "serve", "--log-format", "json"))


@pytest.mark.parametrize("source", ["flag", "flag=", "environment", "file", "file in the environment"])
def test_the_format_is_a_setting(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, source: str
) -> None:
    config = tmp_path / "scenegate.toml"
    config.write_text("log-format = 'human'")
    arguments = {
        "flag": ["--log-format", "human"],
        "flag=": ["--log-format=human"],
        "file": ["--config", str(config)],
    }.get(source, [])
    if source == "environment":
        monkeypatch.setenv("SCENEGATE_LOG_FORMAT", "human")
    if source == "file in the environment":
        monkeypatch.setenv("SCENEGATE_CONFIG", str(config))
    assert EVENT in written(capsys, "serve", *arguments)
    assert not written(capsys, "serve", *arguments).startswith("{")


@pytest.mark.parametrize(
    "arguments", [(), ("render",), ("serve", "--help"), ("serve", "--help-all"), ("serve", "--log-level", "warning")]
)
def test_it_is_only_for_servers_that_log_it(capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...]) -> None:
    assert written(capsys, *arguments) == ""


@pytest.mark.parametrize("content", ["not = [toml", None])
def test_a_file_that_cannot_be_read_is_reported_later(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, content: str | None
) -> None:
    config = tmp_path / "scenegate.toml"
    if content is not None:
        config.write_text(content)
    json.loads(written(capsys, "serve", "--config", str(config), "--port"))


SIGTERM_IN_A_LINE = """
import io, signal, sys

signals = [signal.SIGTERM]

class Raw(io.FileIO):
    def write(self, data):
        if signals:
            signal.raise_signal(signals.pop())
        return super().write(data)

sys.stderr = io.TextIOWrapper(io.BufferedWriter(Raw(2, "w", closefd=False)), line_buffering=True)
from scenegate.cli import main
main(["serve"])
"""


def test_sigterm_while_a_line_is_written_is_logged() -> None:
    ran = subprocess.run([sys.executable, "-c", SIGTERM_IN_A_LINE], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    assert json.loads(ran.stderr.splitlines()[0])["event"] == first_line.STOPPED


def test_it_comes_before_the_libraries_are_imported() -> None:
    script = "import sys, scenegate.cli; print(*sys.modules)"
    command = [sys.executable, "-c", script]
    loaded = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    packages = {name.partition(".")[0] for name in loaded} - set(sys.stdlib_module_names)
    assert {"numpy", "pydantic", "typer", "rich", "structlog", "numba", "cv2", "fastapi", "grpc"} & packages == set()
