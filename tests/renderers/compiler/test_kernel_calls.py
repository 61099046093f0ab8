"""Kernel calls by address, and the atomic counter."""

from __future__ import annotations

import threading

import numpy as np
from numba import njit

from renderers.compiler.kernel_calls import (
    YIELD_ADDRESS,
    atomic_add_one,
    call_kernel,
    kernel_address,
    load_acquire,
    yield_at,
)
from renderers.compiler.pointers import i64_at
from renderers.shading.layout import P_COLUMNS, P_MIRROR
from renderers.shading.scene import map_instances


@njit
def _call(address, points, maps, count):
    call_kernel(address, (points, maps, count))


def test_calling_a_kernel_by_address() -> None:
    points = np.stack((np.eye(4), np.diag((-1.0, 2.0, 1.0, 1.0))))
    filled = []
    for call in (map_instances, lambda *arguments: _call(kernel_address(map_instances), *arguments)):
        maps = np.full((2, P_COLUMNS), 7.0, np.float32)
        call(points.ctypes.data, maps.ctypes.data, 2)
        assert maps[:, P_MIRROR].tolist() == [1.0, -1.0]
        filled.append(maps)
    assert (filled[0] == filled[1]).all()


@njit(nogil=True)
def _take(numbers, taken, most, pause):
    shared, own = i64_at(numbers), i64_at(taken)
    count = 0
    number = atomic_add_one(shared, 1)
    while number < most:
        own[number] += 1
        atomic_add_one(shared, 0)
        count += 1
        number = atomic_add_one(shared, 1)
    while load_acquire(shared, 0) < most:
        if pause != 0:
            yield_at(pause)
    return count


def test_atomic_counter_yields_every_number_once() -> None:
    most = 200_000
    shared, taken = np.zeros(2, np.int64), np.zeros(most, np.int64)
    _take(shared.ctypes.data, taken.ctypes.data, 0, YIELD_ADDRESS)
    shared[:] = 0
    arguments = shared.ctypes.data, taken.ctypes.data, most, YIELD_ADDRESS
    threads = [threading.Thread(target=_take, args=arguments) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (taken == 1).all()
    assert shared.tolist() == [most, most + 3]
