"""Reading a FRAME, to run its kernels one by one."""

from __future__ import annotations

import ctypes
from types import SimpleNamespace

import numpy as np

from renderers.raster.layout import FRAME


def read_frame(address: int) -> SimpleNamespace:
    """Return the fields of the FRAME at an address."""
    memory = (ctypes.c_char * FRAME.size).from_address(address)
    frame = np.frombuffer(bytes(memory), FRAME.dtype)[0]
    return SimpleNamespace(**{name: frame[name].tolist() for name in FRAME.dtype.names or ()})
