"""Kernels of ``renderers.stereo``, pixel by pixel: limits, signs and second components."""

import numpy as np
import pytest
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.compiler.jit import KERNELS
from renderers.stereo.depth.depth_images import DepthImages, DepthRange, exact_images, true_disparity
from renderers.stereo.depth.filters import Filters, apply_filters, fill_holes
from renderers.stereo.depth.matching import fine_means, match_pair
from renderers.stereo.depth.metric_depth import align_depth
from renderers.stereo.lens.color_camera import ColorCamera
from renderers.stereo.lens.motion_blur import write_mean_light
from renderers.stereo.light.posed_projector import Surfaces, add_dots
from renderers.stereo.light.projector import projected_dots
from renderers.stereo.mesh import mesh_kernels as mesh
from renderers.stereo.mesh.disparity_mesh import MeshOptions, disparity_mesh
from renderers.stereo.model import Intrinsics
from renderers.stereo.sensor.camera_image import Lens, SceneLight, fixed_pattern, image_from_light, light_on_sensor
from renderers.stereo.sensor.exposure import Exposure

KEY = np.uint64(7)


def row(*values: float | np.float32) -> NDArray[np.float32]:
    return np.array([values], np.float32)


def depth_images(disparity: NDArray[np.uint16], error: int = 2, confidence: int = 255) -> DepthImages:
    valid = disparity > 0
    return DepthImages(
        disparity.copy(), np.where(valid, error, 0).astype(np.uint8), np.where(valid, confidence, 0).astype(np.uint8)
    )


def test_every_kernel_is_called_with_the_types_of_its_signature() -> None:
    """Another type would compile a second time, in the running server."""
    rng = np.random.default_rng(0)
    rendered = rng.integers(0, 1 << 32, (24, 48), np.uint32)
    depth = np.full((24, 40), 2.0, np.float32)
    dots = projected_dots(depth, 40.0, 20.0, 12.0, 0.05, depth)
    camera = Camera(40, 24, 40.0, 40.0, 20.0, 12.0, 0.01, 100.0, np.eye(4))
    returned = np.zeros((24, 40), np.int32), np.ones(1, np.float32)
    surfaces = Surfaces(camera, depth, np.zeros((24, 40, 3), np.float32), returned, np.ones_like(depth))
    add_dots(dots, surfaces, camera, depth, 1.0, soft=False, right=False)
    factors = np.ones((24, 48), np.float32)
    for light, color in ((SceneLight(dots, 1.0, factors), True), (SceneLight(), False)):
        on_sensor = light_on_sensor(
            rendered, Intrinsics(40, 24, 40.0, 20.0, 12.0), Exposure(), light, Lens(0.7, True), color=color
        )
        pattern = fixed_pattern(0, right=False, height=24, width=40)
        image = image_from_light(on_sensor, Exposure(), KEY, pattern).image
    write_mean_light(rendered, 4, 2, [rendered[:8, :12].copy()])
    fine = fine_means(image, 1, 24, 40)
    match_pair(fine, fine, 16, np.full(256, 0.3), 1)
    true = true_disparity(depth, depth, 8.0, DepthRange(0.4, 100.0))
    images = exact_images(true)
    apply_filters(images, Filters(), 8.0, 2)
    k = Intrinsics(40, 24, 40.0, 20.0, 12.0)
    disparity_mesh(images.disparity, k, 0.2, MeshOptions(watertight=True, textured=True), image)
    align_depth(np.full((24, 40), 2000, np.uint16), k, ColorCamera(k, (0.0, 0.0, 0.0)))
    kernels = [kernel for kernel in KERNELS if kernel.py_func.__module__.startswith("renderers.stereo.")]
    assert len(kernels) == 24
    for kernel in kernels:
        assert kernel.signatures, f"{kernel.py_func.__name__} was not called"
        kernel.compile()
        assert len(kernel.signatures) == 1, kernel.py_func.__name__


