"""Depth test of eight pixels and of one, against its definition in NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray

from renderers.compiler import simd as vec
from renderers.compiler.pointers import f32_at, i32_at
from renderers.raster.depth_test import ANY_ORDER, IN_ORDER, PEELED, depth_test, depth_test_pixel
from renderers.raster.layout import FRAME, LAYER

PIXELS = 64
frame_at, layer_at = FRAME.at, LAYER.at


@njit(error_model="numpy")
def _test_vectors(frame, layer, rule, inv_z, covered, ids):  # type: ignore[no-untyped-def]
    for pixel in range(0, PIXELS, 8):
        mask = vec.load(i32_at(covered), pixel) != vec.i32(0)
        w, own = vec.load(f32_at(inv_z), pixel), vec.load(i32_at(ids), pixel)
        depth_test(frame_at(frame), layer_at(layer), rule, pixel, w, mask, own)


@njit(error_model="numpy")
def _test_pixels(frame, layer, rule, inv_z, covered, ids):  # type: ignore[no-untyped-def]
    for pixel in range(PIXELS):
        if i32_at(covered)[pixel] != 0:
            depth_test_pixel(frame_at(frame), layer_at(layer), rule, pixel, f32_at(inv_z)[pixel], i32_at(ids)[pixel])


def layer_of(rng: np.random.Generator) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """A layer with few different values, so that ties are frequent; some pixels are empty."""
    return rng.integers(-1, 4, PIXELS).astype(np.int32), rng.integers(1, 5, PIXELS).astype(np.float32)


def run_test(
    kernel: Any, seed: int, rule: int, beyond: bool, before: bool
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], tuple[Any, ...]]:
    """Return which pixels were written and the layer's, the primitive's and the limiting layers' values."""
    rng = np.random.default_rng(seed)
    frame, layer = np.zeros(1, FRAME.dtype), np.zeros(1, LAYER.dtype)
    old_ids, old_inv_z = layer_of(rng)
    ids, inv_z = layer_of(rng)
    inv_z[rng.random(PIXELS) < 0.1] = np.nan
    covered = rng.integers(0, 2, PIXELS).astype(np.int32)
    limits = layer_of(rng), layer_of(rng)
    new_ids, new_inv_z = old_ids.copy(), old_inv_z.copy()
    layer["ids"], layer["inv_z"] = new_ids.ctypes.data, new_inv_z.ctypes.data
    for name, wanted, (limit_ids, limit_inv_z) in zip(("beyond", "before"), (beyond, before), limits, strict=True):
        if wanted:
            frame[f"{name}_ids"], frame[f"{name}_inv_z"] = limit_ids.ctypes.data, limit_inv_z.ctypes.data
    kernel(frame.ctypes.data, layer.ctypes.data, rule, *(a.ctypes.data for a in (inv_z, covered, ids)))
    written = (new_ids != old_ids) | (new_inv_z != old_inv_z)
    assert (new_ids[written] == ids[written]).all()
    assert (new_inv_z[written] == inv_z[written]).all()
    same = (ids == old_ids) & (inv_z == old_inv_z)  # writing these cannot be seen
    return written, same, (old_ids, old_inv_z, ids, inv_z, covered != 0, limits)


@pytest.mark.parametrize(("beyond", "before"), [(False, False), (True, False), (False, True), (True, True)])
@pytest.mark.parametrize("rule", [IN_ORDER, ANY_ORDER, PEELED])
@pytest.mark.parametrize("kernel", [_test_vectors, _test_pixels])
def test_against_the_definition(kernel: Any, rule: int, beyond: bool, before: bool) -> None:
    for seed in range(20):
        written, same, (old_ids, old_inv_z, ids, inv_z, covered, limits) = run_test(kernel, seed, rule, beyond, before)
        expected = inv_z > old_inv_z
        if rule == ANY_ORDER or kernel is _test_pixels:  # single pixels come in any order
            expected |= (inv_z == old_inv_z) & (ids < old_ids)
        if rule == PEELED and beyond:
            limit_ids, limit = limits[0]
            expected &= (limit_ids >= 0) & ((inv_z < limit) | ((inv_z == limit) & (ids > limit_ids)))
        if rule == PEELED and before:
            limit_ids, limit = limits[1]
            expected &= (limit_ids < 0) | (inv_z > limit) | ((inv_z == limit) & (ids < limit_ids))
        np.testing.assert_array_equal(written[~same], (expected & covered)[~same])
