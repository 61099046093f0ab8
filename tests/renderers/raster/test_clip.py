"""Clipping at the near plane and at the guard band."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray

from renderers.compiler.pointers import f64_at
from renderers.raster import clip
from renderers.raster.layout import DRAW, FRAME, GUARD_BAND
from renderers.raster.primitive_setup import first_center

CAMERA = {"fx": 300.0, "fy": 200.0, "cx": 70.0, "cy": -20.0, "near": 0.5}
frame_at, draw_at = FRAME.at, DRAW.at


@njit(error_model="numpy")
def _clip_line(frame, ends):  # type: ignore[no-untyped-def]
    return clip.clip_line(frame_at(frame), f64_at(ends))


@njit(error_model="numpy")
def _clip_triangle(frame, draw, out):  # type: ignore[no-untyped-def]
    polygon = clip.polygon_array()
    count = clip.clip_triangle(frame_at(frame), draw_at(draw), 0, clip.corner_array(), polygon)
    for k in range(2 * count):
        f64_at(out)[k] = polygon[k]
    return count


@njit(error_model="numpy")
def _grid(value):  # type: ignore[no-untyped-def]
    return clip.snap_to_grid(value), first_center(clip.snap_to_grid(value))


def camera_frame() -> NDArray[np.void]:
    frame = np.zeros(1, FRAME.dtype)
    for field, value in CAMERA.items():
        frame[field] = value
    return frame


def project(point: Any) -> NDArray[np.float64]:
    x, y, z = point
    return np.array((CAMERA["fx"] * x / z + CAMERA["cx"], CAMERA["fy"] * y / z + CAMERA["cy"]))


def clipped_line(*ends: float) -> NDArray[np.float64] | None:
    values = np.array(ends)
    return values.reshape(2, 3) if _clip_line(camera_frame().ctypes.data, values.ctypes.data) else None


def clipped_triangle(corners: Any) -> NDArray[np.float64]:
    """Return the corners of the clipped polygon, (N, 2) pixels."""
    frame, draw = camera_frame(), np.zeros(1, DRAW.dtype)
    positions = np.array(corners, np.float32)
    indices, vertices = np.arange(3, dtype=np.uint32), np.zeros((3, 4), np.float32)
    with np.errstate(all="ignore"):
        vertices[:, :2] = [project(corner) for corner in positions.astype(np.float64)]
    frame["vertices"] = vertices.ctypes.data
    draw["positions"], draw["indices"] = positions.ctypes.data, indices.ctypes.data
    draw["X_camera_mesh"] = np.eye(4)[:3].ravel()
    out = np.zeros(2 * clip.MAX_VERTICES)
    count = _clip_triangle(frame.ctypes.data, draw.ctypes.data, out.ctypes.data)
    return out[: 2 * count].reshape(-1, 2) / 256


@pytest.mark.parametrize("behind", [0, 1])
def test_a_line_ends_at_the_near_plane(behind: int) -> None:
    ends = ((0.1, 0.2, -1.5), (0.3, -0.2, 2.5))
    line = clipped_line(*ends[behind], *ends[1 - behind])
    assert line is not None
    np.testing.assert_allclose(line[behind], (0.2, 0.0, 0.5), atol=1e-12)
    np.testing.assert_array_equal(line[1 - behind], ends[1])


def test_a_line_at_the_near_plane_is_kept() -> None:
    line = clipped_line(0.0, 0.0, 0.5, 1.0, 1.0, 0.5)
    assert line is not None
    np.testing.assert_array_equal(line, ((0.0, 0.0, 0.5), (1.0, 1.0, 0.5)))


def test_a_line_behind_the_near_plane_or_not_finite_is_dropped() -> None:
    assert clipped_line(0.0, 0.0, 0.49, 1.0, 1.0, -3.0) is None
    assert clipped_line(0.0, 0.0, np.nan, 1.0, 1.0, 3.0) is None
    assert clipped_line(0.0, 0.0, 2.0, np.inf, 1.0, 3.0) is None


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_line_ends_at_each_side_of_the_guard_band(axis: int, sign: float) -> None:
    ends = np.array(((0.0, 0.0, 1.0), (0.0, 0.0, 1.0)))
    ends[1, axis] = sign * 1000.0
    line = clipped_line(*ends.ravel())
    assert line is not None
    assert project(line[1])[axis] == pytest.approx(sign * GUARD_BAND)
    assert project(line[1])[1 - axis] == pytest.approx((CAMERA["cx"], CAMERA["cy"])[1 - axis])
    ends[0, axis] = sign * 900.0  # both ends outside of the same side
    assert clipped_line(*ends.ravel()) is None


def test_a_triangle_through_the_near_plane() -> None:
    polygon = clipped_triangle(((-0.5, 0.0, 1.0), (0.5, 0.0, 1.0), (0.0, 0.0, -1.0)))
    assert len(polygon) == 4
    expected = [project(p) for p in ((-0.5, 0, 1), (0.5, 0, 1), (0.375, 0, 0.5), (-0.375, 0, 0.5))]
    for corner in expected:
        assert np.abs(polygon - corner).max(axis=1).min() <= 0.5 / 256 + 1e-4


def test_a_triangle_through_all_sides_covers_the_guard_band() -> None:
    polygon = clipped_triangle(((-1e4, -1e4, 1.0), (3e4, -1e4, 1.0), (-1e4, 3e4, 1.0)))
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    np.testing.assert_allclose(low, -GUARD_BAND, atol=0.01)
    np.testing.assert_allclose(high, GUARD_BAND, atol=0.01)


def test_invisible_and_non_finite_triangles_leave_nothing() -> None:
    assert len(clipped_triangle(((0, 0, 0.4), (1, 0, 0.4), (0, 1, -2)))) == 0
    assert len(clipped_triangle(((0, 0, np.nan), (1, 0, 1), (0, 1, 2)))) == 0
    assert len(clipped_triangle(((0, 0, 1), (1, np.inf, 1), (0, 1, 2)))) == 0


@pytest.mark.parametrize(
    ("pixels", "grid", "pixel"),
    [
        (0.0, 0, 0),
        (0.5, 128, 0),  # a centre belongs to the coordinate itself
        (0.5 + 1 / 256, 129, 1),
        (-0.5, -128, -1),
        (-0.5 + 1 / 256, -127, 0),
        (2.5 / 256, 2, 0),  # ties round to even
        (3.5 / 256, 4, 0),
        (-1.5 / 256, -2, 0),
        (1000.25, 256064, 1000),
    ],
)
def test_grid(pixels: float, grid: int, pixel: int) -> None:
    assert _grid(np.float32(pixels)) == (grid, pixel)
