"""Values exactly at their limits, and limits of the second of two components."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.adapters.stereo.imaging.recorded_pairs import RecordedPairs
from renderers.drawlist import ImageError
from renderers.encode import png_gray8
from renderers.stereo.depth.depth_images import DepthImages
from renderers.stereo.depth.filters import Filters, apply_filters
from renderers.stereo.mesh.disparity_mesh import MeshOptions, disparity_mesh
from renderers.stereo.model import Intrinsics


def images(disparity: NDArray[np.uint16]) -> DepthImages:
    valid = disparity > 0
    return DepthImages(disparity.copy(), valid.astype(np.uint8), np.where(valid, 255, 0).astype(np.uint8))


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


def test_pairs_repeat_and_are_limited_in_pixels(tmp_path: Path) -> None:
    files = [tmp_path / f"{value}.png" for value in (1, 2, 3, 4)]
    for value, file in enumerate(files, 1):
        file.write_bytes(png_gray8(np.full((16, 16), value, np.uint8)))
    pairs = RecordedPairs([(files[0], files[1]), (files[2], files[3])], 0.8, 0.1, 256)
    views = itertools.product((0, 1, 2), (False, True))
    assert [pairs.image(number, right=right)[0, 0, 0] for number, right in views] == [1, 2, 3, 4, 1, 2]
    with pytest.raises(ImageError, match="16x16 pixels are more than the limit of 255"):
        RecordedPairs([(files[0], files[1])], 0.8, 0.1, 255)
