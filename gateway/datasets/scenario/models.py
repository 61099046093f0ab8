"""Loads the models of a scenario, and keeps them for further scenes: equal models share meshes and textures."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.datasets.scenario.catalogue import Catalogue
from gateway.datasets.scenario.tables import Model
from gateway.files.assets.scene_file import SceneFileError
from gateway.files.gltf import AnimationTime, Up
from gateway.files.robots.reader import read_robot
from gateway.files.robots.robot import Robot
from gateway.files.robots.scene_files import SceneOptions, read_scene
from gateway.scene.draw.flatten import flatten
from gateway.scene.tree.nodes import Node
from renderers.cache import Cache, WeakCache
from renderers.drawlist import Mesh, used_vertices
from scenegate.robots.robot_errors import RobotFileError
from scenegate.robots.robot_reader import SUFFIXES as ROBOT_SUFFIXES
from scenegate.robots.xacro_args import XacroArgs

MAX_BODIES: Final = 16
"""Maximum number of parts of a model that are bodies of their own; more are one body."""
_MODEL_BYTES: Final = 1 << 16
"""Memory of a model besides its arrays, in the cache's limit."""

Body = NDArray[np.float64]
"""(N, 3) float64, metres: points whose convex hull is a solid body."""


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
        """Return the tree for joint values. Raises RobotFileError if one is invalid, or the model has no joints."""
        if not joints:
            return self.root
        if self.robot is None:
            raise RobotFileError(f"it has no joints, but there is a value for {next(iter(joints))!r}")
        return self.robot.tree(joints)

    def bodies(self, joints: Mapping[str, tuple[float, ...]]) -> tuple[Body, ...]:
        """Return the bodies of the model for joint values, in its own frame."""
        return _bodies_of(self.tree(joints)) if joints else self._default_bodies

    @cached_property
    def _default_bodies(self) -> tuple[Body, ...]:
        return _bodies_of(self.root)


_point_cache: Final[WeakCache[Mesh, Body]] = WeakCache("scenario_points")
_model_cache: Final[Cache[tuple[object, ...], LoadedModel]] = Cache("scenario_models")


def load_model(catalogue: Catalogue, table: Model, file: str, animation: AnimationTime | None = None) -> LoadedModel:
    """Load a file of a table of models, cached while it has not changed. Files that it names must not change.

    ``animation``: that of a glTF file, and its time. Raises SceneFileError or OSError.
    """
    folder, up, args = catalogue.path.parent, table.up, tuple(table.xacro_args.items())
    path, roots = folder / file, tuple(folder / root for root in table.roots)
    status = path.stat()
    key = (path, status.st_mtime_ns, status.st_size, up, roots, args, animation)
    model = _model_cache.get(key)
    if model is None:
        model = _load(path, up, roots, dict(args), animation)
        nbytes = sum(part.array_bytes for _, node in model.root.walk() for part in node.parts or ())
        _model_cache.put(key, model, nbytes + _MODEL_BYTES)
    return model


def _load(
    path: Path, up: Up, roots: tuple[Path, ...], xacro_args: XacroArgs, animation: AnimationTime | None
) -> LoadedModel:
    if path.suffix.lower() not in ROBOT_SUFFIXES:
        scene = read_scene(path, SceneOptions(up=up, animation=animation))
        return LoadedModel(scene.root, None, scene.warnings, scene.digests)
    try:
        robot = read_robot(path, roots=roots, xacro_args=xacro_args)
        return LoadedModel(robot.tree({}), robot, robot.warnings, robot.digests)
    except (RobotFileError, ImportError) as error:
        reason = str(error).removeprefix(f"{path}: ")  # some errors name the file already
        raise SceneFileError(f"{path}: {reason}") from None


def _bodies_of(root: Node) -> tuple[Body, ...]:
    """Return a body for each part of a tree, or one for all of them if there are more than ``MAX_BODIES``."""
    bodies: list[Body] = []
    for instance in flatten(root).instances:
        points = _points_of(instance.mesh)
        if len(points):
            bodies.append(points @ instance.X_world_mesh[:3, :3].T + instance.X_world_mesh[:3, 3])
    return tuple(bodies) if len(bodies) <= MAX_BODIES else (np.concatenate(bodies),)


def _points_of(mesh: Mesh) -> Body:
    """Return the different vertices in use of a mesh, from the cache if it has them."""
    points = _point_cache.get(mesh)
    if points is None:
        used, _ = used_vertices(mesh.elements, len(mesh.positions))
        points = np.unique(mesh.positions[used], axis=0).astype(np.float64)
        points = points[np.isfinite(points).all(axis=1)]
        _point_cache.put(mesh, points, points.nbytes)
    return points
