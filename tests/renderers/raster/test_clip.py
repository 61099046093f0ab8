"""Clipping at the near plane and at the guard band, and the grid that coordinates are rounded to."""

from typing import Any

import numpy as np
import pytest
from numba import njit

from renderers.interface import Output
from renderers.raster import CpuRenderer
from renderers.raster.grid import first_center, snap_to_grid
from tests.renderers import oracle
from tests.renderers.scenes import camera, draw_list, mesh


@njit(error_model="numpy")
def _grid(value):  # type: ignore[no-untyped-def]  # Numba infers the types
    return snap_to_grid(value), first_center(snap_to_grid(value))


NEAR = 0.5
BEHIND = ((0.1, 0.2, -1.5), (0.3, -0.2, 2.5))


@pytest.mark.parametrize(
    "corners",
    [
        BEHIND,
        BEHIND[::-1],
        ((-0.2, 0.0, NEAR), (0.2, 0.1, NEAR)),
        ((0.0, 0.0, 1.0), (1e3, 0.0, 1.0)),
        ((0.0, 0.0, 1.0), (-1e3, 0.0, 1.0)),
        ((0.0, 0.0, 1.0), (0.0, 1e3, 1.0)),
        ((0.0, 0.0, 1.0), (0.0, -1e3, 1.0)),
        ((-1e3, -0.1, 1.0), (1e3, 0.1, 1.0)),
        ((-2e3, -1.0, 3.0), (1e3, 2.0, 5.0)),
        ((-0.5, 0.0, 1.0), (0.5, 0.0, 1.0), (0.1, 0.3, -1.0)),
        ((-0.5, 0.0, -1.0), (0.5, 0.0, -1.0), (0.1, 0.3, 1.0)),
        ((-1e4, -1e4, 1.0), (3e4, -1e4, 1.0), (-1e4, 3e4, 1.0)),
        ((-1e4, -1e3, 7.0), (3e4, -1e4, 1.0), (-1e4, 3e4, 1.0)),
    ],
)
def test_clipped_lines_and_triangles_agree_with_the_oracle(corners: Any) -> None:
    """The oracle knows no guard band: clipped ends may differ by an edge pixel."""
    scene, view = draw_list(mesh(corners, (range(len(corners)),))), camera(near=NEAR)
    expected = oracle.draw(scene, view)
    covered = expected.ids >= 0
    assert covered.any()
    frame = CpuRenderer(1).render(scene, view, Output.DEPTH)
    assert np.count_nonzero(np.isfinite(frame.depth) != covered) <= 1
    both = np.isfinite(frame.depth) & covered
    np.testing.assert_allclose(frame.depth[both], expected.depth[both], rtol=1e-5)


@pytest.mark.parametrize(
    "corners",
    [
        ((0.0, 0.0, 0.49), (1.0, 1.0, -3.0)),
        ((0.0, 0.0, np.nan), (1.0, 1.0, 3.0)),
        ((0.0, 0.0, 2.0), (np.inf, 1.0, 3.0)),
        ((900.0, 0.0, 1.0), (1000.0, 0.0, 1.0)),
        ((0.0, -900.0, 1.0), (0.0, -1000.0, 1.0)),
        ((0, 0, 0.4), (1, 0, 0.4), (0, 1, -2)),
        ((0, 0, np.nan), (1, 0, 1), (0, 1, 2)),
        ((0, 0, 1), (1, np.inf, 1), (0, 1, 2)),
    ],
)
def test_invisible_and_non_finite_primitives_leave_nothing(corners: Any) -> None:
    scene = draw_list(mesh(corners, (range(len(corners)),)))
    frame = CpuRenderer(1).render(scene, camera(near=NEAR), Output.DEPTH)
    assert frame.depth is not None
    assert np.isinf(frame.depth).all()


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
