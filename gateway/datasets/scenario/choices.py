"""The choices of a scene: what was drawn, with settled poses. ``SceneRecord.scenario`` has them as JSON.

Files are named as in the scenario: relative to its folder, unless the scenario names them absolutely. A record may have
been edited: ``choices_of`` compares it with the scenario.
"""

from collections.abc import Iterator
from typing import Annotated, Any, Final, Literal

import msgspec
import numpy as np
from msgspec import Meta

from gateway.datasets.scenario.catalogue import Catalogue
from gateway.datasets.scenario.tables import (
    MAX_OBJECTS,
    MAX_VIEWS,
    Blur,
    Color,
    Factor,
    Fovy,
    Fraction,
    Gain,
    Intensity,
    JointValue,
    Length,
    ScenarioError,
)
from gateway.scene.tree.transforms import is_rotation

MAX_ROTATION_ERROR: Final = 1e-6
"""Maximum deviation of an element of R^T R from the identity, in a pose of a record."""

_Radians = Annotated[float, Meta(ge=-1e6, le=1e6)]
_Coordinate = Annotated[float, Meta(ge=-1e9, le=1e9)]
_Row = tuple[_Coordinate, _Coordinate, _Coordinate, _Coordinate]
Coordinates = tuple[_Row, _Row, _Row, _Row]
"""A ``Pose`` within limits."""
_Direction = tuple[_Coordinate, _Coordinate, _Coordinate]
_Byte = Annotated[int, Meta(ge=0, le=255)]


class Choice(msgspec.Struct, frozen=True, omit_defaults=True):
    """Base of the choices. Values are as in ``tables``, unless a docstring differs."""


class MaterialChoice(Choice, frozen=True, kw_only=True):
    texture: str = ""
    texture_size: Length
    color: Color
    metallic: Fraction
    roughness: Fraction


class SurfaceChoice(Choice, frozen=True, kw_only=True):
    kind: Literal["floor", "table"]
    size: tuple[Length, Length]
    X_world_surface: Coordinates
    """Pose of the centre of its upper side, +Z up."""
    material: MaterialChoice


class ObjectChoice(Choice, frozen=True, kw_only=True):
    entry: tuple[str, int]
    """Table of the scenario: ``models`` or ``distractors``, and its index."""
    file: str
    model: str
    """Name of the model, the same in all scenes."""
    name: str
    """Name of the object, unique in the scene."""
    X_world_object: Coordinates
    """Rigid pose of the model's frame."""
    scale: Factor = 1.0
    joints: dict[str, tuple[JointValue, ...]] = {}
    material: MaterialChoice | None = None
    """None: the materials of the file."""


class CameraChoice(Choice, frozen=True, kw_only=True):
    fovy: Fovy
    X_world_camera: Annotated[tuple[Coordinates, ...], Meta(max_length=MAX_VIEWS)]
    """Pose of the optical frame in each frame; a single one for all of them."""


class LampChoice(Choice, frozen=True, kw_only=True):
    direction: _Direction
    """Unit vector in which it shines."""
    intensity: Intensity
    color: Color


class LightChoice(Choice, frozen=True, kw_only=True):
    rig: str = ""
    environment: str = ""
    turn: _Radians
    intensity: Factor
    lamps: Annotated[tuple[LampChoice, ...], Meta(max_length=8)] = ()


class BackgroundChoice(Choice, frozen=True, kw_only=True):
    image: str = ""
    color: tuple[_Byte, _Byte, _Byte] | None = None
    """0 to 255."""


class SensorChoice(Choice, frozen=True, kw_only=True):
    blur: Blur
    vignetting: bool
    exposure: Factor
    gain: Gain


class SceneChoices(Choice, frozen=True, kw_only=True):
    seed: int
    number: int
    surfaces: tuple[SurfaceChoice, ...]
    objects: Annotated[tuple[ObjectChoice, ...], Meta(max_length=MAX_OBJECTS)]
    cameras: tuple[CameraChoice, ...]
    light: LightChoice
    background: BackgroundChoice
    sensor: SensorChoice | None = None
    notes: tuple[str, ...] = ()
    """Sentences about objects that found no place."""


def choices_of(record: Any, catalogue: Catalogue, number: int) -> SceneChoices:
    """Return the choices in ``SceneRecord.scenario`` of the scene with a number.

    Raises ValidationError if a value is beyond its limits, ScenarioError if it contradicts the scenario.
    """
    choices = msgspec.convert(record, SceneChoices)
    for problem in _problems(choices, catalogue, number):
        raise ScenarioError(problem)
    return choices


def _problems(choices: SceneChoices, catalogue: Catalogue, number: int) -> Iterator[str]:
    """Yield a sentence for each value that the scenario cannot have drawn."""
    scenario = catalogue.scenario
    if (choices.seed, choices.number) != (scenario.seed, number):
        yield f"seed, number: they are {choices.seed}, {choices.number}, those of the scene {scenario.seed}, {number}"
    for key, count, wanted in (
        ("surfaces", len(choices.surfaces), len(scenario.surfaces)),
        ("cameras", len(choices.cameras), scenario.camera_count),
    ):
        if count != wanted:
            yield f"{key}: there are {count}, the scenario has {wanted}"
    for index, surface in enumerate(choices.surfaces):
        yield from _pose_problems("surfaces", surface.X_world_surface)
        key = f"surfaces[{index}].material.textures"
        yield from _file_problems("surfaces.material.texture", {surface.material.texture}, catalogue, key)
    names: set[str] = set()
    for choice in choices.objects:
        yield from _object_problems(choice, catalogue)
        if choice.name in names:
            yield f"objects: two have the name {choice.name!r}"
        names.add(choice.name)
    for camera in choices.cameras:
        if len(camera.X_world_camera) not in (1, scenario.frame_count or 1):
            yield f"cameras: X_world_camera has {len(camera.X_world_camera)} poses, not 1 or one for each frame"
        for pose in camera.X_world_camera:
            yield from _pose_problems("cameras", pose)
    textures = {choice.material.texture for choice in choices.objects if choice.material is not None}
    yield from _file_problems("objects.material.texture", textures, catalogue, "materials.textures")
    yield from _file_problems("light.rig", {choices.light.rig}, catalogue, "lights.rigs")
    yield from _file_problems("light.environment", {choices.light.environment}, catalogue, "lights.environments")
    yield from _file_problems("background.image", {choices.background.image}, catalogue, "backgrounds.images")


def _object_problems(choice: ObjectChoice, catalogue: Catalogue) -> Iterator[str]:
    kind, index = choice.entry
    files = catalogue.models.get(choice.entry)
    if files is None:
        yield f"objects: the scenario has no {kind}[{index}]"
    elif choice.file not in files or choice.model != catalogue.model_names[choice.file]:
        yield f"objects: {choice.file!r} with the name {choice.model!r} is no file of {kind}[{index}]"
    yield from _pose_problems("objects", choice.X_world_object)


def _file_problems(place: str, used: set[str], catalogue: Catalogue, key: str) -> Iterator[str]:
    """Yield a sentence for each file at a place in the record that is not among those of the scenario's key."""
    for file in sorted(used - {"", *catalogue.other_files.get(key, ())}):
        yield f"{place}: {file!r} is not among the files of the scenario"


def _pose_problems(key: str, pose: Coordinates) -> Iterator[str]:
    if not is_rotation(np.array(pose)[:3, :3], MAX_ROTATION_ERROR) or pose[3] != (0.0, 0.0, 0.0, 1.0):
        yield f"{key}: {[list(row) for row in pose]} is not a rigid pose"
