"""The lessons, done as a reader does them: every block in order, in one folder, against a running gateway."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.pages import PAGES, ROOT, Block, blocks, commands
from tests.docs.test_code import addresses, placed
from tests.support.waiting import SECONDS

__all__ = ["addresses"]  # a fixture

LESSONS = [page for page in PAGES if page.parent.name == "tutorial"]


@pytest.mark.slow
@pytest.mark.parametrize("page", LESSONS, ids=lambda page: page.stem)
def test_lesson(page: Path, addresses: dict[str, str], tmp_path: Path) -> None:
    for block in blocks(page):
        for command in commands_of(block, tmp_path, addresses):
            done = subprocess.run(
                ["bash", "-c", command], cwd=tmp_path, capture_output=True, text=True, timeout=SECONDS, check=False
            )
            assert done.returncode == 0, f"{block}: {command}\n{done.stdout[-1000:]}{done.stderr[-3000:]}"


def commands_of(block: Block, folder: Path, addresses: dict[str, str]) -> list[str]:
    """Return the commands of a block; Python is written to the file that its first line names."""
    if block.language == "python":
        script = folder / "block.py"
        script.write_text(placed(block.code, addresses))
        return [f"{sys.executable} {script}"]
    if block.language != "sh":  # starting the server, which runs already
        return []
    scenegate = f"{sys.executable} -m scenegate "
    return [
        example(line)
        if line.startswith("python examples/")
        else placed(line, addresses)
        if line.startswith("curl ")
        else placed(line, addresses).replace("scenegate ", scenegate, 1)
        for line in commands(block)
    ]


def example(line: str) -> str:
    """Return the command that trains with PyTorch, but for a few steps only."""
    python = os.environ.get("SCENEGATE_TORCH_PYTHON", "")
    if not python:
        pytest.skip("SCENEGATE_TORCH_PYTHON names no interpreter with torch: all but the training was run")
    return f"OMP_NUM_THREADS=1 {python} {ROOT}/{line.removeprefix('python ')} 10"


def test_there_are_lessons() -> None:
    assert len(LESSONS) >= 4
    assert all(any(block.language == "sh" for block in blocks(page)) for page in LESSONS)
