"""Comparing bytes at the speed of memory, with the GIL released."""

from __future__ import annotations

import ctypes
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.gltf.reader_kernels import equal_arrays

_KERNEL_FROM: Final = 1 << 13
"""Bytes. Below, calling the kernel costs more than ``bytes.__eq__``, which holds the GIL."""


def equal_bytes(a: bytes | memoryview, b: bytes | memoryview) -> bool:
    """``a == b``."""
    if len(a) != len(b):
        return False
    if len(a) < _KERNEL_FROM:
        return (a if isinstance(a, bytes) else bytes(a)) == (b if isinstance(b, bytes) else bytes(b))
    x, y = np.frombuffer(a, np.uint8), np.frombuffer(b, np.uint8)
    x.flags.writeable = y.flags.writeable = False
    return bool(equal_arrays(x, y))


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
