"""Progress of kernel compilation as JSON, as lines and on a terminal."""

import io
import logging
import sys
from typing import Any

import pytest

from gateway.runtime.kernels.progress import KernelProgress, show_progress, write_progress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_progress_counts_functions() -> None:
    progress = KernelProgress({"shading": 30, "setup": 10})
    assert (progress.fraction, progress.seconds_left) == (0.0, None)
    for _ in range(40):  # more than expected
        progress.add("setup", complete=False)
    assert progress.fraction == 0.25
    described = progress.describe()["compiling"]
    assert described.pop("seconds") >= 0.0
    assert described == {"percent": 25, "seconds_left": 1}
    progress.add("shading", complete=True)
    assert progress.fraction == 1.0
    progress.set_waiting(True)
    assert progress.describe()["waiting"] == "another process compiles the kernels"


def test_the_remaining_time_follows_from_the_time_since_the_first_function(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr("gateway.runtime.kernels.progress.time.monotonic", lambda: now)
    progress = KernelProgress({"shading": 4})
    now = 110.0
    progress.add("shading", complete=False)
    now = 112.0
    assert progress.seconds_left == 6
    assert str(progress) == "compiling the rendering kernels, once: 25 %, about 6 s left"


def test_a_line_for_each_fifth_without_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    lines: list[tuple[str, dict[str, Any]]] = []
    progress = KernelProgress({"shading": 10})
    with show_progress(progress, lambda event, **fields: lines.append((event, fields))):
        progress.set_waiting(True)
        progress.set_waiting(False)
        for _ in range(5):
            progress.add("shading", complete=False)
        progress.add("shading", complete=True)
    assert [event for event, _ in lines] == [
        "Waiting for another process that compiles the rendering kernels",
        *["Compiling the rendering kernels"] * 3,
    ]
    assert [fields["percent"] for _, fields in lines[1:]] == [20, 40, 100]


def test_commands_write_lines_to_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    progress = KernelProgress({"shading": 2})
    with show_progress(progress, write_progress):
        progress.add("shading", complete=False)
    assert capsys.readouterr().err.startswith("Compiling the rendering kernels, 40 %, ")


@pytest.mark.parametrize("columns", [120, 40])
def test_a_bar_in_a_terminal_with_log_lines_above_it(monkeypatch: pytest.MonkeyPatch, columns: int) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setattr("scenegate.cli.progress_bar._UPDATE_SECONDS", 0.0)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", str(columns))
    handler = logging.StreamHandler(terminal)
    root = logging.getLogger()
    monkeypatch.setattr(root, "handlers", [handler])
    progress = KernelProgress({"shading": 1, "setup": 3})
    with show_progress(progress, lambda event, **fields: pytest.fail("a line beside the bar")):
        progress.add("shading", complete=True)
        logging.getLogger("gateway").warning("something else")
        progress.add("setup", complete=False)
    assert not handler.filters
    before, after = terminal.getvalue().split("\r\x1b[Ksomething else\n")
    assert before.startswith("\r\x1b[KCompiling the rendering kernels, ")
    assert after.startswith("\r\x1b[KCompiling the rendering kernels, ")
    assert after.endswith("\r\x1b[K")
    if columns == 120:
        assert "25 %" in before
        assert "50 %" in after
