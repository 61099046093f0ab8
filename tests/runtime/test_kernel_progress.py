"""Progress of kernel compilation as JSON, as lines and on a terminal."""

from __future__ import annotations

import io
import logging
import sys
from typing import Any

import pytest

from gateway.runtime.kernel_progress import Progress, on_stderr, shown


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_progress_has_part_count_and_seconds() -> None:
    progress = Progress(3)
    progress.begin("shading")
    progress.begin("setup")
    progress.end("shading")
    described = progress.describe()["compiling"]
    assert described.pop("seconds") >= 0.0
    assert described == {"part": 2, "of": 3, "done": 1, "now": ["setup"]}
    progress.set_waiting(True)
    assert progress.describe()["waiting"] == "another process compiles the kernels"


def test_one_line_per_part_without_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    lines: list[tuple[str, dict[str, Any]]] = []
    progress = Progress(2)
    with shown(progress, lambda event, **fields: lines.append((event, fields))):
        progress.set_waiting(True)
        progress.set_waiting(False)
        progress.begin("shading")
        progress.end("shading")
        progress.begin("rest")
        progress.end("rest")
    assert [event for event, _ in lines] == [
        "Waiting for another process that compiles the rendering kernels",
        *["Compiling the rendering kernels"] * 2,
    ]
    assert [(fields["part"], fields["of"], fields["name"]) for _, fields in lines[1:]] == [
        (1, 2, "shading"),
        (2, 2, "rest"),
    ]


def test_commands_write_lines_to_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    progress = Progress(2)
    with on_stderr(progress):
        progress.begin("shading")
    assert capsys.readouterr().err.startswith("Compiling the rendering kernels, part 1 of 2 (shading), ")


def test_a_bar_in_a_terminal_with_log_lines_above_it(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "120")
    handler = logging.StreamHandler(terminal)
    root = logging.getLogger()
    monkeypatch.setattr(root, "handlers", [handler])
    progress = Progress(7)
    with shown(progress, lambda event, **fields: pytest.fail("a line beside the bar")):
        progress.begin("shading")
        progress.end("shading")
        progress.begin("setup")
        logging.getLogger("gateway").warning("something else")
        assert handler.stream is not terminal
    assert handler.stream is terminal
    written = terminal.getvalue()
    assert "1/7" in written
    assert "setup" in written
    assert "something else\n" in written
