"""Drops objects on surfaces with the package ``mujoco``, as convex hulls, until they are at rest."""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.datasets.scenario.models import Body
from gateway.datasets.scenario.placement import CollisionSolid
from gateway.datasets.scenario.tables import ScenarioError
from gateway.scene.tree.transforms import from_pose, quaternions_of
from renderers.stop import check_stop

TIMESTEP: Final = 0.002
MARGIN: Final = 0.0004
"""Distance at which contacts begin to push, metres. Contacts are soft: without it, objects would sink in by that."""
STIFFNESS: Final = (0.005, 1.0)
"""MuJoCo's ``solref``: time constant in seconds, at least two steps, and damping ratio."""
FRICTION: Final = (0.8, 0.02, 0.005)
"""Sliding, torsional and rolling friction. With the last one, balls come to rest."""
MIN_THICKNESS: Final = 0.001
"""Thickness to which flat bodies are raised, metres: MuJoCo makes no hull of points in a plane."""
CHECK_STEPS: Final = 100
"""Steps between two checks, 0.2 s."""
REST_CHECKS: Final = 2
"""Consecutive checks in which an object must have been at rest."""
REST_METRES, REST_QUATERNION = 2e-4, 2e-3
"""Motion between two checks of an object at rest: of its position, and of its unit quaternion. Speeds do not tell:
objects on several others tremble about their places."""


def settle(
    objects: list[tuple[CollisionSolid, NDArray[np.float64]]], obstacles: list[CollisionSolid], seconds: float
) -> list[NDArray[np.float64] | None]:
    """Return the poses of objects at rest; None for those that still move at the end.

    Each object is in its own frame, scaled, with its first pose; the obstacles do not move. Raises ScenarioError if the
    package is missing, or cannot simulate them.
    """
    try:
        import mujoco
    except ImportError as error:
        raise ScenarioError(
            f"placement.physics: 'mujoco' needs the package mujoco ({error}): pip install 'scenegate[robots]'"
        ) from None
    mujoco.set_mju_user_warning(lambda _: None)  # it would write them to a file; unstable objects are not at rest
    try:
        model = _model(mujoco, objects, obstacles)
    except (ValueError, mujoco.FatalError) as error:
        raise ScenarioError(f"placement.physics: MuJoCo cannot simulate the objects: {error}") from None
    data = mujoco.MjData(model)
    checks_at_rest = np.zeros(len(objects), np.int64)
    """Number of consecutive checks, up to the last one, in which each object was at rest."""
    poses = data.qpos.reshape(-1, 7).copy()
    """(N, 7): position, and quaternion [w, x, y, z]."""
    for _ in range(max(1, round(seconds / TIMESTEP / CHECK_STEPS))):
        check_stop()
        mujoco.mj_step(model, data, CHECK_STEPS)
        motion = np.abs(data.qpos.reshape(-1, 7) - poses)
        poses = data.qpos.reshape(-1, 7).copy()
        at_rest = (motion[:, :3] < REST_METRES).all(axis=1) & (motion[:, 3:] < REST_QUATERNION).all(axis=1)
        checks_at_rest = np.where(at_rest, checks_at_rest + 1, 0)
        if (checks_at_rest >= REST_CHECKS).all():
            break
    matrices = [from_pose(pose[:3], pose[3:]) for pose in poses.tolist()]
    return [X if checks and np.isfinite(X).all() else None for X, checks in zip(matrices, checks_at_rest, strict=True)]


def _model(
    mujoco: Any, objects: list[tuple[CollisionSolid, NDArray[np.float64]]], obstacles: list[CollisionSolid]
) -> Any:
    """Return the compiled model: a body with a free joint for each object."""
    spec = mujoco.MjSpec()
    spec.option.timestep = TIMESTEP
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC  # objects creep less than with pyramidal friction
    spec.option.impratio = 10.0
    for index, obstacle in enumerate(obstacles):
        _add_hulls(mujoco, spec, spec.worldbody, obstacle, f"obstacle {index}")
    for index, (solid, X) in enumerate(objects):
        body = spec.worldbody.add_body(pos=X[:3, 3], quat=quaternions_of(X[None, :3, :3])[0])
        body.add_freejoint()
        _add_hulls(mujoco, spec, body, solid, f"object {index}")
    return spec.compile()


def _add_hulls(mujoco: Any, spec: Any, body: Any, solid: CollisionSolid, name: str) -> None:
    for index, points in enumerate(solid.bodies):
        mesh = spec.add_mesh(name=f"{name}, {index}", uservert=_thick(points).ravel())
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
        geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh.name)
        geom.condim, geom.friction, geom.solref, geom.margin, geom.density = 6, FRICTION, STIFFNESS, MARGIN, 500.0


def _thick(points: Body) -> Body:
    """Return points that are not in a plane: flat bodies get ``MIN_THICKNESS``."""
    _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=len(points) < 3)
    for axis in axes:
        if np.ptp(points @ axis) < MIN_THICKNESS:
            points = np.concatenate((points - 0.5 * MIN_THICKNESS * axis, points + 0.5 * MIN_THICKNESS * axis))
    return points