def test_depths_at_the_limits_are_measured() -> None:
    near, far = np.float32(0.5), np.float32(4.0)
    left = row(np.nextafter(near, np.float32(0)), near, far, np.nextafter(far, np.float32(9)), np.inf, np.nan)
    right = np.full_like(left, np.inf)
    true = true_disparity(left, right, 0.01, DepthRange(float(near), float(far)))
    assert (true[0] > 0).tolist() == [False, True, True, False, False, False]
    assert true[0, 1:3] == pytest.approx([0.02, 0.0025])


def test_points_beside_the_right_image_are_not_measured() -> None:
    # Column 2 lands at 2 - disparity; the first pixel's left edge is at -0.5.
    left, right = row(1.0, 1.0, 1.0), np.full((1, 3), np.inf, np.float32)
    assert true_disparity(left, right, 2.5, DepthRange(0.1, 10.0)).tolist() == [[0.0, 0.0, 2.5]]
    assert true_disparity(left, right, 2.50001, DepthRange(0.1, 10.0)).tolist() == [[0.0, 0.0, 0.0]]


@pytest.mark.parametrize(
    ("seen", "measured"),
    [
        ((4.0, 4.0), True),
        ((2.0, 2.0), True),  # nearer by exactly one pixel of disparity
        ((1.99, 1.99), False),
        ((1.99, 4.0), True),  # past the edge of the nearer thing
        ((4.0, 1.99), True),
        ((1.99, np.inf), True),
    ],
)
def test_occlusion_by_nearer_points_of_the_right_image(seen: tuple[float, float], measured: bool) -> None:
    left = row(np.inf, np.inf, 4.0, np.inf)  # a disparity of one pixel: lands on column 1, next to column 2
    true = true_disparity(left, row(np.inf, *seen, np.inf), 4.0, DepthRange(0.1, 10.0))
    assert (true[0, 2] > 0) == measured


def test_disparities_stay_within_16_bits_and_above_invalid() -> None:
    images = exact_images(row(0.0, 1e-6, 0.09375, 4095.9375, 5000.0))
    assert images.disparity.tolist() == [[0, 1, 2, 65535, 65535]]
    assert images.confidence.tolist() == [[0, 255, 255, 255, 255]]
    assert images.error.tolist() == [[0, 1, 1, 1, 1]]


def test_filters_keep_pixels_at_their_limits() -> None:
    images = depth_images(np.array([[159, 160, 320, 321]], np.uint16))
    # 88 / (160 / 16) = 8.8 m and 88 / (320 / 16) = 4.4 m.
    apply_filters(images, Filters(mindepth=4.4, maxdepth=8.8, seg=0, fill=0), 88.0, 2)
    assert images.disparity.tolist() == [[0, 160, 320, 0]]
    assert images.error.tolist() == [[0, 2, 2, 0]]
    assert images.confidence.tolist() == [[0, 255, 255, 0]]
    confident = depth_images(np.full((1, 4), 160, np.uint16))
    confident.confidence[0] = (152, 153, 154, 0)
    apply_filters(confident, Filters(minconf=0.6, seg=0, fill=0), 88.0, 2)  # 153 / 255
    assert confident.disparity.tolist() == [[0, 160, 160, 0]]
    errors = depth_images(np.full((1, 3), 160, np.uint16))
    errors.error[0] = (15, 16, 17)
    apply_filters(errors, Filters(maxdeptherr=0.88, seg=0, fill=0), 88.0, 2)  # 1 px at 10 px: a tenth of 8.8 m
    assert errors.disparity.tolist() == [[160, 160, 0]]


@pytest.mark.parametrize(("divisor", "size"), [(1, 40), (2, 10), (4, 2)])
def test_segment_sizes_are_pixels_of_a_high_image(divisor: int, size: int) -> None:
    disparity = np.zeros((9, 60), np.uint16)
    disparity[2, 2 : 2 + size - 1] = 160
    disparity[6, 2 : 2 + size] = 160
    images = depth_images(disparity)
    apply_filters(images, Filters(seg=10, fill=0), 88.0, divisor)
    assert not images.disparity[2].any()
    assert not images.error[2].any()
    assert (images.disparity[6] == disparity[6]).all()


