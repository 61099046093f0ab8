"""Poses of a URDF robot's links."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from gateway.robots.errors import RobotFileError, similar_names
from gateway.robots.urdf_model import UrdfJoint
from gateway.scene.transforms import from_pose


class UrdfKinematics:
    """Tree of joints. The links without a parent have the robot's frame."""

    def __init__(self, links: Sequence[str], joints: Sequence[UrdfJoint]) -> None:
        """
        Raises:
            RobotFileError: A joint names a link that does not exist, a link has two parents, or joints form a circle.
        """
        self._link_count = len(links)
        ordered = _parents_first(links, joints)
        index = {name: number for number, name in enumerate(links)}
        self._ends = [(index[joint.parent], index[joint.child]) for joint in ordered]
        """Numbers of parent and child of each joint, parents first."""
        self._X_parent_joint = np.array([joint.X_parent_joint for joint in ordered]).reshape(-1, 4, 4)
        turning = [i for i, joint in enumerate(ordered) if joint.motion is not None and joint.motion.kind == "revolute"]
        sliding = [
            i for i, joint in enumerate(ordered) if joint.motion is not None and joint.motion.kind == "prismatic"
        ]
        self._turning, self._sliding = np.array(turning, np.intp), np.array(sliding, np.intp)
        self._names = [joint.name for joint in ordered]
        axes = np.array([joint.axis for joint in ordered]).reshape(-1, 3)
        self._axes = axes
        self._K = np.array([_cross_matrix(axis) for axis in axes[self._turning]]).reshape(-1, 3, 3)
        self._K_squared = self._K @ self._K
        self._others = [
            (i, joint.motion.kind)
            for i, joint in enumerate(ordered)
            if joint.motion is not None and joint.motion.kind in ("planar", "floating")
        ]

    def link_poses(self, values: Mapping[str, tuple[float, ...]]) -> NDArray[np.float64]:
        """Return X_robot_link, (number of links, 4, 4) float64, for the values of all joints."""
        X_joint_child = np.tile(np.eye(4), (len(self._ends), 1, 1))
        if len(self._turning):  # Rodrigues: R = I + sin q K + (1 - cos q) K²
            q = np.array([values[self._names[i]][0] for i in self._turning])[:, None, None]
            X_joint_child[self._turning, :3, :3] += np.sin(q) * self._K + (1.0 - np.cos(q)) * self._K_squared
        if len(self._sliding):
            q = np.array([values[self._names[i]] for i in self._sliding])
            X_joint_child[self._sliding, :3, 3] = q * self._axes[self._sliding]
        for i, kind in self._others:
            value = values[self._names[i]]
            X_joint_child[i] = from_pose(value[:3], value[3:]) if kind == "floating" else _planar(self._axes[i], value)
        X_parent_child = self._X_parent_joint @ X_joint_child
        X_robot_link = np.tile(np.eye(4), (self._link_count, 1, 1))
        for (parent, child), X in zip(self._ends, X_parent_child, strict=True):
            X_robot_link[child] = X_robot_link[parent] @ X
        return X_robot_link


def _cross_matrix(axis: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y, z = axis.tolist()
    return np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))


def _planar(normal: NDArray[np.float64], value: Sequence[float]) -> NDArray[np.float64]:
    """Return the motion in the plane of a normal: x and y along the plane's axes, then a rotation about the normal.

    For a normal along z, the plane's axes are the joint's x and y; else, x is the joint's axis nearest to the plane.
    """
    x, y, angle = value
    first = np.eye(3)[int(np.argmin(np.abs(normal)))]
    first = first - normal * (normal @ first)
    first /= np.linalg.norm(first)
    K = _cross_matrix(normal)
    X = np.eye(4)
    X[:3, :3] += np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K)
    X[:3, 3] = x * first + y * np.cross(normal, first)
    return X


def _parents_first(links: Sequence[str], joints: Sequence[UrdfJoint]) -> list[UrdfJoint]:
    """Return the joints in an order in which each link's pose is known before it is used."""
    known = set(links)
    children: dict[str, list[UrdfJoint]] = {name: [] for name in links}
    parent_of: dict[str, UrdfJoint] = {}
    for joint in joints:
        for end in (joint.parent, joint.child):
            if end not in known:
                raise RobotFileError(f"joint {joint.name!r}: there is no link {end!r}{similar_names(end, links)}")
        other = parent_of.setdefault(joint.child, joint)
        if other is not joint:
            raise RobotFileError(f"link {joint.child!r} is the child of two joints, {other.name!r} and {joint.name!r}")
        children[joint.parent].append(joint)
    ordered: list[UrdfJoint] = []
    waiting = [name for name in links if name not in parent_of]
    while waiting:
        below = children[waiting.pop()]
        ordered += below
        waiting += [joint.child for joint in below]
    if len(ordered) != len(joints):
        reached = {joint.name for joint in ordered}
        circle = [joint.name for joint in joints if joint.name not in reached]
        raise RobotFileError(f"the joints {', '.join(circle[:8])} form a circle: the links must be a tree")
    return ordered
