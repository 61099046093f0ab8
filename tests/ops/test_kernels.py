"""The kernel cache: where it is, when it counts as warm, what becomes of old ones."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway.ops import kernels


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    import numba.core.config as config

    monkeypatch.setenv("SCENEGATE_CACHE_DIR", str(tmp_path))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    before = config.CACHE_DIR
    kernels.folder.cache_clear()
    yield tmp_path
    kernels.folder.cache_clear()
    os.environ.pop("NUMBA_CACHE_DIR", None)
    config.CACHE_DIR = before


def test_the_folder_is_below_the_cache_and_given_to_numba(cache: Path) -> None:
    import numba.core.config as config

    folder = kernels.configure()
    assert folder.parent == cache / "kernels"
    assert folder.is_dir()
    assert os.environ["NUMBA_CACHE_DIR"] == config.CACHE_DIR == str(folder)


def test_a_folder_that_the_user_named_is_used(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(cache / "mine"))
    assert kernels.configure() == cache / "mine"


def test_warm_once_marked(cache: Path) -> None:
    assert not kernels.are_cached()
    kernels.mark_cached()
    assert kernels.are_cached()


def test_warm_for_one_kind_of_cpu(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A home directory may be of several machines, and Numba can be asked to compile for another one."""
    kernels.mark_cached()
    monkeypatch.setenv("NUMBA_CPU_NAME", "nehalem")
    assert not kernels.are_cached()
    kernels.mark_cached()
    assert kernels.are_cached()
    monkeypatch.delenv("NUMBA_CPU_NAME")
    assert kernels.are_cached()
    monkeypatch.setattr("llvmlite.binding.get_host_cpu_name", lambda: "haswell")
    assert not kernels.are_cached()


def test_the_oldest_folders_go(cache: Path) -> None:
    kernels.configure()
    for age in range(7):
        old = cache / "kernels" / f"old{age}"
        old.mkdir()
        os.utime(old, (1e9 - age, 1e9 - age))
    kernels.mark_cached()
    assert sorted(path.name for path in (cache / "kernels").glob("old*")) == ["old0", "old1", "old2", "old3"]
    assert kernels.are_cached()


def test_where_nothing_can_be_written_a_private_folder_serves(cache: Path) -> None:
    blocked = cache / "kernels"
    blocked.write_text("a file where a folder should be")
    folder = kernels.configure()
    assert folder.is_dir()
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


async def test_a_child_that_fails_is_a_sentence(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONHOME", str(cache))  # no interpreter starts with that
    with pytest.raises(kernels.KernelError, match=r"^the rendering kernels could not be compiled: "):
        await kernels.compile_in_children(["shading"])
    assert not kernels.are_cached()