def test_holes_are_filled_linearly_with_the_larger_error() -> None:
    disparity = np.full((12, 12), 160, np.uint16)
    disparity[:, 7:] = 176
    disparity[5, 4:7] = 0
    images = depth_images(disparity)
    images.error[5, 3], images.error[5, 7] = 3, 9
    fill_holes(images, 1)  # the border differs by exactly one pixel
    assert images.disparity[5, 3:8].tolist() == [160, 164, 168, 172, 176]
    assert images.error[5, 4:7].tolist() == [9, 9, 9]
    assert images.confidence[5, 4:7].tolist() == [128, 128, 128]
    above = depth_images(disparity)
    above.disparity[4, 5] = 159
    fill_holes(above, 1)
    assert not above.disparity[5, 4:7].any(), "one unit too much above the hole"


@pytest.mark.parametrize(("minconf", "filled"), [(0.5, True), (128 / 255, True), (0.51, False), (1.0, False)])
def test_minimum_confidence_applies_to_filled_pixels(minconf: float, filled: bool) -> None:
    d = np.full((60, 60), 800, np.uint16)
    d[30:33, 10:13] = 0
    images = depth_images(d)
    apply_filters(images, Filters(minconf=minconf, seg=0), 88.0, 2)
    assert images.disparity[30:33, 10:13].all() == filled
    assert images.confidence[images.disparity > 0].min() >= minconf * 255


def test_bins_average_valid_pixels_or_take_the_nearest() -> None:
    disparity = np.array([[16, 0, 0], [0, 48, 0], [0, 0, 0]], np.uint16)
    d, u, v = (np.empty((2, 2), np.float32) for _ in range(3))
    mesh.bin_points(disparity, 2, False, d, u, v)
    assert d.tolist() == [[32.0, 0.0], [0.0, 0.0]]
    assert u.tolist() == [[1.0, 3.0], [1.0, 3.0]]
    assert v.tolist() == [[1.0, 1.0], [3.0, 3.0]]
    disparity[0, 1] = 48  # as near as the other, but first
    mesh.bin_points(disparity, 2, True, d, u, v)
    assert (d[0, 0], u[0, 0], v[0, 0]) == (48.0, 1.5, 0.5)


def test_empty_bins_continue_the_background() -> None:
    d = np.array([[0, 0, 0], [0, 5, 0], [0, 0, 0], [7, 0, 3], [0, 0, 0]], np.float32)
    mesh.fill_empty_bins(d)
    assert d.tolist() == [[5, 5, 5], [5, 5, 5], [5, 5, 5], [7, 3, 3], [7, 3, 3]]


def test_points_follow_the_manuals_formula() -> None:
    d, u, v = np.array([[0, 8]], np.float32), np.array([[0.5, 3.5]], np.float32), np.array([[0.5, 2.5]], np.float32)
    index, points = np.array([[-1, 0]], np.int32), np.empty((1, 4), np.float32)
    mesh.make_points(d, u, v, 100.0, 2.0, 4.0, 1.6, 0.4, index, points)
    assert index.tolist() == [[-1, 0]]
    assert points[0] == pytest.approx([1.5 * 0.2, -1.5 * 0.2, 20.0, 0.05])


PIXELS = np.array([[0.5, 1.5], [0.5, 1.5]], np.float32), np.array([[0.5, 0.5], [1.5, 1.5]], np.float32)
"""Positions of the pixels of a cell."""


def triangles_of(
    d: NDArray[np.float32], max_step: float, positions: tuple[NDArray[np.float32], NDArray[np.float32]] = PIXELS
) -> tuple[NDArray[np.uint32], NDArray[np.int32]]:
    """Return the triangles of a cell and its bins with a corner."""
    index, out = np.full((2, 2), -1, np.int32), np.empty((2, 3), np.uint32)
    return out[: mesh.make_triangles(d, *positions, max_step, index, out)], index


