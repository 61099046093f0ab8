"""The kernel cache on disk: its folder and its manifest.

The folder's name has a digest of everything that the machine code depends on: the contents of the sources, the CPU, and
the versions of Python, Numba, llvmlite and NumPy. Paths and times of files do not count, so that all clones, virtual
environments and container layers of one version share their kernels:

    <root>/scenegate-<sources>-<platform>/complete.json
    <root>/scenegate-<sources>-<platform>/renderers.fxaa.smooth_rows/fxaa.smooth_rows-110.py311.nbi, .1.nbc

This module does not import Numba; ``renderers.compiler.cache_locator`` tells Numba about the folders.
"""

import atexit
import hashlib
import io
import json
import os
import pickletools
import re
import shutil
import sys
import tempfile
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Final

CACHE_ENV: Final = "SCENEGATE_CACHE_DIR"
PACKAGES: Final = ("renderers", "gateway")
"""Packages that define kernels."""
_MANIFEST: Final = "complete.json"
_PREFIX: Final = "scenegate-"
_PRIVATE_PREFIX: Final = "scenegate-kernels-"
_MAX_OTHER_FOLDERS: Final = 4
"""Number of folders of other versions that are kept, the newest ones; each has about 8 MB."""
_NEEDED_BYTES: Final = 16 << 20
"""Free space in the folder without which nothing is compiled. The kernels have 5 MB."""
_DEFINES_KERNELS: Final = re.compile(rb"^from renderers\.compiler\.(jit|device_function) import ", re.MULTILINE)
_GATEWAY_IMPORT: Final = re.compile(rb"^from (gateway[\w.]*) import ", re.MULTILINE)


@cache
def root() -> Path:
    """Return the folder that holds the folders of all versions.

    It is NUMBA_CACHE_DIR if that is set, and else below the user's cache folder; or, if the latter cannot be written
    and has no complete kernels of this version, a private temporary folder, if there is a place for one.
    """
    if given := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(given)
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111 - unchanged without a home
    path = Path(os.environ.get(CACHE_ENV) or Path(caches, "scenegate")) / "kernels"
    if not unusable(path) or not missing(path / folder_name()):
        return path
    try:  # not a name that others can guess: Numba executes the files that it finds there
        private = Path(tempfile.mkdtemp(prefix=_PRIVATE_PREFIX))
    except OSError:
        return path
    atexit.register(remove_private_root)
    return private


def is_private_root() -> bool:
    """Return True if ``root`` is a private temporary folder, which this process removes at its end."""
    return root().name.startswith(_PRIVATE_PREFIX)


def remove_private_root() -> None:
    """Remove the private temporary folder, if ``root`` has made one."""
    if is_private_root():
        shutil.rmtree(root(), ignore_errors=True)


