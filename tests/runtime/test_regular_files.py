"""Files that somebody names: regular ones only, except for pipes on the command line."""

import hashlib
import os
import re
import resource
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from renderers.stop import StopFlag, check_stop
from scenegate.regular_files import open_regular, read_file_or_pipe, read_regular, read_text, sha256_of, write_whole
from tests.support.waiting import SECONDS


@pytest.fixture
def pipe(tmp_path: Path) -> Path:
    """Return a named pipe that nobody writes to."""
    path = tmp_path / "pipe"
    os.mkfifo(path)
    return path


def test_reads_bytes_and_text(tmp_path: Path) -> None:
    path = tmp_path / "file"
    content = "ä".encode() * (1 << 20)
    path.write_bytes(content)
    assert read_regular(path) == read_file_or_pipe(path) == content
    assert read_regular(path, len(content)) == content
    assert read_text(str(path)) == content.decode()
    with open_regular(path) as file:
        assert file.read(2) == "ä".encode()
        assert not os.get_inheritable(file.fileno())
    assert sha256_of(path) == hashlib.sha256(content).hexdigest()


def test_a_file_that_cannot_be_written_to_its_end_is_removed(tmp_path: Path) -> None:
    path, device, link = tmp_path / "file", Path("/dev/full"), tmp_path / "link"
    link.symlink_to(path)
    before, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        with pytest.raises(OSError, match="File too large") as refused:
            write_whole(path, bytes(2000))
        with pytest.raises(OSError, match="File too large"):
            write_whole(link, bytes(2000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (before, hard))
    assert (refused.value.filename, path.exists()) == (str(path), False)
    assert link.is_symlink()
    with pytest.raises(OSError, match="No space left") as refused:
        write_whole(device, b"data")
    assert refused.value.filename == str(device)
    assert device.exists()
    write_whole(path, b"data")
    assert path.read_bytes() == b"data"


def test_a_pointer_of_git_lfs_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.obj"
    path.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:f578f7\nsize 517437\n")
    with pytest.raises(OSError, match=r"Git LFS, .*git lfs pull"):
        read_regular(path)


def test_larger_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"12345")
    for read in (read_regular, read_file_or_pipe):
        with pytest.raises(OSError, match="it has more than 4 bytes, which is the limit"):
            read(path, 4)
    with pytest.raises(OSError, match="more than 1000 bytes"):
        read_file_or_pipe("/dev/zero", 1000)
    with pytest.raises(OSError, match="more than 10 bytes"):  # its size is said to be 0
        read_regular("/proc/self/status", 10)


def test_other_files_are_refused_at_once(tmp_path: Path, pipe: Path) -> None:
    (tmp_path / "link").symlink_to(pipe)
    for path in (pipe, tmp_path / "link", Path("/dev/zero"), tmp_path):
        with pytest.raises(OSError, match=r"not a regular file|directory"):
            read_regular(path)
        assert sha256_of(path) is None
    (tmp_path / "file").write_bytes(b"x")
    (tmp_path / "other").symlink_to(tmp_path / "file")
    assert read_regular(tmp_path / "other") == b"x"
    with pytest.raises(OSError, match="symbolic link"):
        read_regular(tmp_path / "other", follow_links=False)
    with pytest.raises(FileNotFoundError):
        read_regular(tmp_path / "missing")


@pytest.mark.parametrize("read", [read_regular, read_file_or_pipe])
def test_a_folder_is_refused_by_its_name_and_closed(read: Callable[[Path], bytes], tmp_path: Path) -> None:
    before = len([*Path("/proc/self/fd").iterdir()])
    for _ in range(3):
        with pytest.raises(OSError, match=re.escape(str(tmp_path))) as caught:
            read(tmp_path)
        assert caught.value.filename == str(tmp_path)
    assert len([*Path("/proc/self/fd").iterdir()]) == before


def test_a_pipe_is_read_to_its_end(pipe: Path) -> None:
    content = os.urandom(300_000)
    writer = threading.Thread(target=pipe.write_bytes, args=(content,))
    writer.start()
    assert read_file_or_pipe(pipe) == content
    writer.join(SECONDS)


def test_a_pipe_without_writer_is_left_at_the_stop_flag(pipe: Path) -> None:
    flag = StopFlag()
    threading.Timer(0.05, flag.set, (TimeoutError("late"),)).start()
    with pytest.raises(TimeoutError, match="late"):
        flag.run(lambda: read_file_or_pipe(pipe, check=check_stop))


def test_the_stop_flag_ends_hashing(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(bytes(1))
    flag = StopFlag()
    flag.set(TimeoutError("late"))
    with pytest.raises(TimeoutError, match="late"):
        flag.run(lambda: sha256_of(tmp_path / "file", check_stop))
