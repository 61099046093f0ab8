"""Kernel calls by address, and the atomic counter."""

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
from renderers.shading.layout import InstanceMatrices
from renderers.shading.scene import compute_instance_matrices


@njit
def _call(address, points, maps, count, inverts_mirrored):
    call_kernel(address, (points, maps, count, inverts_mirrored))


def test_calling_a_kernel_by_address() -> None:
    points = np.stack((np.eye(4), np.diag((-1.0, 2.0, 1.0, 1.0))))
    filled = []
    kernel_at = kernel_address(compute_instance_matrices)
    for call in (compute_instance_matrices, lambda *arguments: _call(kernel_at, *arguments)):
        matrices = np.zeros(2, InstanceMatrices.dtype)
        call(points.ctypes.data, matrices.ctypes.data, 2, 0)
        assert matrices["mirror_sign"].tolist() == [1.0, -1.0]
        filled.append(matrices)
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
