"""Makes a scene from its choices: the same choices and files give the same bytes, on any machine."""

from __future__ import annotations

import posixpath
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final

import numpy as np

from gateway.assets.light_rig_file import RigFileError
from gateway.assets.scene_file import SceneFileError
from gateway.datasets.objects import SceneObject
from gateway.datasets.scenario import tables
from gateway.datasets.scenario.catalogue import Catalogue
from gateway.datasets.scenario.choices import ObjectChoice, SceneChoices
from gateway.datasets.scenario.materials import material_of, with_material
from gateway.datasets.scenario.models import load_model
from gateway.datasets.scenario.scenery import Scenery, scenery_of
from gateway.datasets.scenario.surfaces import node_of
from gateway.datasets.scenario.tables import ScenarioError
from gateway.datasets.scenario.tracks import read_track
from gateway.gltf import AnimationTime
from gateway.scene.transforms import scaling
from gateway.scene.tree import Node, PathElement
from renderers.drawlist import ImageError
from scenegate.regular_files import errors_as, sha256_of
from scenegate.robots.errors import RobotFileError

MODEL_NODE: Final = "model"
"""Name of the node below an object that has the model's tree."""


@dataclass(frozen=True, slots=True, eq=False)
class BuiltScene:
    """A frame of a scene."""

    root: Node
    objects: tuple[SceneObject, ...]
    scenery: Scenery
    digests: dict[str, str] = field(default_factory=dict)
    """SHA-256 of the files in use, by path relative to the scenario's folder."""
    warnings: tuple[str, ...] = ()


def build_scene(catalogue: Catalogue, choices: SceneChoices, frame: int) -> BuiltScene:
    """Return a frame of a scene.

    Raises:
        ScenarioError: a file cannot be used.
    """
    folder = catalogue.path.parent
    try:
        return _Builder(catalogue, choices, frame).build()
    except OSError as error:
        raise ScenarioError(f"{error.filename or folder}: {error.strerror or error}") from None
    except (SceneFileError, ImageError, RigFileError) as error:
        raise ScenarioError(str(error)) from None


@lru_cache(8)
def model_names(catalogue: Catalogue) -> frozenset[str]:
    """Return the names of the models of all annotated objects that the scenario may have.

    Raises:
        ScenarioError: a model cannot be loaded whose parts move, and whose names are those of its parts.
    """
    names: set[str] = set()
    for (kind, index), files in catalogue.models.items():
        table = getattr(catalogue.scenario, kind)[index]
        for file in files if kind == "models" else ():
            name = catalogue.model_names[file]
            if not has_moving_parts(table):
                names.add(name)
                continue
            try:
                root = load_model(catalogue, table, file).root
                names.update(each.model for each in _part_objects(root, name, ()))
            except (OSError, SceneFileError):  # a note of each scene that draws the file
                continue
    return frozenset(names)


def has_moving_parts(table: tables.Model) -> bool:
    """Return True if the parts of a model move against each other. Each of them is an object, then."""
    return bool(table.joints or table.joint_track or table.animation is not None)


def _part_objects(node: Node, model: str, path: tuple[PathElement, ...]) -> Iterator[SceneObject]:
    for each, child in node.walk(path):
        if child.parts:
            yield SceneObject(each, f"{model}/{each[-1]}" if each else model)


class _Builder:
    def __init__(self, catalogue: Catalogue, choices: SceneChoices, frame: int) -> None:
        self._catalogue = catalogue
        self._folder = catalogue.path.parent
        self._choices = choices
        self._frame = frame
        frames = catalogue.scenario.frames
        self._seconds = 0.0 if frames is None else frames.start + frame / frames.rate
        self._digests: dict[str, str] = {}
        self._warnings: dict[str, None] = dict.fromkeys(choices.notes)

    def build(self) -> BuiltScene:
        choices = self._choices
        groups: dict[str, dict[PathElement, Node]] = {"surfaces": {}, "models": {}, "distractors": {}}
        objects: list[SceneObject] = []
        for index, surface in enumerate(choices.surfaces):
            groups["surfaces"][f"{surface.kind} {index}"] = node_of(surface, self._folder)
            self._use(surface.material.texture)
        for choice in choices.objects:
            kind, index = choice.entry
            table: tables.Model = getattr(self._catalogue.scenario, kind)[index]
            node = groups[kind][choice.name] = self._object(choice, table)
            if kind == "models" and has_moving_parts(table):
                objects += _part_objects(node, choice.model, (kind, choice.name))
            elif kind == "models":
                objects.append(SceneObject((kind, choice.name), choice.model))
        scenery = scenery_of(choices, self._folder, self._frame)
        for file in (choices.light.rig, choices.light.environment, choices.background.image):
            self._use(file)
        root = Node(None, children={name: Node(None, children=nodes) for name, nodes in groups.items() if nodes})
        return BuiltScene(root, tuple(objects), scenery, self._digests, tuple(self._warnings))

    def _use(self, file: str) -> None:
        """Add the digest of a file, unless its name is empty."""
        if file and file not in self._digests:
            self._digests[file] = sha256_of(self._folder / file) or ""

    def _object(self, choice: ObjectChoice, table: tables.Model) -> Node:
        """Return the node of an object at the frame's time."""
        animation = None if table.animation is None else AnimationTime(table.animation, self._seconds)
        model = load_model(self._catalogue, table, choice.file, animation)
        folder = posixpath.dirname(choice.file)
        for name, digest in model.digests.items():
            self._digests[posixpath.normpath(posixpath.join(folder, name))] = digest
        self._warnings |= dict.fromkeys(f"{choice.file}: {warning}" for warning in model.warnings)
        joints = dict(choice.joints)
        if table.joint_track:
            self._use(table.joint_track)
            joints |= read_track(self._folder / table.joint_track, poses=False).at(self._seconds)
        with errors_as(SceneFileError, choice.file, RobotFileError):
            tree = model.tree(joints)
        X = np.array(choice.X_world_object)
        if table.pose_track:
            self._use(table.pose_track)
            X = read_track(self._folder / table.pose_track, poses=True).pose_at(self._seconds)
        if choice.scale != 1.0:
            X = X @ scaling(choice.scale, choice.scale, choice.scale)
        return Node(None, X, {MODEL_NODE: self._with_material(tree, choice)})

    def _with_material(self, tree: Node, choice: ObjectChoice) -> Node:
        """Return the tree of a model with its drawn material."""
        materials = self._catalogue.scenario.materials
        if materials is None:
            return tree
        material = None if choice.material is None else material_of(choice.material, self._folder)
        if choice.material is not None:
            self._use(choice.material.texture)
        # Equal models have equal meshes, so those with their own materials get texture coordinates, too.
        if not materials.textures:
            return tree if material is None else with_material(tree, material, None)
        return with_material(tree, material, materials.texture_size, choice.scale)
