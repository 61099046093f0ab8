"""Writing a dataset so that nobody ever sees half a file, and hashing what is there."""

from __future__ import annotations

import fcntl
import hashlib
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

PART: Final = ".part"
"""End of the names of files that are being written."""
_BLOCK: Final = 1 << 20


def write_whole(path: Path, data: bytes | Iterable[bytes]) -> None:
    """Writes a file, whole or in pieces, under another name of the same folder and renames it; folders are made.

    A process that is killed meanwhile leaves a ``.part`` file, which the end of the next run removes.
    """
    with part_of(path) as part:
        with part.open("wb") as file:
            file.writelines((data,) if isinstance(data, bytes) else data)
        part.replace(path)


@contextmanager
def part_of(path: Path) -> Iterator[Path]:
    """The name under which a file is written; what still has it after an error is removed. Folders are made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.{os.getpid()}{PART}")
    try:
        yield part
    except BaseException:
        part.unlink(missing_ok=True)
        raise


class InUseError(ValueError):
    """Another process works on the folder; a sentence."""


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Keeps other runs off a folder; the lock ends with this process, whatever ends it.

    Raises:
        InUseError: there is another run.
    """
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InUseError(f"another run works on {folder}") from None
        except OSError:  # NFS locks no folders: there, people have to take care themselves
            pass
        yield
    finally:
        os.close(descriptor)


def remove_parts(folder: Path) -> None:
    """Removes what killed processes left in a folder."""
    for path in folder.glob(f"*{PART}"):
        path.unlink(missing_ok=True)


def sha256_of(path: Path) -> str | None:
    """64 hexadecimal digits; None when the file is missing or not readable."""
    digest = hashlib.sha256()
    try:
        with path.open("rb") as file:
            while block := file.read(_BLOCK):
                digest.update(block)
    except OSError:
        return None
    return digest.hexdigest()
