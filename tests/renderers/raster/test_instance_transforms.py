"""Instance transforms in the camera frame, and the instances that are drawn."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from renderers.drawlist import DrawList, Instance, Material
from renderers.interface import Output
from renderers.raster import CpuRenderer
from tests.renderers.scenes import camera, draw_list, mesh, pose, sphere

RENDERER = CpuRenderer(1)


def overlapping() -> DrawList:
    """Balls that hide parts of each other, one of them mirrored, and of which the camera is inside one."""
    rng = np.random.default_rng(8)
    instances = []
    for k, (x, z, radius) in enumerate(((-0.4, 3.0, 0.9), (0.1, 2.6, 0.7), (0.5, 3.2, 0.9), (0.0, 0.0, 5.0))):
        X = pose(rng, z=z)
        X[0, 3] = x
        if k == 1:
            X[:, 0] *= -1.0
        instances.append(Instance(sphere(9 + k, 7, radius), Material(), X, k, k))
    return DrawList(tuple(instances))


@pytest.mark.parametrize("select", [(True,) * 4, (False, True, True, False), (True, False, False, True), (False,) * 4])
@pytest.mark.parametrize("cull", [None, (True, False, True, False), (True, True, True, True)])
def test_selected_instances_keep_their_primitive_ids(select: tuple[bool, ...], cull: tuple[bool, ...] | None) -> None:
    """The others are as if they were not in the scene."""
    scene, view = overlapping(), camera()
    first = np.cumsum([0, *(len(instance.mesh.elements) for instance in scene.instances)])
    alone = DrawList(tuple(instance for instance, shown in zip(scene.instances, select, strict=True) if shown))
    masks = [None if mask is None else np.array(mask) for mask in (select, cull)]
    own_cull = None if masks[1] is None else masks[1][np.array(select)]
    seen = RENDERER.visibility(scene, view, select=masks[0], cull_back=masks[1])
    expected = RENDERER.visibility(alone, view, cull_back=own_cull)
    np.testing.assert_array_equal(seen.first_ids, first)
    np.testing.assert_array_equal(seen.ids >= 0, expected.ids >= 0)
    numbers = np.flatnonzero(np.repeat(select, np.diff(first)))
    np.testing.assert_array_equal(seen.ids[seen.ids >= 0], numbers[expected.ids[seen.ids >= 0]])
    np.testing.assert_array_equal(seen.inv_z[seen.ids >= 0], expected.inv_z[seen.ids >= 0])


@pytest.mark.parametrize("mirrored", [False, True])
def test_culled_balls_show_their_fronts(mirrored: bool) -> None:
    """From outside, culling changes nothing; from inside, nothing is left."""
    X = np.diag((-1.0 if mirrored else 1.0, 1.0, 1.0, 1.0))
    for z, shown in ((3.0, True), (0.0, False)):
        X[2, 3] = z
        scene, cull = DrawList((Instance(sphere(12, 9), Material(), X.copy(), 1, 1),)), np.array([True])
        both = RENDERER.visibility(scene, camera())
        fronts = RENDERER.visibility(scene, camera(), cull_back=cull)
        assert (both.ids >= 0).any()
        np.testing.assert_array_equal(fronts.ids, both.ids if shown else np.full_like(both.ids, -1))


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_poses_in_the_camera_frame(seed: int) -> None:
    rng = np.random.default_rng(seed)
    X = np.eye(4)
    X[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0] @ np.diag(rng.uniform(0.1, 10.0, 3))
    X[:3, 3] = rng.uniform(-10.0, 10.0, 3)
    poses = rng.uniform(-10.0, 10.0, (2, 4, 4))
    poses[:, 3] = 0.0, 0.0, 0.0, 1.0
    triangle = mesh(((-1, -1, 2), (1, -1, 2), (0, 1, 2)), ((0, 1, 2),))
    scene = DrawList(tuple(Instance(triangle, Material(), pose) for pose in poses))
    seen = RENDERER.visibility(scene, replace(camera(8, 6), X_world_camera=X))
    np.testing.assert_allclose(seen.X_camera_mesh, np.linalg.inv(X) @ poses, rtol=1e-11, atol=1e-11)


def test_a_flat_pose_sees_nothing() -> None:
    triangle = mesh(((-1, -1, 2), (1, -1, 2), (0, 1, 2)), ((0, 1, 2),))
    flat = replace(camera(), X_world_camera=np.diag((1.0, 1.0, 0.0, 1.0)))
    frame = CpuRenderer(1).render(draw_list(triangle), flat, Output.DEPTH)
    assert frame.depth is not None
    assert not np.isfinite(frame.depth).any()
