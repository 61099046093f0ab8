"""The choices of a scene: what was drawn, with settled poses. ``SceneRecord.scenario`` has them as JSON.

Files are named as in the scenario: relative to its folder, unless the scenario names them absolutely.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

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
)

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
