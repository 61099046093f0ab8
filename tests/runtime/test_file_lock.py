"""The lock of a file: held, taken, and file systems that have none."""

import errno
from pathlib import Path

import pytest

from gateway.runtime.file_lock import Lock, try_lock
from tests.support.locks import refuse_locks


def test_only_one_descriptor_holds_the_lock(tmp_path: Path) -> None:
    path = tmp_path / "lock"
    with path.open("wb") as first, path.open("wb") as second:
        assert try_lock(first.fileno()) is Lock.HELD
        assert try_lock(second.fileno()) is Lock.TAKEN
        first.close()
        assert try_lock(second.fileno()) is Lock.HELD


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL, errno.EBADF])
def test_a_file_system_without_locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    refuse_locks(monkeypatch, number)
    with (tmp_path / "lock").open("wb") as file:
        assert try_lock(file.fileno()) is Lock.UNSUPPORTED
