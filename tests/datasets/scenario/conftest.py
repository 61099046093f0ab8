"""Scenarios with the models of the examples."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

MODELS = Path(__file__).parents[3] / "examples" / "scenario"
TABLE = """
seed = 5
scenes = 9
surfaces = [{kind = "table", size = [0.9, 0.7], height = 0.6, area = [0.6, 0.5]}]
models = [{path = "models/[!a]*.urdf", count = [4, 6]}]
cameras = [{kind = "shell", count = 2}]
"""

Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """A function that writes a scenario beside the models of the examples, and returns its path."""
    shutil.copytree(MODELS, tmp_path / "files")

    def write_scenario(text: str = TABLE, name: str = "desk") -> Path:
        path = tmp_path / "files" / f"{name}.toml"
        path.write_text(text)
        return path

    return write_scenario
