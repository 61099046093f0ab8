"""Values exactly at their limits, and limits of the second of two components."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.adapters.stereo.imaging.recorded_pairs import RecordedPairs
from renderers.drawlist import ImageError
from renderers.encode import png_gray8
from renderers.stereo.depth.depth_images import DepthImages, DepthRange, true_disparity
from renderers.stereo.depth.filters import Filters, apply_filters
from renderers.stereo.mesh.disparity_mesh import MeshOptions, disparity_mesh, smallest_bin_size
from renderers.stereo.model import Intrinsics


def depth(*rows: list[float]) -> NDArray[np.float32]:
    return np.array(rows, np.float32)


def images(disparity: NDArray[np.uint16]) -> DepthImages:
    valid = disparity > 0
    return DepthImages(disparity.copy(), valid.astype(np.uint8), np.where(valid, 255, 0).astype(np.uint8))


def test_the_depth_range_includes_its_limits() -> None:
    z = depth([0.999, 1.0, 2.0, 2.001])
    d = true_disparity(z, np.full_like(z, np.inf), 0.5, DepthRange(1.0, 2.0))
    assert d[0].tolist() == [0.0, 0.5, 0.25, 0.0]


def test_points_left_of_the_right_image_are_not_measured() -> None:
    z = depth([1.0, 1.0, 1.0])
    past = np.full_like(z, np.inf)
    assert true_disparity(z, past, 0.5, DepthRange(0.1, 10))[0].tolist() == [0.5, 0.5, 0.5]
    assert true_disparity(z, past, 0.75, DepthRange(0.1, 10))[0].tolist() == [0.0, 0.75, 0.75]
    assert true_disparity(z, past, 2.0, DepthRange(0.1, 10))[0].tolist() == [0.0, 0.0, 2.0]


def test_points_are_occluded_beyond_one_pixel_of_disparity() -> None:
    """Disparity 1 at depth 4; what the right camera sees at depth 2 has disparity 2, at depth 1.9 more than 2."""
    z = depth([4.0, 4.0, 4.0], [4.0, 4.0, 4.0])
    limits = DepthRange(0.1, 10)
    assert true_disparity(z, np.full_like(z, 2.0), 4.0, limits)[:, 1:].tolist() == [[1.0, 1.0]] * 2
    assert not true_disparity(z, np.full_like(z, 1.9), 4.0, limits).any()
    lower = np.vstack((np.full(3, 1.9), np.full(3, 2.0))).astype(np.float32)
    assert true_disparity(z, lower, 4.0, limits).any(axis=1).tolist() == [False, True]


@pytest.mark.parametrize(("step", "filled"), [(32, True), (33, False)])
def test_holes_are_filled_up_to_exactly_the_step(step: int, filled: bool) -> None:
    d = np.full((20, 20), 800, np.uint16)
    d[:, 10:] = 800 + step
    d[9:11, 8:12] = 0
    result = images(d)
    apply_filters(result, Filters(seg=0, fill=2), 88.0, 2)
    assert result.disparity.all() == filled


@pytest.mark.parametrize(("pixels", "filled"), [(20, True), (21, False)])
def test_exactly_five_percent_are_filled(pixels: int, filled: bool) -> None:
    d = np.full((20, 20), 800, np.uint16)
    d.reshape(-1)[[20 * (1 + k // 7) + 1 + k % 7 for k in range(pixels)]] = 0
    result = images(d)
    apply_filters(result, Filters(seg=0), 88.0, 2)
    assert result.disparity.all() == filled


@pytest.mark.parametrize(("step", "kept"), [(32, True), (33, False)])
def test_segments_are_connected_up_to_two_pixels(step: int, kept: bool) -> None:
    d = np.full((20, 20), 800, np.uint16)
    d[:4] += step
    result = images(d)
    apply_filters(result, Filters(seg=81, fill=0), 88.0, 2)
    assert result.disparity[:4].all() == kept
    assert result.disparity[4:].all()


@pytest.mark.parametrize(("step", "count", "triangles"), [(32, 9, 8), (33, 6, 4)])
def test_cells_are_connected_up_to_two_pixels(step: int, count: int, triangles: int) -> None:
    d = np.full((3, 3), 800, np.uint16)
    d[2] += step
    k = Intrinsics(3, 3, 10.0, 1.5, 1.5)
    header, vertices, faces = disparity_mesh(d, k, 0.1, MeshOptions())
    assert f"element vertex {count}\n".encode() in header
    assert len(vertices) == count * 16
    assert len(faces) == triangles * 13


@pytest.mark.parametrize(
    ("size", "max_points", "n"), [((6, 4), 24, 1), ((6, 4), 23, 2), ((6, 4), 6, 2), ((6, 4), 5, 3), ((5, 7), 12, 2)]
)
def test_bins_meet_the_number_of_points(size: tuple[int, int], max_points: int, n: int) -> None:
    assert smallest_bin_size(*size, max_points) == n


def test_pairs_repeat_and_are_limited_in_pixels(tmp_path: Path) -> None:
    files = [tmp_path / f"{value}.png" for value in (1, 2, 3, 4)]
    for value, file in enumerate(files, 1):
        file.write_bytes(png_gray8(np.full((16, 16), value, np.uint8)))
    pairs = RecordedPairs([(files[0], files[1]), (files[2], files[3])], 0.8, 0.1, 256)
    views = itertools.product((0, 1, 2), (False, True))
    assert [pairs.image(number, right=right)[0, 0, 0] for number, right in views] == [1, 2, 3, 4, 1, 2]
    with pytest.raises(ImageError, match="16x16 pixels are more than the limit of 255"):
        RecordedPairs([(files[0], files[1])], 0.8, 0.1, 255)
