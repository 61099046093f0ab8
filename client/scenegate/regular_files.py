"""Reads files by path, and only regular ones: a named pipe or a device could block, or never end.

A path on the command line may be a pipe: ``read_file_or_pipe``. ``write_whole`` writes a file.
"""

import errno
import hashlib
import io
import os
import select
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, Final

MAX_BYTES: Final = 1 << 30
"""Maximum size of a file that is read into memory, where the caller has no lower limit."""
_PIECE_BYTES: Final = 1 << 20
"""Bytes that are read between two calls of ``check``."""
_LFS_POINTER: Final = b"version https://git-lfs.github.com/spec/"
"""Start of the file that a clone has in place of a large one, if Git LFS is not installed."""
_POLL_MILLISECONDS: Final = 50
"""Time between two calls of ``check`` while a pipe has no data."""


def write_whole(path: Path, data: bytes | memoryview) -> None:
    """Write a file. If it cannot be written to its end, as on a full disk, remove it, and name it in the error."""
    try:
        path.write_bytes(data)
    except OSError as error:
        if error.filename is None:  # it could be opened
            error.filename = os.fspath(path)
            if path.is_file():  # not a device
                path.resolve().unlink()  # not a link to it, such as /dev/stdout
        raise


def open_regular(path: str | os.PathLike[str], *, follow_links: bool = True) -> BinaryIO:
    """Open a regular file for reading. Raises OSError if it cannot be opened, or is not a regular file.

    ``follow_links`` False: a symbolic link as the last element of the path is an error.
    """
    # Without O_NONBLOCK, opening a named pipe would block for ever.
    descriptor = _open(path, follow_links)
    try:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise OSError(errno.EINVAL, "it is not a regular file", os.fspath(path))
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def read_regular(path: str | os.PathLike[str], max_bytes: int = MAX_BYTES, *, follow_links: bool = True) -> bytes:
    """Return the bytes of a file. Raises OSError if it is not regular, too large, or a pointer of Git LFS."""
    with open_regular(path, follow_links=follow_links) as file:
        if os.fstat(file.fileno()).st_size > max_bytes:
            raise _too_large(path, max_bytes)
        pieces: list[bytes] = []
        remaining = max_bytes + 1
        while remaining and (piece := file.read(min(remaining, _PIECE_BYTES))):
            pieces.append(piece)
            remaining -= len(piece)
        if not remaining:  # it has grown, or its file system reports no size
            raise _too_large(path, max_bytes)
    if pieces and pieces[0].startswith(_LFS_POINTER):
        raise OSError(errno.ENODATA, "it is a pointer of Git LFS, not the file: run git lfs pull", os.fspath(path))
    return b"".join(pieces)


def read_text(path: str | os.PathLike[str], max_bytes: int = MAX_BYTES) -> str:
    """Return the text of a regular file in UTF-8; raises as ``read_regular`` does, and UnicodeDecodeError."""
    return read_regular(path, max_bytes).decode("utf-8")


def standard_input() -> Path:
    """Return a path of the standard input: that of its file, if it is one and no pipe."""
    file = Path(os.path.realpath("/dev/stdin"))
    return file if file.is_file() else Path("/dev/stdin")


def is_pipe(path: Path) -> bool:
    """Return True for a named pipe, a shell's ``<(command)``, or the standard input of a pipeline."""
    return path.exists() and not path.is_file() and not path.is_dir()


def read_file_or_pipe(
    path: str | os.PathLike[str], max_bytes: int = MAX_BYTES, check: Callable[[], object] = lambda: None
) -> bytes:
    """Return the bytes of a file from the command line, also a pipe: ``<(xacro …)``. Raises as ``read_regular``.

    ``check`` is called again and again while it reads; it may raise an exception to cancel it.
    """
    descriptor = _open(path, follow_links=True)
    if stat.S_ISDIR(os.fstat(descriptor).st_mode):  # FileIO would leave it open, and name it by its number
        os.close(descriptor)
        raise IsADirectoryError(errno.EISDIR, "it is a folder", os.fspath(path))
    with io.FileIO(descriptor, "rb") as file:
        poller = select.poll()
        poller.register(file, select.POLLIN)
        data = bytearray()
        while True:
            check()
            if not poller.poll(_POLL_MILLISECONDS):
                continue
            piece = file.read(_PIECE_BYTES)
            if piece is None:  # another reader was quicker
                continue
            if not piece:
                return bytes(data)
            data += piece
            if len(data) > max_bytes:
                raise _too_large(path, max_bytes)


@contextmanager
def errors_name(path: str | os.PathLike[str]) -> Iterator[None]:
    """Add the path of a file to errors of writing it, such as a full disk: the system leaves it out."""
    try:
        yield
    except OSError as error:
        if error.errno is None or error.filename is not None:
            raise
        raise OSError(error.errno, error.strerror, os.fspath(path)) from None


def sha256_of(path: Path, check: Callable[[], object] = lambda: None) -> str | None:
    """Return the SHA-256 of a regular file as 64 hexadecimal digits; None if it is missing or cannot be read.

    ``check`` is called again and again while it reads; it may raise an exception to cancel it.
    """
    digest = hashlib.sha256()
    try:
        with open_regular(path) as file:
            while piece := file.read(_PIECE_BYTES):
                check()
                digest.update(piece)
    except OSError:
        check()  # its error may be an OSError, too
        return None
    return digest.hexdigest()


def reason_of(error: BaseException) -> str:
    """Return the text of an error; of an OSError without the path, which the sentences that quote it name already."""
    return (isinstance(error, OSError) and error.strerror) or str(error)


@contextmanager
def errors_as(kind: type[Exception], where: object, *others: type[Exception]) -> Iterator[None]:
    """Context in which an OSError, and the other types of errors, become a ``kind``: ``WHERE: reason``."""
    kinds: tuple[type[Exception], ...] = (OSError, *others)
    try:
        yield
    except kinds as error:
        raise kind(f"{where}: {reason_of(error)}") from None


def _open(path: str | os.PathLike[str], follow_links: bool) -> int:
    names = ("O_CLOEXEC", "O_NONBLOCK", "O_NOCTTY", "O_BINARY")
    flags = os.O_RDONLY | sum(getattr(os, name, 0) for name in names)
    return os.open(path, flags | (0 if follow_links else getattr(os, "O_NOFOLLOW", 0)))


def _too_large(path: str | os.PathLike[str], max_bytes: int) -> OSError:
    return OSError(errno.EFBIG, f"it has more than {max_bytes} bytes, which is the limit", os.fspath(path))
