"""Instance transforms in the camera frame, and the list of draws."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.interface import Output
from renderers.raster import CpuRenderer, instance_transforms
from renderers.raster.layout import DRAW, FRAME, INSTANCE, frame_at
from renderers.raster.scene import NOT_CONVEX
from tests.renderers.scenes import camera, draw_list, mesh


@njit(error_model="numpy")
def compute_camera_poses(frame_address):
    return instance_transforms.compute_camera_poses(frame_at(frame_address))


@njit(error_model="numpy")
def collect_draws(frame_address):
    return instance_transforms.collect_draws(frame_at(frame_address))


POSES = np.stack((np.eye(4), np.diag((-1.0, 1.0, 1.0, 1.0)), np.eye(4)))
POSES[:, 2, 3] = 3.0
SIZES = (1.0, 2.0, 3.0)
BOXES = np.array(((0.0, 0.0, 0.0, 1.0, 1.0, 3.0), NOT_CONVEX, (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)))
CAMERA = {"fx": 100.0, "fy": 100.0, "cx": 50.0, "cy": 50.0, "near": 0.1, "far": 10.0}
FIRST_VERTEX, FIRST_PRIMITIVE, POSITIONS = (0, 3, 7, 12), (0, 2, 5, 9), (100, 200, 300, 0)


def camera_poses(camera_pose: NDArray[np.float64], poses: NDArray[np.float64]) -> NDArray[np.float64] | None:
    out = np.full(poses.shape, 7.0)
    frame = np.zeros(1, FRAME.dtype)
    frame["instance_count"], frame["X_world_camera"] = len(poses), camera_pose.ravel()
    frame["X_world_mesh"], frame["X_camera_mesh"] = poses.ctypes.data, out.ctypes.data
    if not compute_camera_poses(frame.ctypes.data):
        assert (out == 7.0).all()
        return None
    return out


def draws(select: Any = None, cull: Any = None) -> tuple[int, list[int], NDArray[np.void]]:
    """Return the result of ``collect_draws``, the counts, and the draws."""
    instances = np.zeros(4, INSTANCE.dtype)
    instances["first_vertex"], instances["first_primitive"] = FIRST_VERTEX, FIRST_PRIMITIVE
    instances["positions"] = POSITIONS
    instances["size"][:3], instances["box_center"][:3], instances["box_half"][:3] = SIZES, BOXES[:, :3], BOXES[:, 3:]
    out, frame = np.zeros(4, DRAW.dtype), np.zeros(1, FRAME.dtype)
    for field, value in CAMERA.items():
        frame[field] = value
    masks = [None if mask is None else np.array(mask, np.bool_) for mask in (select, cull)]
    frame["select"], frame["cull_back"] = [0 if mask is None else mask.ctypes.data for mask in masks]
    frame["instance_count"], frame["skip_hidden_back_faces"] = 3, 1
    frame["instances"], frame["draws"] = instances.ctypes.data, out.ctypes.data
    frame["X_camera_mesh"] = POSES.ctypes.data
    culling = collect_draws(frame.ctypes.data)
    return culling, [int(frame[0][f"{each}_count"]) for each in ("vertex", "primitive", "draw")], out


def test_all_are_drawn() -> None:
    culling, counts, table = draws(cull=(True, True, False))
    assert culling == 2
    assert counts == [12, 9, 3]
    assert table["culled_sign"].tolist() == [1, -1, 0, 0]  # the second one is mirrored
    assert table["hidden_sign"].tolist() == [0, 0, 1, 0]  # the third one's box lies in front of the camera
    assert tuple(table["first_vertex"]) == FIRST_VERTEX
    assert tuple(table["first_primitive"]) == FIRST_PRIMITIVE
    np.testing.assert_array_equal(table["X_camera_mesh"][:3], POSES.reshape(3, 16)[:, :12])
    np.testing.assert_array_equal(table["size"][:3], SIZES)


def test_selected_instances_keep_their_primitive_ids() -> None:
    culling, counts, table = draws(select=(False, True, True), cull=(True, True, True))
    assert culling == 1
    assert counts == [9, 7, 2]
    assert table["first_vertex"][:3].tolist() == [0, 4, 9]
    assert table["first_primitive"][:3].tolist() == [0, 3, 7]
    assert table["first_id"][:2].tolist() == [2, 5]
    assert table["positions"][:2].tolist() == [200, 300]
    assert table["size"][:2].tolist() == [2.0, 3.0]


def test_no_instance_is_selected() -> None:
    culling, counts, table = draws(select=(False, False, False))
    assert (culling, counts) == (0, [0, 0, 0])
    assert (table["first_vertex"][0], table["first_primitive"][0]) == (0, 0)


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_poses_in_the_camera_frame(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = np.eye(4)
    pose[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0] @ np.diag(rng.uniform(0.1, 10.0, 3))
    pose[:3, 3] = rng.uniform(-10.0, 10.0, 3)
    points = rng.uniform(-10.0, 10.0, (2, 4, 4))
    seen = camera_poses(pose, points)
    assert seen is not None
    np.testing.assert_allclose(seen, np.linalg.inv(pose) @ points, rtol=1e-11, atol=1e-11)


def test_flat_and_projective_camera_poses_are_not_inverted() -> None:
    flat, projective = np.diag((1.0, 1.0, 0.0, 1.0)), np.eye(4)
    projective[3, 0] = 0.1
    assert camera_poses(flat, POSES) is None
    assert camera_poses(projective, POSES) is None


def test_camera_pose_with_homogeneous_scale() -> None:
    scene = draw_list(mesh(((-1, -1, 2), (1, -1, 2), (0, 1, 2)), ((0, 1, 2),)))
    plain = camera()
    pose = plain.X_world_camera * 2.0  # the same but for the scale of homogeneous coordinates, which halves depths
    scaled = Camera(plain.width, plain.height, plain.fx, plain.fy, plain.cx, plain.cy, plain.near / 2, plain.far, pose)
    renderer = CpuRenderer(1)
    with renderer.render(scene, plain, Output.DEPTH) as frame, renderer.render(scene, scaled, Output.DEPTH) as other:
        assert frame.depth is not None
        assert other.depth is not None
        assert np.isfinite(frame.depth).any()
        np.testing.assert_allclose(other.depth, frame.depth / 2, rtol=1e-6)


def test_a_flat_pose_raises() -> None:
    plain = camera()
    pose = plain.X_world_camera @ np.diag((1.0, 1.0, 0.0, 1.0))
    flat = Camera(plain.width, plain.height, plain.fx, plain.fy, plain.cx, plain.cy, plain.near, plain.far, pose)
    with pytest.raises(np.linalg.LinAlgError, match="Singular"):
        CpuRenderer(1).render(draw_list(), flat, Output.DEPTH)
