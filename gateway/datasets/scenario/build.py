"""Makes a scene from its choices: the same choices and files give the same bytes, on any machine."""

import posixpath
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final

import numpy as np

from gateway.datasets.objects import SceneObject, has_geometry
from gateway.datasets.scenario import tables
from gateway.datasets.scenario.catalogue import Catalogue
from gateway.datasets.scenario.choices import ObjectChoice, SceneChoices
from gateway.datasets.scenario.drawn_materials import material_of, with_material
from gateway.datasets.scenario.models import load_model
from gateway.datasets.scenario.scenery import Scenery, scenery_of
from gateway.datasets.scenario.surfaces import node_of
from gateway.datasets.scenario.tables import ScenarioError
from gateway.datasets.scenario.tracks import read_track
from gateway.files.assets.light_rig_file import RigFileError
from gateway.files.assets.scene_file import SceneFileError
from gateway.files.gltf import AnimationTime
from gateway.scene.tree.nodes import Node, PathElement
from gateway.scene.tree.transforms import scaling
from renderers.drawlist import ImageError
from scenegate.regular_files import errors_as, sha256_of
from scenegate.robots.robot_errors import RobotFileError

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
    """Return a frame of a scene. Raises ScenarioError if a file cannot be used."""
    try:
        return _Builder(catalogue, choices, frame).build()
    except OSError as error:
        raise ScenarioError(f"{error.filename or catalogue.path.parent}: {error.strerror or error}") from None
    except (SceneFileError, ImageError, RigFileError) as error:
        raise ScenarioError(str(error)) from None


@lru_cache(8)
def model_names(catalogue: Catalogue) -> frozenset[str]:
    """Return the names of the models of all annotated objects that the scenario may have.

    Models that cannot be loaded have none: they are left out of each scene that draws them, with a note. Raises
    ScenarioError if a path names no file.
    """
    names: set[str] = set()
    for index, model_table in enumerate(catalogue.scenario.models):
        for file in catalogue.models["models", index]:
            model_name = catalogue.model_names[file]
            if not has_moving_parts(model_table):
                names.add(model_name)
                continue
            try:
                root = load_model(catalogue, model_table, file).root
            except (OSError, SceneFileError):
                continue
            names.update(part.model for part in _part_objects(root, model_name, ()))
    return frozenset(names)


def has_moving_parts(table: tables.Model) -> bool:
    """Return True if the parts of a model move against each other. Each of them is an object, then."""
    return bool(table.joints or table.joint_track or table.animation is not None)


def _part_objects(root: Node, model_name: str, root_path: tuple[PathElement, ...]) -> Iterator[SceneObject]:
    """Yield an object for each node with geometry of a model. The root of a model has none."""
    for path, node in root.walk(root_path):
        if has_geometry(node):
            yield SceneObject(path, f"{model_name}/{path[-1]}")


class _Builder:
    def __init__(self, catalogue: Catalogue, choices: SceneChoices, frame: int) -> None:
        self._catalogue = catalogue
        self._folder = catalogue.path.parent
        self._choices = choices
        self._frame = frame
        frames = catalogue.scenario.frames
        self._seconds = 0.0 if frames is None else frames.start + frame / frames.rate
        self._digests: dict[str, str] = {}
        self._warnings = list(choices.notes)

    def build(self) -> BuiltScene:
        choices = self._choices
        groups: dict[str, dict[PathElement, Node]] = {"surfaces": {}, "models": {}, "distractors": {}}
        objects: list[SceneObject] = []
        for surface_index, surface in enumerate(choices.surfaces):
            groups["surfaces"][f"{surface.kind} {surface_index}"] = node_of(surface, self._folder)
            self._add_digest(surface.material.texture)
        for choice in choices.objects:
            group, index = choice.entry
            model_table: tables.Model = getattr(self._catalogue.scenario, group)[index]
            node = groups[group][choice.name] = self._object_node(choice, model_table)
            is_annotated = group == "models"
            if is_annotated and has_moving_parts(model_table):
                objects += _part_objects(node, choice.model, (group, choice.name))
            elif is_annotated:
                objects.append(SceneObject((group, choice.name), choice.model))
        scenery = scenery_of(choices, self._folder, self._frame)
        for file in (choices.light.rig, choices.light.environment, choices.background.image):
            self._add_digest(file)
        root = Node(None, children={name: Node(None, children=nodes) for name, nodes in groups.items() if nodes})
        warnings = tuple(dict.fromkeys(self._warnings))  # each once
        return BuiltScene(root, tuple(objects), scenery, self._digests, warnings)

    def _add_digest(self, file: str) -> None:
        """Add the digest of a file that has been read, unless its name is empty. It is empty if the file has gone."""
        if file and file not in self._digests:
            self._digests[file] = sha256_of(self._folder / file) or ""

    def _object_node(self, choice: ObjectChoice, model_table: tables.Model) -> Node:
        """Return the node of an object at the frame's time."""
        animation = None if model_table.animation is None else AnimationTime(model_table.animation, self._seconds)
        model = load_model(self._catalogue, model_table, choice.file, animation)
        model_folder = posixpath.dirname(choice.file)
        for name, digest in model.digests.items():
            self._digests[posixpath.normpath(posixpath.join(model_folder, name))] = digest
        self._warnings += [f"{choice.file}: {warning}" for warning in model.warnings]
        joints = dict(choice.joints)
        if model_table.joint_track:
            joints |= read_track(self._folder / model_table.joint_track, poses=False).at(self._seconds)
            self._add_digest(model_table.joint_track)
        with errors_as(SceneFileError, choice.file, RobotFileError):
            tree = model.tree(joints)
        if model_table.pose_track:
            X_world_object = read_track(self._folder / model_table.pose_track, poses=True).pose_at(self._seconds)
            self._add_digest(model_table.pose_track)
        else:
            X_world_object = np.array(choice.X_world_object)
        if choice.scale != 1.0:
            X_world_object = X_world_object @ scaling(choice.scale, choice.scale, choice.scale)
        return Node(None, X_world_object, {MODEL_NODE: self._with_material(tree, choice)})

    def _with_material(self, tree: Node, choice: ObjectChoice) -> Node:
        """Return the tree of a model with its drawn material.

        If materials have textures, all models without texture coordinates get some, also those that keep their own
        materials: objects of one model then have the same meshes.
        """
        materials = self._catalogue.scenario.materials
        if materials is None:
            return tree
        material = None
        if choice.material is not None:
            material = material_of(choice.material, self._folder)
            self._add_digest(choice.material.texture)
        texture_size = materials.texture_size if materials.textures else None
        if material is None and texture_size is None:
            return tree
        return with_material(tree, material, texture_size, choice.scale)
