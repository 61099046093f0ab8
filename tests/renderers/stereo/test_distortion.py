"""Images before rectification."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.scene.draw.flatten import flatten
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.nodes import Node, TreeEdit
from gateway.scene.tree.transforms import look_at, translation
from renderers.camera import Camera
from renderers.drawlist import DrawList, Material
from renderers.interface import Look, Output, Renderer
from renderers.stereo.lens.distortion import Distortion, check_distortion, distorted_image, raw_pose
from renderers.stereo.model import Intrinsics
from scenegate.messages.geometry import Box

K = Intrinsics(480, 360, 400.0, 243.0, 177.0)
LENS = Distortion((-0.12, 0.05, 0.001, -0.0008, 0.0), (0.004, -0.01, 0.006))
SQUARE, COLUMNS, ROWS = 0.05, 9, 7
"""Chessboard of 8 x 6 inner corners."""


def chessboard() -> DrawList:
    edit = TreeEdit(Node())
    size = (SQUARE * (COLUMNS + 2), SQUARE * (ROWS + 2), 0.01)
    parts = [Part(Box(size), Material((1.0, 1.0, 1.0, 1.0)), translation(0, 0, -0.005))]
    for column in range(COLUMNS):
        for row in range(column % 2, ROWS, 2):
            x, y = (column - (COLUMNS - 1) / 2) * SQUARE, (row - (ROWS - 1) / 2) * SQUARE
            parts.append(Part(Box((SQUARE, SQUARE, 0.0002)), Material((0.0, 0.0, 0.0, 1.0)), translation(x, y, 0.0)))
    edit.set_parts(("board",), tuple(parts))
    return flatten(edit.commit())


def photograph(renderer: Renderer, scene: DrawList, pose: NDArray[np.float64], lens: Distortion) -> NDArray[np.uint8]:
    def render(camera: Camera) -> NDArray[np.uint8]:
        frame = renderer.render(scene, camera, Output.COLOR, Look("plain", (90, 90, 90)))
        assert frame.color is not None
        return frame.color.copy()

    camera = Camera(K.width, K.height, K.focal_length, K.focal_length, K.cx, K.cy, 0.01, 100.0, pose)
    return distorted_image(render, camera, K, lens)


def test_a_lens_without_distortion_is_the_pinhole(renderer: Renderer) -> None:
    pose, scene = look_at((0.1, -0.4, 0.5), (0, 0, 0), (0, 1, 0)), chessboard()
    camera = Camera(K.width, K.height, K.focal_length, K.focal_length, K.cx, K.cy, 0.01, 100.0, pose)
    frame = renderer.render(scene, camera, Output.COLOR, Look("plain", (90, 90, 90)))
    assert frame.color is not None
    assert (photograph(renderer, scene, pose, Distortion()) == frame.color).mean() > 0.999


def test_opencv_estimates_the_lens_from_pictures_of_a_chessboard(renderer: Renderer) -> None:
    scene = chessboard()
    eyes = [(x, y, z) for x in (-0.2, 0.0, 0.2) for y in (-0.2, 0.05, 0.2) for z in (0.42, 0.55)]
    targets = [(0.5 * y, -0.3 * x, 0.0) for x, y, _ in eyes]
    inner = (COLUMNS - 1, ROWS - 1)
    grid = np.zeros((inner[0] * inner[1], 3), np.float32)
    grid[:, :2] = np.mgrid[: inner[0], : inner[1]].T.reshape(-1, 2) * SQUARE
    corners = []
    for eye, target in zip(eyes, targets, strict=True):
        image = photograph(renderer, scene, look_at(eye, target, (0, 1, 0)), LENS)
        found, points = cv2.findChessboardCornersSB(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), inner)
        if found:
            corners.append(points)
    assert len(corners) >= 10
    error, matrix, coefficients, _, _ = cv2.calibrateCamera(
        [grid] * len(corners), corners, (K.width, K.height), np.eye(3), np.zeros(5), flags=cv2.CALIB_FIX_K3
    )
    assert error < 0.25, "pixels; edges are not smoothed"
    assert matrix[0, 0] == pytest.approx(K.focal_length, rel=0.005)
    assert (matrix[0, 2] + 0.5, matrix[1, 2] + 0.5) == pytest.approx((K.cx, K.cy), abs=1.0)
    estimated = coefficients.ravel()
    assert estimated[0] == pytest.approx(LENS.coefficients[0], abs=0.02)
    assert estimated[2:4] == pytest.approx(LENS.coefficients[2:4], abs=0.001)


def test_the_right_camera_is_turned_about_its_centre() -> None:
    pose = look_at((1.0, 2.0, 3.0), (0, 0, 0), (0, 0, 1))
    assert (raw_pose(pose, LENS, right=False) == pose).all()
    turned = raw_pose(pose, LENS, right=True)
    assert (turned[:3, 3] == pose[:3, 3]).all()
    assert cv2.Rodrigues(pose[:3, :3].T @ turned[:3, :3])[0].ravel() == pytest.approx(LENS.right_rotation)


@pytest.mark.parametrize(
    ("coefficients", "message"),
    [
        ((-3.0, 0.0, 0.0, 0.0, 0.0), "no inverse inside the image"),
        ((0.0, 0.0, 0.0, 0.0, -100.0), "no inverse inside the image"),
        ((0.0, 0.0, 50.0, -50.0, 0.0), "no inverse inside the image|more than 2 times"),
    ],
)
def test_lenses_without_an_inverse_are_refused(
    coefficients: tuple[float, float, float, float, float], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        check_distortion(Distortion(coefficients), K)
