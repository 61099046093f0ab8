"""The choices of a scene: what was drawn, with settled poses. ``SceneRecord.scenario`` has them as JSON.

Files are named as in the scenario: relative to its folder, unless the scenario names them absolutely.
"""

from __future__ import annotations

import msgspec

from scenegate.datasets.manifest import Pose, Vector3


class Choice(msgspec.Struct, frozen=True, omit_defaults=True):
    """Base of the choices. Values are as in the structs of ``file``, unless a docstring differs."""


class MaterialChoice(Choice, frozen=True, kw_only=True):
    texture: str = ""
    texture_size: float
    color: Vector3
    """sRGB."""
    metallic: float
    roughness: float


class SurfaceChoice(Choice, frozen=True, kw_only=True):
    kind: str
    size: tuple[float, float]
    X_world_surface: Pose
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
    X_world_object: Pose
    """Rigid pose of the model's frame."""
    scale: float = 1.0
    joints: dict[str, tuple[float, ...]] = {}
    material: MaterialChoice | None = None
    """None: the materials of the file."""


class CameraChoice(Choice, frozen=True, kw_only=True):
    fovy: float
    X_world_camera: tuple[Pose, ...]
    """Pose of the optical frame in each frame; a single one for all of them."""


class LampChoice(Choice, frozen=True, kw_only=True):
    direction: Vector3
    """Unit vector in which it shines."""
    intensity: float
    color: Vector3


class LightChoice(Choice, frozen=True, kw_only=True):
    rig: str = ""
    environment: str = ""
    turn: float
    """Radians."""
    intensity: float
    lamps: tuple[LampChoice, ...] = ()


class BackgroundChoice(Choice, frozen=True, kw_only=True):
    image: str = ""
    color: tuple[int, int, int] | None = None
    """0 to 255."""


class SensorChoice(Choice, frozen=True, kw_only=True):
    blur: float
    vignetting: bool
    exposure: float
    gain: float


class SceneChoices(Choice, frozen=True, kw_only=True):
    seed: int
    number: int
    surfaces: tuple[SurfaceChoice, ...]
    objects: tuple[ObjectChoice, ...]
    cameras: tuple[CameraChoice, ...]
    light: LightChoice
    background: BackgroundChoice
    sensor: SensorChoice | None = None
    notes: tuple[str, ...] = ()
    """Sentences about objects that found no place."""
