"""Kernels called by their address, and numbers that threads take."""

from __future__ import annotations

import threading

import numpy as np
from numba import njit

from renderers.cpu.layout import M_COLUMNS, M_SIZE, T_COLUMNS, T_CULL, T_HIDDEN
from renderers.cpu.scene import NOT_SOLID
from renderers.cpu.transform import place
from renderers.native import YIELD_ADDRESS, call_kernel, kernel_address, shared_number, take_number, yield_at
from renderers.pointers import i64_at


@njit
def _call(address, points, sizes, cull, bounds, lens, table, lengths, count):
    call_kernel(address, (points, sizes, cull, bounds, lens, table, lengths, count))


def test_a_kernel_called_by_its_address_does_what_it_does() -> None:
    points = np.stack((np.eye(4), np.diag((-1.0, 1.0, 1.0, 1.0)), np.eye(4)))
    points[:, 2, 3] = 3.0
    sizes, cull = np.array((1.0, 2.0, 3.0)), np.array((True, True, False))
    bounds = np.array(((0.0, 0.0, 0.0, 1.0, 1.0, 3.0), NOT_SOLID, (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)))
    lens = np.array((100.0, 100.0, 50.0, 50.0, 0.1, 10.0))
    tables = []
    for call in (place, lambda *arguments: _call(kernel_address(place), *arguments)):
        table, lengths = np.full((4, T_COLUMNS), 7), np.zeros((3, M_COLUMNS))
        call(*(a.ctypes.data for a in (points, sizes, cull, bounds, lens, table, lengths)), 3)
        assert table[:, T_CULL].tolist() == [1, -1, 0, 2]
        assert table[:3, T_HIDDEN].tolist() == [0, 0, 1]
        np.testing.assert_array_equal(lengths[:, :M_SIZE], points.reshape(3, 16)[:, :12])
        np.testing.assert_array_equal(lengths[:, M_SIZE], sizes)
        tables.append(table)
    assert (tables[0] == tables[1]).all()


@njit(nogil=True)
def _take(numbers, taken, most, pause):
    shared, own = i64_at(numbers), i64_at(taken)
    count = 0
    number = take_number(shared, 1)
    while number < most:
        own[number] += 1
        take_number(shared, 0)
        count += 1
        number = take_number(shared, 1)
    while shared_number(shared, 0) < most:
        if pause != 0:
            yield_at(pause)
    return count


def test_every_number_is_taken_once() -> None:
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
