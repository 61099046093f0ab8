"""Depth in millimetres, and as seen by a colour camera."""

import numpy as np
import pytest

from renderers.camera import Camera
from renderers.interface import Output, Renderer
from renderers.stereo.depth.metric_depth import align_depth, millimetres_from_disparity
from renderers.stereo.lens.color_camera import ColorCamera
from renderers.stereo.model import Intrinsics
from tests.adapters.stereo.scenes import pose, table

K = Intrinsics(320, 240, 270.0, 160.0, 120.0)
TURNED = (0.999, 0.02, -0.03, 0.01)


def test_millimetres_of_disparities() -> None:
    disparity = np.array([[0, 16, 160, 65535, 1, 19]], np.uint16)
    # 20 px m: 1 pixel is 20 m, 10 pixels are 2 m, 1/16 pixel is 320 m, which 16 bits cannot hold.
    assert millimetres_from_disparity(disparity, 20.0).tolist() == [[0, 20000, 2000, 5, 0, 16842]]


@pytest.mark.parametrize("k", [Intrinsics(640, 360, 450.0, 320.0, 180.0), Intrinsics(200, 150, 170.0, 97.5, 80.0)])
def test_aligned_depth_is_what_the_colour_camera_sees(renderer: Renderer, k: Intrinsics) -> None:
    camera = ColorCamera(k, (0.03, -0.01, 0.02), TURNED)
    left = Camera(K.width, K.height, K.focal_length, K.focal_length, K.cx, K.cy, 0.1, 100.0, pose())
    seen = renderer.render(table(), left, Output.DEPTH)
    expected = renderer.render(table(), camera.camera(pose(), near=0.1, far=100.0), Output.DEPTH)
    depth = np.where(np.isfinite(seen.depth), np.rint(1000 * seen.depth), 0).astype(np.uint16)
    aligned = align_depth(depth, K, camera)
    truth = np.where(np.isfinite(expected.depth), 1000 * expected.depth, 0)
    both = (aligned > 0) & (truth > 0)
    assert both.sum() > 0.75 * (truth > 0).sum(), "the fields of view overlap by about that"
    errors = np.abs(aligned[both].astype(float) - truth[both]) / truth[both]
    assert np.median(errors) < 0.003, "a part of a pixel on slanted surfaces"
    assert np.quantile(errors, 0.95) < 0.02


def test_the_same_camera_sees_the_same_depth() -> None:
    depth = np.random.default_rng(1).integers(0, 5000, (K.height, K.width)).astype(np.uint16)
    assert (align_depth(depth, K, ColorCamera(K, (0.0, 0.0, 0.0))) == depth).mean() > 0.99


def test_a_finer_image_has_no_cracks() -> None:
    depth = np.tile(np.linspace(800, 1600, K.width).astype(np.uint16), (K.height, 1))
    fine = Intrinsics(900, 600, 700.0, 450.0, 300.0)
    aligned = align_depth(depth, K, ColorCamera(fine, (0.02, 0.0, 0.0)))
    assert (aligned[50:-50, 100:-100] > 0).all()


@pytest.mark.parametrize("position", [(0.0, 0.0, 1.0), (0.0, 0.0, 0.9999), (50.0, 0.0, 0.0), (0.0, 0.0, 60.0)])
def test_points_at_or_behind_the_colour_camera_are_left_out(position: tuple[float, float, float]) -> None:
    depth = np.full((K.height, K.width), 1000, np.uint16)
    assert not align_depth(depth, K, ColorCamera(K, position)).any()


def test_depth_beyond_16_bits_is_left_out() -> None:
    depth = np.full((8, 8), 65000, np.uint16)
    k = Intrinsics(8, 8, 8.0, 4.0, 4.0)
    assert not align_depth(depth, k, ColorCamera(k, (0.0, 0.0, -1.0))).any()
    assert align_depth(depth, k, ColorCamera(k, (0.0, 0.0, -0.5))).max() == 65500
