"""Exclusive locks of files and folders that only one process may write: kernels, state, datasets."""

import fcntl
from enum import Enum


class Lock(Enum):
    """Result of ``try_lock``."""

    HELD = "held"
    """This process has the lock until it closes the descriptor, or ends."""
    TAKEN = "taken"
    """Another process has the lock."""
    UNSUPPORTED = "unsupported"
    """The file system has no locks, as NFS and Lustre often do. Other processes are not kept from writing."""


def try_lock(descriptor: int) -> Lock:
    """Take the exclusive lock of an open file or folder (``flock``), without waiting for it."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return Lock.TAKEN
    except OSError:  # ENOLCK, EOPNOTSUPP, ENOSYS, EINVAL; EBADF of a folder on NFS, where a lock needs write access
        return Lock.UNSUPPORTED
    return Lock.HELD
