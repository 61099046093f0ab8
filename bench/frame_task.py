"""Reading a RasterFrame, to run its kernels one by one."""

from __future__ import annotations

import ctypes
from types import SimpleNamespace

import numpy as np

from renderers.raster.layout import RasterFrame


def read_frame(address: int) -> SimpleNamespace:
    """Return the fields of the RasterFrame at an address."""
    memory = (ctypes.c_char * RasterFrame.nbytes).from_address(address)
    frame = np.frombuffer(bytes(memory), RasterFrame.dtype)[0]
    return SimpleNamespace(**{name: frame[name].tolist() for name in RasterFrame.dtype.names or ()})