def unusable(path: Path) -> str:
    """Create the folder if it does not exist. Return why kernels cannot be compiled into it, as a clause, or ""."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        total, _, free = shutil.disk_usage(path)
    except OSError:
        return "which cannot be written"
    if not os.access(path, os.W_OK | os.X_OK):
        return "which cannot be written"
    is_full = total and free < _NEEDED_BYTES  # some file systems of networks have no sizes
    return f"which has {free >> 20} MB free of the {_NEEDED_BYTES >> 20} MB that are needed" if is_full else ""


def folder() -> Path:
    """Return the folder of this version's kernels for this machine's CPU; it may not exist yet."""
    return root() / folder_name()


def folder_name() -> str:
    """Return the name of the folder: digests of the sources and of the platform."""
    return f"{_PREFIX}{sources_digest()}-{platform_digest()}"


@cache
def sources_digest() -> str:
    """Return the digest of the sources that kernels are made of, by contents and relative path.

    These are all of ``renderers``, the modules of ``gateway`` that define kernels, and the modules of ``gateway`` that
    those import constants from.
    """
    digest = hashlib.sha256()
    for package in PACKAGES:
        spec = find_spec(package)
        if spec is None or not spec.submodule_search_locations:
            continue
        top = Path(spec.submodule_search_locations[0])
        sources = {path.relative_to(top).as_posix(): path.read_bytes() for path in sorted(top.rglob("*.py"))}
        for name in sources if package == "renderers" else _with_kernels(sources):
            digest.update(f"{package}/{name}\0{len(sources[name])}\0".encode() + sources[name])
    return digest.hexdigest()[:16]


def _with_kernels(sources: Mapping[str, bytes]) -> list[str]:
    """Return the names of the modules of ``gateway`` that define kernels, and of those they import, sorted."""
    reached: set[str] = set()
    pending = [name for name, source in sources.items() if _DEFINES_KERNELS.search(source)]
    while pending:
        name = pending.pop()
        if name in reached:
            continue
        reached.add(name)
        for module in _GATEWAY_IMPORT.findall(sources[name]):
            imported = module.decode().partition(".")[2].replace(".", "/")
            pending += [each for each in (f"{imported}.py", f"{imported}/__init__.py") if each in sources]
    return sorted(reached)


def platform_digest() -> str:
    """Return the digest of the CPU that kernels are compiled for and of the compiler's versions.

    With Numba's settings NUMBA_CPU_NAME and NUMBA_CPU_FEATURES it is that CPU, and not this machine's.
    """
    return _platform_digest(*(os.environ.get(f"NUMBA_{name}") for name in ("CPU_NAME", "CPU_FEATURES", "ENABLE_AVX")))


@cache  # called for every kernel; reading the versions opens files
def _platform_digest(cpu: str | None, features: str | None, avx: str | None) -> str:
    from llvmlite.binding import get_host_cpu_features, get_host_cpu_name

    cpu = get_host_cpu_name() if cpu is None else cpu
    features = get_host_cpu_features().flatten() if features is None else features
    key = (cpu, features, avx or "", *(version(name) for name in ("numba", "llvmlite", "numpy")), sys.version)
    return hashlib.sha256("\0".join(key).encode()).hexdigest()[:16]


def missing(path: Path | None = None, parts: Iterable[str] | None = None) -> str:
    """Compare a version's folder, by default ``folder()``, with its manifest.

    Args:
        parts: parts that must be complete; None: all that the manifest lists.

    Returns:
        "" if no file of these parts is missing or changed; otherwise the reason, as the rest of a sentence.
    """
    path = folder() if path is None else path
    try:
        listed = _read_manifest(path)
    except OSError:
        return "not compiled yet"
    except ValueError:
        return f"{_MANIFEST} cannot be read"
    names = listed if parts is None else tuple(parts)
    files = {name: digest for part in names for name, digest in listed.get(part, {}).items()}
    if uncompiled := [part for part in names if part not in listed]:
        return f"not compiled yet: {', '.join(uncompiled)}"
    changed = sorted(name for name in files if not _is_intact(path, name, files))
    return f"{len(changed)} of {len(files)} files are missing or changed, the first is {changed[0]}" if changed else ""


def _is_intact(path: Path, name: str, files: Mapping[str, str]) -> bool:
    """Return whether a file has the digest that the manifest lists.

    The index of a kernel (``.nbi``, two pickles) may differ, as another program may have added a specialisation to it.
    It must then be readable and contain the digest of the sources and the names of the kernel's other files.
    """
    try:
        data = (path / name).read_bytes()
    except OSError:
        return False
    if hashlib.sha256(data).hexdigest() == files[name]:
        return True
    kernel_folder, _, file = name.rpartition("/")
    parts = [each.rpartition("/") for each in files]
    other_files = [other for other_folder, _, other in parts if other_folder == kernel_folder and other != file]
    expected = [sources_digest(), *other_files]
    return file.endswith(".nbi") and _has_two_pickles(data) and all(each.encode() in data for each in expected)


def _has_two_pickles(data: bytes) -> bool:
    """Return whether a file has two pickles and nothing else, without running them."""
    file = io.BytesIO(data)
    try:
        for _ in range(2):
            for _ in pickletools.genops(file):
                pass
    except (ValueError, UnicodeDecodeError):
        return False
    return not file.read()


def remove_damaged() -> list[str]:
    """Delete the files of each kernel of which one is missing or changed; return the kernels' names.

    Numba raises an error for an index that it cannot read; one that is missing is compiled again.
    """
    own = folder()
    try:
        listed = _read_manifest(own)
    except (OSError, ValueError):  # there is no manifest, so that all is compiled
        return []
    changed = {
        name.rpartition("/")[0] for files in listed.values() for name in files if not _is_intact(own, name, files)
    }
    for kernel in changed:
        for file in (own / kernel).glob("*.nb[ic]"):
            file.unlink(missing_ok=True)
    return sorted(changed)


def count() -> int:
    """Return the number of kernels that the manifest lists."""
    return sum(name.endswith(".nbi") for files in _read_manifest(folder()).values() for name in files)


def _read_manifest(path: Path) -> dict[str, dict[str, str]]:
    """Return the digests of a version's files by part and name. Raises OSError, or ValueError for another content."""
    try:
        listed: dict[str, dict[str, str]] = json.loads((path / _MANIFEST).read_bytes())
    except RecursionError as error:
        raise ValueError(str(error)) from None
    if not isinstance(listed, dict) or not all(isinstance(files, dict) for files in listed.values()):
        raise ValueError(f"{_MANIFEST} is not a list of parts")
    return listed


def write_manifest(parts: Mapping[str, Iterable[str]]) -> None:
    """Add compiled parts to the manifest, and remove the oldest folders of other versions.

    The kernels' files are on the disk before the manifest names them. ``parts`` has the folders of a part's kernels
    relative to ``folder()``.
    """
    own = folder()
    try:
        listed = _read_manifest(own)
    except (OSError, ValueError):
        listed = {}
    listed |= {
        part: {
            file.relative_to(own).as_posix(): hashlib.sha256(_flushed(file)).hexdigest()
            for kernel in sorted(kernels)
            for file in sorted((own / kernel).glob("*.nb[ic]"))
        }
        for part, kernels in parts.items()
    }
    with tempfile.NamedTemporaryFile("w", dir=own, prefix=_MANIFEST, delete=False) as file:
        json.dump(listed, file, indent=1)
        file.flush()
        os.fsync(file.fileno())
    Path(file.name).chmod(0o644)
    Path(file.name).replace(own / _MANIFEST)
    others = [path for path in own.parent.glob(f"{_PREFIX}*") if path != own and path.is_dir()]
    for other in sorted(others, key=lambda path: path.stat().st_mtime)[:-_MAX_OTHER_FOLDERS]:
        shutil.rmtree(other, ignore_errors=True)


def _flushed(path: Path) -> bytes:
    """Flush a file to the disk, and return its contents."""
    with path.open("rb") as file:
        os.fsync(file.fileno())
        return file.read()


def remove_manifest() -> None:
    """Remove the manifest, so that the kernels count as not compiled."""
    (folder() / _MANIFEST).unlink(missing_ok=True)
