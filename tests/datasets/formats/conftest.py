"""The analytic dataset, and its copies in all formats."""

from pathlib import Path

import pytest

from scenegate.datasets import Dataset
from tests.datasets.analytic import write_dataset


@pytest.fixture(scope="session")
def analytic(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return Dataset(write_dataset(tmp_path_factory.mktemp("analytic") / "out"))


@pytest.fixture
def dest(tmp_path: Path) -> Path:
    return tmp_path / "dest"


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    """A dataset of this test, beside ``dest``."""
    return write_dataset(tmp_path / "out")
