"""Previews of image sets."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenegate.camera import image_interface_pb2 as pb
from scenegate.camera.files import disparity_to_rgb, intrinsics, points, preview, save

BLUE, RED, BLACK = (48, 18, 59), (122, 4, 3), (0, 0, 0)
"""Ends of the colour scale, and invalid pixels."""


def message(pixels: NDArray[Any]) -> pb.Image:
    encoding = {("u", 1): "mono8", ("u", 2): "mono16"}[pixels.dtype.kind, pixels.dtype.itemsize]
    encoding = "rgb8" if pixels.ndim == 3 else encoding
    height, width = pixels.shape[:2]
    data = pixels.tobytes()
    return pb.Image(width=width, height=height, encoding=encoding, step=len(data) // height, data=data)


def test_cells_are_side_by_side_in_order() -> None:
    left = np.array([[10, 20], [30, 40], [50, 60]], np.uint8)
    right = np.arange(6, dtype=np.uint8).reshape(1, 2, 3)
    confidence = np.array([[255]], np.uint8)
    image_set = pb.ImageSet(confidence=message(confidence), right=message(right), left=message(left))
    shown = preview(image_set)
    assert shown.shape == (3, 2 + 4 + 2 + 4 + 1, 3)
    assert (shown[:, :2] == left[:, :, None]).all()
    assert (shown[:1, 6:8] == right).all()
    assert shown[0, 12].tolist() == [255, 255, 255]
    for background in (shown[:, 2:6], shown[1:, 6:8], shown[:, 8:12], shown[1:, 12:]):
        assert not background.any()


def test_points_are_those_of_the_disparity_with_colours_of_the_left_image() -> None:
    stored = np.array([[0, 64, 32], [16, 0, 8]], np.uint16)
    image = message(stored)
    image.focal_length, image.principal_point_u, image.principal_point_v = 3.0, 1.5, 1.0
    disparity = pb.DisparityImage(image=image, scale=1 / 16, baseline=0.5)
    left = np.arange(4 * 6 * 3, dtype=np.uint8).reshape(4, 6, 3)
    found = points(pb.ImageSet(disparity=disparity, left=message(left)))
    assert (found.mask == (stored > 0)).all()
    z = 3.0 * 0.5 / (stored[stored > 0] / 16)
    rows, columns = np.nonzero(stored)
    expected = np.stack(((columns + 0.5 - 1.5) * z / 3, (rows + 0.5 - 1.0) * z / 3, z), axis=1)
    np.testing.assert_allclose(found.xyz, expected, rtol=1e-6)
    assert found.rgb is not None
    np.testing.assert_array_equal(found.rgb, left[2 * rows + 1, 2 * columns + 1])
    alone = points(disparity)
    assert alone.rgb is None
    np.testing.assert_array_equal(alone.xyz, found.xyz)
    assert intrinsics(image)[:2, 2].tolist() == [1.5, 1.0]
    assert intrinsics(image, opencv=True)[:2, 2].tolist() == [1.0, 0.5]


def test_the_folder_may_be_a_text(tmp_path: Path) -> None:
    save(pb.ImageSet(left=message(np.zeros((2, 3), np.uint8))), str(tmp_path))
    assert sorted(file.suffix for file in tmp_path.iterdir()) == [".npz", ".png"]


def test_large_images_are_downscaled_to_the_cell() -> None:
    wide, high = np.full((480, 1280), 7, np.uint8), np.full((960, 640), 9, np.uint8)
    assert preview(pb.ImageSet(left=message(wide))).shape == (240, 640, 3)
    assert preview(pb.ImageSet(left=message(high))).shape == (480, 320, 3)
    exact = np.arange(480 * 640, dtype=np.uint32).astype(np.uint8).reshape(480, 640)
    assert (preview(pb.ImageSet(left=message(exact)))[:, :, 0] == exact).all()
    stripes = np.tile(np.array([0, 100], np.uint8), (2, 640))
    assert (preview(pb.ImageSet(left=message(stripes))) == 50).all()


def test_errors_are_white_from_half_a_pixel() -> None:
    error = np.array([[0, 1, 4, 8, 200]], np.uint8)
    disparity = pb.DisparityImage(image=message(np.ones((1, 1), np.uint16)), scale=1 / 16)
    shown = preview(pb.ImageSet(disparity=disparity, disparity_error=message(error)))
    assert shown[0, 5:, 1].tolist() == [0, 32, 128, 255, 255]
    finer = pb.DisparityImage(image=message(np.ones((1, 1), np.uint16)), scale=1 / 256)
    shown = preview(pb.ImageSet(disparity=finer, disparity_error=message(error)))
    assert shown[0, 5:, 0].tolist() == [0, 2, 8, 16, 255]


def test_colours_of_disparities() -> None:
    disparity = np.array([[0, 100, 200], [300, 0, 100]], np.uint16)
    colors = disparity_to_rgb(disparity)
    assert [tuple(c) for c in colors.reshape(-1, 3)[[0, 1, 3, 4, 5]].tolist()] == [BLACK, BLUE, RED, BLACK, BLUE]
    middle = colors[0, 2].tolist()
    assert middle[1] > 200, "green"
    shown = preview(pb.ImageSet(disparity=pb.DisparityImage(image=message(disparity))))
    assert (shown == colors).all()


def test_colours_of_invalid_and_constant_disparities() -> None:
    assert not disparity_to_rgb(np.zeros((2, 2), np.uint16)).any()
    assert disparity_to_rgb(np.full((1, 2), 5, np.uint16)).tolist() == [[list(BLUE)] * 2]
