"""A folder that is open to clients, and files beside it that are not."""

from pathlib import Path

import pytest

from gateway.files.assets.mesh_files import MeshFiles
from tests.files.assets.mesh_files.files import TRIANGLE, write


@pytest.fixture
def root(tmp_path: Path) -> Path:
    folder = tmp_path / "open"
    folder.mkdir()
    write(tmp_path / "secret.obj", TRIANGLE)
    write(tmp_path / "open-sesame" / "near.obj", TRIANGLE)
    return folder


@pytest.fixture
def files(root: Path) -> MeshFiles:
    return MeshFiles([root])
