"""Depth range of a sensor."""

import math

import numpy as np
import pytest

from renderers.depth_range import depth_in_millimetres, limit_depth


def test_limits_are_inclusive() -> None:
    depth = np.array([[0.05, 0.1, 0.2, 4.9, 5.0, 9.0, math.inf]], np.float32)
    limit_depth(depth, float(np.float32(0.1)), 5.0)
    np.testing.assert_array_equal(depth, np.array([[0, 0, 0.2, 4.9, math.inf, math.inf, math.inf]], np.float32))


@pytest.mark.parametrize("limits", [(0.1, 5.0), (0.0, math.inf), (2.5, 2.6), (0.3, 1e300), (1e-300, 0.1)])
@pytest.mark.parametrize("width", [1, 7, 64, 333])
def test_every_pixel_is_limited(limits: tuple[float, float], width: int) -> None:
    random = np.random.default_rng(width)
    depth = random.uniform(0.0, 6.0, (5, width)).astype(np.float32)
    depth[random.random(depth.shape) < 0.2] = math.inf
    for limit in limits:
        depth[random.random(depth.shape) < 0.1] = np.float32(min(limit, 1e38))
    with np.errstate(over="ignore"):
        near, far = np.float32(limits[0]), np.float32(limits[1])
    limited = np.where(depth >= far, np.float32(math.inf), depth)
    expected = np.where(limited <= near, np.float32(0.0), limited)
    limit_depth(depth, *limits)
    np.testing.assert_array_equal(depth, expected)


def test_millimetres_round_half_to_even_and_saturate() -> None:
    metres = [0.0, 0.0004, 0.0005, 0.0006, 0.0015, 0.0025, 1.2344, 1.2346, 65.534, 65.5349, 65.536, 1e9, math.inf]
    expected = [0, 0, 0, 1, 2, 2, 1234, 1235, 65534, 65535, 65535, 65535, 65535]
    millimetres = depth_in_millimetres(np.array([metres], np.float32))
    np.testing.assert_array_equal(millimetres, np.array([expected], np.uint16))
