"""The camera of a request: its near plane, and the rigid part of its node's transform."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gateway.adapters.render.errors import RequestError
from gateway.adapters.render.pipeline import camera_of, rigid_pose
from gateway.adapters.render.request import RenderRequest
from gateway.adapters.render.scenes import PreparedScene
from gateway.files.gltf import PlacedCamera
from gateway.scene.tree.transforms import from_pose
from renderers.drawlist import DrawList

POSE = from_pose((1, -2, 3), (0.5, 0.5, -0.5, 0.5))
REQUEST = RenderRequest("color", 64, 48, 100.0, 90.0, 32.0, 20.0, 0.1, 10.0, 0.0, math.inf, b"")


def scene(X: Any = POSE, znear: float = 0.02) -> PreparedScene:
    camera = PlacedCamera(0, "head", X, 1.0, znear, None)
    return PreparedScene(camera, True, "VTK", 1, (), 0, DrawList(), 0)


def test_intrinsics_come_from_the_form_and_the_pose_from_the_scene() -> None:
    camera = camera_of(REQUEST, scene())
    assert (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy) == (64, 48, 100, 90, 32, 20)
    assert (camera.near, camera.far) == (0.1, 10.0)
    np.testing.assert_array_equal(camera.X_world_camera, POSE)


@pytest.mark.parametrize(("znear", "near"), [(0.02, 0.02), (0.0, 1e-5), (10.0, 1e-5), (-1.0, 1e-5), (1e-12, 1e-9)])
def test_a_near_plane_of_zero_is_replaced_by_the_scenes(znear: float, near: float) -> None:
    assert camera_of(replace(REQUEST, near=0.0), scene(znear=znear)).near == pytest.approx(near)


def test_geometry_without_a_camera_is_an_error_and_an_empty_scene_is_not() -> None:
    empty = replace(scene(), camera=None, has_geometry=False)
    np.testing.assert_array_equal(camera_of(REQUEST, empty).X_world_camera, np.diag((1.0, -1.0, -1.0, 1.0)))
    assert camera_of(replace(REQUEST, near=0.0), empty).near == pytest.approx(1e-5)  # a millionth of the far plane
    with pytest.raises(RequestError, match="geometry but no camera"):
        camera_of(REQUEST, replace(empty, has_geometry=True))


@pytest.mark.parametrize("shear", [0.5, -2.0])
@pytest.mark.parametrize("axes", [(0, 1), (1, 2), (2, 1), (0, 2), (1, 0), (2, 0)])
def test_a_sheared_pose_keeps_line_of_sight_and_position(shear: float, axes: tuple[int, int]) -> None:
    sheared = np.eye(4)
    sheared[axes] = shear
    X = POSE @ sheared
    pose = rigid_pose(X, "head")
    rotation = pose[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(rotation[:, 2], X[:3, 2] / np.linalg.norm(X[:3, 2]), atol=1e-12)
    assert rotation[:, 1] @ X[:3, 1] > 0.0  # down stays on the same side
    np.testing.assert_array_equal(pose[:3, 3], X[:3, 3])


@pytest.mark.parametrize("scales", [(2, 3, 4), (1, -1, 1), (-1, 1, 1), (1e-100, 1, 1)])
def test_scaled_and_mirrored_poses_become_rigid(scales: tuple[float, float, float]) -> None:
    pose = camera_of(REQUEST, scene(POSE @ np.diag((*scales, 1.0)))).X_world_camera
    np.testing.assert_array_equal(pose[:3, 3], POSE[:3, 3])
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_largest_distance_is_accepted_and_a_larger_one_is_not(axis: int, sign: float) -> None:
    X = np.eye(4)
    X[axis, 3] = sign * 1e12
    assert rigid_pose(X, "head") is X
    for value in (1.001e12, 1e13, math.inf, math.nan):
        X[axis, 3] = sign * value
        with pytest.raises(RequestError, match="'head' is farther than 1e\\+12 m away"):
            rigid_pose(X, "head")


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e300])
@pytest.mark.parametrize("at", [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (3, 0)])
def test_poses_that_are_not_finite_or_singular_are_refused(value: float, at: tuple[int, int]) -> None:
    X = np.eye(4)
    X[at] = value
    if value == 1e300 and at in ((0, 0), (0, 1), (3, 0)):
        return  # the line of sight and down are finite
    with pytest.raises(RequestError, match="is singular"):
        rigid_pose(X, "head")


def test_a_down_axis_along_the_line_of_sight_is_singular() -> None:
    X = np.eye(4)
    X[:3, 1] = X[:3, 2]
    with pytest.raises(RequestError, match="is singular"):
        rigid_pose(X, "head")
