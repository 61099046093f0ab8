"""Where instances are in the camera's frame, and which of them are drawn."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.compiler.jit import kernel
from renderers.interface import Output
from renderers.raster import CpuRenderer, instance_transforms
from renderers.raster.layout import (
    J_COLUMNS,
    J_ELEMENTS,
    J_INSTANCES,
    J_LENGTHS,
    J_LENS,
    J_TABLE,
    J_VERTICES,
    M_COLUMNS,
    M_SIZE,
    T_COLUMNS,
    T_CULL,
    T_ELEMENT,
    T_HIDDEN,
    T_POSITIONS,
    T_RECORD,
    T_VERTEX,
)
from renderers.raster.scene import NOT_SOLID
from tests.renderers.scenes import camera, draw_list, mesh


@kernel("int64(int64, int64, int64, int64)")
def look_from(pose_at, points_at, meshes_at, count):
    return instance_transforms.look_from(pose_at, points_at, meshes_at, count)


@kernel("int64(int64, int64, int64, int64, int64, int64, int64, int64)")
def place(job_at, known_at, meshes_at, sizes_at, bounds_at, select_at, cull_at, count):
    return instance_transforms.place(job_at, known_at, meshes_at, sizes_at, bounds_at, select_at, cull_at, count)


POINTS = np.stack((np.eye(4), np.diag((-1.0, 1.0, 1.0, 1.0)), np.eye(4)))
POINTS[:, 2, 3] = 3.0
SIZES = np.array((1.0, 2.0, 3.0))
BOUNDS = np.array(((0.0, 0.0, 0.0, 1.0, 1.0, 3.0), NOT_SOLID, (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)))
LENS = np.array((100.0, 100.0, 50.0, 50.0, 0.1, 10.0))
FIRST = {T_VERTEX: (0, 3, 7, 12), T_ELEMENT: (0, 2, 5, 9), T_RECORD: (0, 2, 5, 9), T_POSITIONS: (100, 200, 300, 0)}


def looked(camera_pose: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64] | None:
    out = np.full(points.shape, 7.0)
    if look_from(camera_pose.ctypes.data, points.ctypes.data, out.ctypes.data, len(points)) == 0:
        assert (out == 7.0).all()
        return None
    return out


def placed(select: Any = None, cull: Any = None) -> tuple[int, list[int], NDArray[np.int64], NDArray[np.float64]]:
    """What ``place`` returns, the counts, the table and the matrices."""
    known = np.zeros((4, T_COLUMNS), np.int64)
    for column, values in FIRST.items():
        known[:, column] = values
    table, lengths, job = np.full((4, T_COLUMNS), -7), np.zeros((3, M_COLUMNS)), np.zeros(J_COLUMNS, np.int64)
    job[[J_TABLE, J_LENGTHS, J_LENS]] = table.ctypes.data, lengths.ctypes.data, LENS.ctypes.data
    masks = [None if mask is None else np.array(mask, np.bool_) for mask in (select, cull)]
    apart = place(
        job.ctypes.data,
        *(a.ctypes.data for a in (known, POINTS, SIZES, BOUNDS)),
        *(0 if mask is None else mask.ctypes.data for mask in masks),
        3,
    )
    return apart, job[[J_VERTICES, J_ELEMENTS, J_INSTANCES]].tolist(), table, lengths


def test_all_are_drawn() -> None:
    apart, counts, table, lengths = placed(cull=(True, True, False))
    assert apart == 2
    assert counts == [12, 9, 3]
    assert table[:, T_CULL].tolist() == [1, -1, 0, 0]  # the second one is mirrored
    assert table[:, T_HIDDEN].tolist() == [0, 0, 1, 0]  # the third one's box lies in front of the camera
    for column in (T_VERTEX, T_ELEMENT):
        assert tuple(table[:, column]) == FIRST[column]
    np.testing.assert_array_equal(lengths[:, :M_SIZE], POINTS.reshape(3, 16)[:, :12])
    np.testing.assert_array_equal(lengths[:, M_SIZE], SIZES)


def test_some_are_drawn_and_their_records_keep_their_numbers() -> None:
    apart, counts, table, lengths = placed(select=(False, True, True), cull=(True, True, True))
    assert apart == 1
    assert counts == [9, 7, 2]
    assert table[:3, T_VERTEX].tolist() == [0, 4, 9]
    assert table[:3, T_ELEMENT].tolist() == [0, 3, 7]
    assert table[:2, T_RECORD].tolist() == [2, 5]
    assert table[:2, T_POSITIONS].tolist() == [200, 300]
    assert lengths[:2, M_SIZE].tolist() == [2.0, 3.0]


def test_nobody_is_drawn() -> None:
    apart, counts, table, _ = placed(select=(False, False, False))
    assert (apart, counts) == (0, [0, 0, 0])
    assert (table[0] == 0).all()


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_pose_seen_from_another(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = np.eye(4)
    pose[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0] @ np.diag(rng.uniform(0.1, 10.0, 3))
    pose[:3, 3] = rng.uniform(-10.0, 10.0, 3)
    points = rng.uniform(-10.0, 10.0, (2, 4, 4))
    seen = looked(pose, points)
    assert seen is not None
    np.testing.assert_allclose(seen, np.linalg.inv(pose) @ points, rtol=1e-11, atol=1e-11)


def test_poses_that_are_not_affine_or_flat_are_left_to_the_caller() -> None:
    flat, projective = np.diag((1.0, 1.0, 0.0, 1.0)), np.eye(4)
    projective[3, 0] = 0.1
    assert looked(flat, POINTS) is None
    assert looked(projective, POINTS) is None


def test_a_camera_whose_pose_is_not_affine_sees_as_its_inverse_says() -> None:
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
