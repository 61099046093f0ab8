"""Comparing bytes at the speed of memory, with the GIL released."""

from __future__ import annotations

import ctypes
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.scene.gltf.kernels import equal_arrays

_KERNEL_FROM: Final = 1 << 13
"""Bytes. Below, calling the kernel costs more than ``bytes.__eq__``, which holds the GIL."""
_RELEASE_FROM: Final = 1 << 20
"""Bytes. Fewer, as a connection brings them, are compared sooner than another thread has taken the GIL and given it
back."""


def equal_bytes(a: bytes | memoryview, b: bytes | memoryview) -> bool:
    """``a == b``."""
    if len(a) != len(b):
        return False
    if len(a) < _KERNEL_FROM:
        return (a if isinstance(a, bytes) else bytes(a)) == (b if isinstance(b, bytes) else bytes(b))
    x, y = np.frombuffer(a, np.uint8), np.frombuffer(b, np.uint8)
    x.flags.writeable = y.flags.writeable = False
    return bool(equal_arrays(x, y))


def equal_at(text: bytes, begin: int, piece: memoryview) -> bool:
    """Whether ``piece`` stands in ``text`` at ``begin``; both end within it."""
    count = len(piece)
    if count < _RELEASE_FROM:
        return text.startswith(piece, begin)
    x, y = np.frombuffer(text, np.uint8, count, begin), np.frombuffer(piece, np.uint8)
    y.flags.writeable = False
    return bool(equal_arrays(x, y))


def common_length(a: bytes, b: bytes) -> int:
    """How many bytes ``a`` and ``b`` begin with that are the same."""
    shorter, view = min(len(a), len(b)), memoryview(b)
    for begin in range(0, shorter, _KERNEL_FROM):
        end = min(begin + _KERNEL_FROM, shorter)
        if not equal_at(a, begin, view[begin:end]):
            x, y = np.frombuffer(a, np.uint8, end - begin, begin), np.frombuffer(b, np.uint8, end - begin, begin)
            return begin + int(np.argmax(x != y))
    return shorter


_HEAD: Final = bytes.__basicsize__ - 1
"""Bytes of a ``bytes`` object before its contents; the size counts the zero that ends them."""


def address_of_bytes(data: bytes) -> int:
    """Where the contents of ``data`` begin, in a tenth of numpy's time. Whoever asks keeps ``data`` alive."""
    return id(data) + _HEAD


_first_of: Final[Any] = ctypes.c_char.from_buffer


def address_of_new(memory: bytearray | NDArray[Any]) -> int:
    """Where a writable, C-contiguous array begins that is not empty, in a seventh of numpy's time. Whoever asks keeps
    it alive."""
    return ctypes.addressof(_first_of(memory))


def _check_address() -> None:
    probe = bytes(range(64))
    address: int = np.frombuffer(probe, np.uint8).__array_interface__["data"][0]
    if address_of_bytes(probe) != address:
        raise ImportError("this Python keeps the contents of bytes elsewhere than CPython does")


_check_address()