@pytest.mark.parametrize(
    ("missing", "triangles"),
    [
        (None, [[0, 2, 3], [3, 1, 0]]),
        ((0, 0), [[1, 2, 0]]),
        ((1, 0), [[2, 1, 0]]),
        ((1, 1), [[0, 2, 1]]),
        ((0, 1), [[0, 1, 2]]),
    ],
)
def test_triangles_of_a_cell(missing: tuple[int, int] | None, triangles: list[list[int]]) -> None:
    d = np.full((2, 2), 10.0, np.float32)
    if missing is not None:
        d[missing] = 0.0
    found, index = triangles_of(d, 1.0)
    mesh.make_points(d, *PIXELS, 1.0, 0.0, 0.0, 1.0, 1.0, index, np.empty((4, 4), np.float32))
    mesh.number_corners(found, index)
    assert found.tolist() == triangles
    assert (index >= 0).tolist() == (d > 0).tolist()


def test_cells_are_cut_beyond_the_largest_step() -> None:
    d = np.array([[10, 10], [10, 12]], np.float32)
    assert len(triangles_of(d, 2.0)[0]) == 2
    assert len(triangles_of(d, 1.99)[0]) == 0
    assert len(triangles_of(np.array([[10, 0], [0, 10]], np.float32), 2.0)[0]) == 0


def test_no_triangle_of_moved_points_faces_away() -> None:
    """Points of bins lie anywhere in them, as with MIN_DEPTH: the cell is divided where it is not concave."""
    d = np.full((2, 2), 10.0, np.float32)
    u, v = np.array([[0.5, 2.5], [1.5, 2.5]], np.float32), np.array([[1.5, 0.5], [2.5, 2.5]], np.float32)
    found, _ = triangles_of(d, 1.0, (u, v))
    assert len(found) == 2
    v[1, 0], u[1, 0], v[0, 0], u[0, 0] = 2.5, 0.5, 1.9, 1.9  # the upper left point is beyond the other diagonal
    found, _ = triangles_of(d, 1.0, (u, v))
    area = [
        (x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0])
        for x, y in zip(u.reshape(-1)[found], v.reshape(-1)[found], strict=True)
    ]
    assert len(area) == 2
    assert max(area) < 0


def test_dots_move_with_offset_and_rows() -> None:
    depth = np.full((40, 60), 2.0, np.float32)
    open_view = np.full_like(depth, np.inf)
    here = projected_dots(depth, 600.0, 30.0, 20.0, 0.0, open_view)
    # 0.01 m at 2 m and a focal length of 600 pixels are 3 pixels; the camera at +x sees the dots farther left.
    moved = projected_dots(depth, 600.0, 30.0, 20.0, 0.01, open_view)
    assert np.abs(moved[:, :-3].astype(int) - here[:, 3:]).max() <= 1
    lower = projected_dots(depth, 600.0, 30.0, 15.0, 0.0, open_view)
    assert np.abs(lower[:-5].astype(int) - here[5:]).max() <= 1


@pytest.mark.parametrize(("nearer", "lit"), [(1.97, True), (1.95, False)])
def test_shadows_begin_two_percent_nearer(nearer: float, lit: bool) -> None:
    depth = np.full((40, 60), 2.0, np.float32)
    light = projected_dots(depth, 600.0, 30.0, 20.0, 0.0, np.full_like(depth, nearer))
    assert light[:, 1:-1].any() == lit
    assert light[:, [0, -1]].any(), "beside the projector's image"
    hole = np.full_like(depth, 1.0)
    hole[:, 30] = np.inf  # lit through one of three pixels
    lit_columns = np.nonzero(projected_dots(depth, 600.0, 30.0, 20.0, 0.0, hole)[:, 1:-1].any(axis=0))[0] + 1
    assert set(lit_columns) <= {29, 30, 31}
    assert len(lit_columns) >= 2
