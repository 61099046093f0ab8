"""Write files atomically, lock the folder of a dataset, and hash files."""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from gateway.datasets.errors import DatasetError
from gateway.runtime.file_lock import Lock, try_lock

TEMPORARY_SUFFIX: Final = ".part"
"""Suffix of files that are being written."""


def write_atomically(path: Path, data: bytes | Iterable[bytes]) -> None:
    """Write a file under a temporary name and rename it. Missing folders are created.

    If the process is killed before the rename, the temporary file stays until ``remove_temporary_files``.
    """
    with temporary_name(path) as temporary:
        with temporary.open("wb") as file:
            file.writelines((data,) if isinstance(data, bytes) else data)
        temporary.replace(path)


@contextmanager
def temporary_name(path: Path) -> Iterator[Path]:
    """Yield a temporary path in the folder of ``path``, which is created. Remove the temporary file after an error."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f"{path.name}.{os.getpid()}{TEMPORARY_SUFFIX}")
    try:
        yield temporary
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def remove_temporary_files(folder: Path) -> None:
    """Remove the temporary files of killed processes from a folder."""
    for path in folder.glob(f"*{TEMPORARY_SUFFIX}"):
        path.unlink(missing_ok=True)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold an exclusive lock on a folder, where its file system has locks. Raises DatasetError if another one does."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        if try_lock(descriptor) is Lock.TAKEN:
            raise DatasetError(f"another run works on {folder}")
        yield
    finally:
        os.close(descriptor)
