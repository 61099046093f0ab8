"""Loads the models of a scenario, and keeps them for further scenes: equal models share meshes and textures."""

from __future__ import annotations

import os
import posixpath
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.assets.scene_file import SceneFileError, Up
from gateway.gltf import AnimationTime
from gateway.robots.reader import read_robot
from gateway.robots.robot import Robot
from gateway.robots.scene_files import SceneOptions, read_scene
from gateway.scene.flatten import flatten
from gateway.scene.tree import Node
from renderers.cache import Cache, WeakCache
from renderers.drawlist import Mesh, used_vertices
from scenegate.robots.errors import RobotFileError
from scenegate.robots.reader import SUFFIXES as ROBOT_SUFFIXES

MAX_HULLS: Final = 16
"""Maximum number of parts of a model that count as convex bodies of their own; more are one body."""

Points = NDArray[np.float64]
"""(N, 3) float64, whose convex hull is a body; metres."""


@dataclass(frozen=True, eq=False)
class LoadedModel:
    """A model as its file has it."""

    root: Node
    """Root of the tree; of a robot, in its default configuration."""
    robot: Robot | None
    warnings: tuple[str, ...]
    digests: Mapping[str, str]
    """SHA-256 of the files that were read, by path relative to the file's folder."""

    def tree(self, joints: Mapping[str, tuple[float, ...]]) -> Node:
        """Return the tree for joint values.

        Raises:
            RobotFileError: a value is invalid, or the model has no joints.
        """
        if not joints:
            return self.root
        if self.robot is None:
            raise RobotFileError(f"it has no joints, but there is a value for {next(iter(joints))!r}")
        return self.robot.tree(joints)

    def hulls(self, joints: Mapping[str, tuple[float, ...]]) -> tuple[Points, ...]:
        """Return the bodies of the model for joint values, in its own frame."""
        return hulls_of(self.tree(joints)) if joints else self._default_hulls

    @cached_property
    def _default_hulls(self) -> tuple[Points, ...]:
        return hulls_of(self.root)


_points: Final[WeakCache[Mesh, Points]] = WeakCache("scenario_points")
_models: Final[Cache[tuple[object, ...], LoadedModel]] = Cache("scenario_models")


def load_model(path: Path, up: Up, roots: tuple[Path, ...], animation: AnimationTime | None = None) -> LoadedModel:
    """Load a model, or return it from the cache if its file has not changed.

    Args:
        up: up axis of a glTF file.
        roots: folders with the packages of a robot file.
        animation: animation of a glTF file, and its time.

    Raises:
        SceneFileError, OSError: it cannot be loaded.
    """
    status = path.stat()
    key = (path, status.st_mtime_ns, status.st_size, up, roots, animation)
    model = _models.get(key)
    if model is None:
        model = _load(path, up, roots, animation)
        nbytes = sum(part.array_bytes for _, node in model.root.walk() for part in node.parts or ())
        _models.put(key, model, nbytes + (1 << 16))
    return model


def _load(path: Path, up: Up, roots: tuple[Path, ...], animation: AnimationTime | None) -> LoadedModel:
    if path.suffix.lower() not in ROBOT_SUFFIXES:
        scene = read_scene(path, SceneOptions(up=up, animation=animation))
        return LoadedModel(scene.root, None, scene.warnings, scene.digests)
    try:
        robot = read_robot(path, roots=roots)
        return LoadedModel(robot.tree({}), robot, robot.warnings, robot.digests)
    except (RobotFileError, ImportError) as error:
        raise SceneFileError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None


def hulls_of(root: Node) -> tuple[Points, ...]:
    """Return the points of each part of a tree, without duplicates; of all together if there are many parts."""
    bodies: list[Points] = []
    for instance in flatten(root).instances:
        points = _points_of(instance.mesh)
        if len(points):
            bodies.append(points @ instance.X_world_mesh[:3, :3].T + instance.X_world_mesh[:3, 3])
    return tuple(bodies) if len(bodies) <= MAX_HULLS else (np.concatenate(bodies),)


def _points_of(mesh: Mesh) -> Points:
    """Return the different vertices in use of a mesh, from the cache if it has them."""
    points = _points.get(mesh)
    if points is None:
        used, _ = used_vertices(mesh.elements, len(mesh.positions))
        points = np.unique(mesh.positions[used], axis=0).astype(np.float64)
        points = points[np.isfinite(points).all(axis=1)]
        _points.put(mesh, points, points.nbytes)
    return points


def sources_of(file: str, model: LoadedModel) -> dict[str, str]:
    """Return the digests of a model's files, by path relative to the scenario's folder."""
    folder = os.path.dirname(file)  # noqa: PTH120 - a name of the scenario, not a path here
    return {posixpath.normpath(posixpath.join(folder, name)): digest for name, digest in model.digests.items()}
