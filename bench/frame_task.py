"""Reading a frame's TASK, to run its kernels one by one."""

from __future__ import annotations

import ctypes
from types import SimpleNamespace

import numpy as np

from renderers.raster.layout import TASK


def read_task(address: int) -> SimpleNamespace:
    """Return the fields of the TASK at an address."""
    memory = (ctypes.c_char * TASK.size).from_address(address)
    task = np.frombuffer(bytes(memory), TASK.dtype)[0]
    return SimpleNamespace(**{name: task[name].tolist() for name in TASK.dtype.names or ()})
