"""Numba keeps our kernels where ``renderers.compiler.cache_folder`` says, and other libraries' functions as before.

Fails when Numba changes what ``renderers.compiler.cache_locator`` uses of it.
"""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from numba.core import config as numba_config

import renderers.raster
import renderers.stereo.depth.residual_shift  # noqa: F401 - they define kernels
from renderers.compiler import cache_folder as kernel_cache
from renderers.compiler.cache_locator import CACHED_KERNELS, cached_njit, folder_of

ROOT = Path(__file__).parents[3]
config: Any = numba_config
"""Numba sets its attributes at run time, so that type checkers cannot find them."""


def test_every_kernel_has_a_folder_of_its_own_in_the_cache() -> None:
    # Other tests' modules may have kernels of their own, which Numba's own locators take.
    ours = [kernel for kernel in CACHED_KERNELS if not kernel.py_func.__module__.startswith("tests.")]
    folders = [folder_of(kernel) for kernel in ours]
    assert {folder.parent for folder in folders} == {kernel_cache.folder()}
    assert len(set(folders)) == len(folders)


def test_no_kernel_is_cached_by_path() -> None:
    """``njit(cache=True)`` names its folder by the source's path."""
    by_path = [
        path.relative_to(ROOT).as_posix()
        for package in kernel_cache.PACKAGES
        for path in (ROOT / package).rglob("*.py")
        if "cache=True" in path.read_text() and path.name != "cache_locator.py"
    ]
    assert by_path == []


def test_functions_of_other_packages_keep_numbas_cache_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    before = config.CACHE_LOCATOR_CLASSES
    other: Any = cached_njit()(_other)
    assert folder_of(other).parent == tmp_path
    assert before == config.CACHE_LOCATOR_CLASSES == ""
    CACHED_KERNELS.remove(other)


def _other(x: int) -> int:
    return x + 1


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
def test_a_damaged_file_is_a_miss(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str) -> None:
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    for damage in (lambda data: bytes(len(data)), lambda data: data[: len(data) // 2]):
        function: Any = cached_njit()(_other)
        assert function(1) == 2
        files = sorted(folder_of(function).glob(f"*.{suffix}"))
        assert len(files) == 1, files
        file = files[0]
        file.write_bytes(damage(file.read_bytes()))
        again: Any = cached_njit()(_other)
        assert again(1) == 2
        assert sum(again.stats.cache_misses.values()) == 1
        loaded: Any = cached_njit()(_other)
        assert loaded(1) == 2
        assert sum(loaded.stats.cache_hits.values()) == 1
        del CACHED_KERNELS[-3:]


PROGRAM = """
import sys
sys.path.insert(0, {tree!r})
import renderers.twice
from renderers.compiler import cache_folder as kernel_cache
from renderers.twice import twice
assert renderers.twice.__file__.startswith({tree!r}), renderers.twice.__file__
assert twice(2) == 4
{note}
print(sum(twice.stats.cache_hits.values()), sum(twice.stats.cache_misses.values()))
"""
TWICE = """
from numba import njit
from renderers.compiler.cache_locator import cached_njit

@cached_njit(nogil=True)
def twice(x):
    return x * 2
"""


def tree(folder: Path) -> Path:
    """Copy the cache modules and add a kernel."""
    package = folder / "renderers"
    (package / "compiler").mkdir(parents=True)
    for name in ("__init__.py", "compiler/__init__.py", "compiler/cache_folder.py", "compiler/cache_locator.py"):
        (package / name).write_bytes((ROOT / "renderers" / name).read_bytes())
    (package / "twice.py").write_text(TWICE)
    return folder


def run(folder: Path, cache: Path, note: str = "") -> str:
    """Call the kernel of a tree in a new process, run ``note``, and return hits and misses of Numba's cache."""
    environment = {"NUMBA_CACHE_DIR": str(cache), "PYTHONDONTWRITEBYTECODE": "1"}
    program = PROGRAM.format(tree=str(folder), note=note)
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.slow
def test_another_specialization_keeps_the_cache_complete(tmp_path: Path) -> None:
    """Numba adds it to the same index."""
    cache = tmp_path / "cache"
    place = tree(tmp_path / "first")
    assert run(place, cache, note='kernel_cache.write_manifest({"all": ["renderers.twice.twice"]})') == "0 1"
    assert run(place, cache, note="twice(2.5); assert kernel_cache.missing() == '', kernel_cache.missing()") == "1 1"
