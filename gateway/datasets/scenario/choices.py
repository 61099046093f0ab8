"""The choices of a scene: what was drawn, with settled poses. ``SceneRecord.scenario`` has them as JSON.

Files are named as in the scenario: relative to its folder, unless the scenario names them absolutely. A record may have
been edited: ``choices_of`` compares it with the scenario.
"""

from itertools import chain
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

    Raises ValidationError if a value is beyond its limits, ScenarioError if the scenario cannot have drawn it.
    """
    choices = msgspec.convert(record, SceneChoices)
    scenario = catalogue.scenario
    if (choices.seed, choices.number) != (scenario.seed, number):
        raise ScenarioError(f"it is scene {choices.number} of seed {choices.seed}")
    if (len(choices.surfaces), len(choices.cameras)) != (len(scenario.surfaces), scenario.camera_count):
        raise ScenarioError("it has not the surfaces and cameras of the scenario")
    if {len(camera.X_world_camera) for camera in choices.cameras} - {1, scenario.frame_count or 1}:
        raise ScenarioError("a camera has not one pose, or one for each frame")
    for choice in choices.objects:
        known = choice.file in catalogue.models.get(choice.entry, ())
        if not known or choice.model != catalogue.model_names[choice.file]:
            raise ScenarioError(f"{choice.file!r} ({choice.model!r}) is no model of {choice.entry}")
    if len({choice.name for choice in choices.objects}) < len(choices.objects):
        raise ScenarioError("two objects have the same name")
    materials = [surface.material for surface in choices.surfaces]
    materials += [choice.material for choice in choices.objects if choice.material is not None]
    files = {choices.light.rig, choices.light.environment, choices.background.image, *(m.texture for m in materials)}
    if unknown := files - {"", *chain(*catalogue.other_files.values())}:
        raise ScenarioError(f"{min(unknown)!r} is no file of the scenario")
    poses = [each.X_world_surface for each in choices.surfaces] + [each.X_world_object for each in choices.objects]
    for pose in chain(poses, *(camera.X_world_camera for camera in choices.cameras)):
        if not is_rotation(np.array(pose)[:3, :3], MAX_ROTATION_ERROR) or pose[3] != (0.0, 0.0, 0.0, 1.0):
            raise ScenarioError(f"{[list(row) for row in pose]} is not a rigid pose")
    return choices
