"""A file system without locks."""

import errno
import fcntl
import os
from typing import NoReturn

import pytest


def refuse_locks(monkeypatch: pytest.MonkeyPatch, number: int = errno.ENOLCK) -> None:
    """Make ``flock`` fail as on NFS or Lustre without a lock service."""

    def flock(descriptor: int, operation: int) -> NoReturn:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(fcntl, "flock", flock)
