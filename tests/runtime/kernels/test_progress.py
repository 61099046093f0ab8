"""Progress of kernel compilation as JSON and as lines."""

import io
import sys
from typing import Any

import pytest

from gateway.runtime.kernels.progress import KernelProgress, show_progress, write_progress


def test_progress_counts_functions() -> None:
    progress = KernelProgress({"shading": 30, "setup": 10})
    assert progress.fraction == 0.0
    for _ in range(40):  # more than expected
        progress.add("setup", complete=False)
    assert progress.fraction == 0.25
    described = progress.describe()["compiling"]
    assert described.pop("seconds") >= 0.0
    assert described == {"percent": 25}
    progress.add("shading", complete=True)
    assert progress.fraction == 1.0
    progress.set_waiting(True)
    assert progress.describe()["waiting"] == "another process compiles the kernels"


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
