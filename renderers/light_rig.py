"""Light rigs of the look ``studio``: lights, environment, exposure and tone curve of an image."""

import math
from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import DrawList, Light, LightKind

MAX_LIGHTS: Final = 64
"""Maximum number of lights per image. Every pixel is lit by all of them."""
MAX_SHADOWS: Final = 4
"""Maximum number of lights with a shadow map. For each of them, the scene is rendered to
``shadow_size`` x ``shadow_size`` texels."""

Rgb = tuple[float, float, float]
Vector3 = tuple[float, float, float]
ToneName = Literal["neutral", "aces", "none"]


@dataclass(frozen=True, slots=True)
class Hemisphere:
    """Linear RGB radiance that changes with the sine of the elevation, from ``ground`` (nadir) to ``sky`` (zenith)."""

    sky: Rgb = (1.0, 1.0, 1.0)
    ground: Rgb = (0.4, 0.4, 0.4)


@dataclass(frozen=True, slots=True)
class Softbox:
    """Bright rectangle of the environment with soft edges."""

    direction: Vector3
    """Direction from the scene to the softbox's centre, any length. World frame, Z up."""
    radiance: Rgb
    """Linear RGB, added to the radiance behind the softbox."""
    half_width: float
    """Half the angular width, radians."""
    half_height: float
    """Half the angular height, radians."""
    softness: float = 0.3
    """Width of the fading edge, as a share of the half width and half height."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Environment at infinity, which gives reflections and diffuse light. World frame, Z up."""

    hemisphere: Hemisphere = Hemisphere()
    softboxes: tuple[Softbox, ...] = ()
    image: bytes | None = None
    """Content of an equirectangular Radiance file (``.hdr``), top row up. Replaces hemisphere and softboxes."""
    intensity: float = 1.0
    """Factor of the radiance."""
    turn: float = 0.0
    """Rotation about the world's Z axis, radians, counter-clockwise seen from above."""


@dataclass(frozen=True, slots=True)
class Rig:
    """Lights, environment, exposure, tone curve and shadows of an image."""

    lights: tuple[Light, ...] = ()
    """Lights in the world frame, Z up."""
    surroundings: Surroundings | None = field(default_factory=Surroundings)
    """Environment; None: black."""
    scene_lights: bool = True
    """True: if the scene has lights, they replace ``lights``."""
    auto_exposure: bool = True
    """True: the scene's lights are dimmed if they would overexpose the image, as lights in lux and candela do."""
    exposure: float = 1.0
    """Factor of all light before tone mapping."""
    tone: ToneName = "neutral"
    """Tone curve: ``neutral`` is Khronos' PBR Neutral, ``aces`` that of most glTF viewers, ``none`` clamps values."""
    shadow_size: int = 2048
    """Maximum side of a shadow map, texels; 0: no shadows."""
    shadow_radius: int = 2
    """Radius of the shadow filter, texels."""

    def lights_of(self, scene: DrawList) -> tuple[Light, ...]:
        """Return the lights of an image of a scene, at most ``MAX_LIGHTS``."""
        return (scene.lights if scene.lights and self.scene_lights else self.lights)[:MAX_LIGHTS]

    @property
    def is_dark(self) -> bool:
        """True if the rig has no light of its own."""
        return not self.lights and self.surroundings is None

    def __post_init__(self) -> None:
        if len(self.lights) > MAX_LIGHTS:
            raise ValueError(f"a rig has at most {MAX_LIGHTS} lights, not {len(self.lights)}")
        if not (self.shadow_size == 0 or 64 <= self.shadow_size <= 8192):
            raise ValueError(f"shadow_size must be 0 or 64 .. 8192 texels, not {self.shadow_size}")
        if not 0 <= self.shadow_radius <= 8:
            raise ValueError(f"shadow_radius must be 0 .. 8 texels, not {self.shadow_radius}")


@dataclass(frozen=True, slots=True)
class LightChange:
    """Changes of a rig's key light, its first directional light, and of its environment."""

    azimuth: float | None = None
    """Direction from which the key light comes: degrees from +X, counter-clockwise seen from above; None: the rig's."""
    elevation: float | None = None
    """Degrees above the horizon; None: the rig's."""
    strength: float = 1.0
    """Factor of the key light."""
    ambient: float = 1.0
    """Factor of the environment."""

    def applied_to(self, rig: Rig) -> Rig:
        """Return the changed rig."""
        lights, surroundings = list(rig.lights), rig.surroundings
        key = next((i for i, light in enumerate(lights) if light.kind is LightKind.DIRECTIONAL), None)
        if key is not None:
            light = lights[key]
            direction = self._direction(*light.direction)
            lights[key] = replace(light, direction=direction, intensity=self.strength * light.intensity)
        if surroundings is not None:
            surroundings = replace(surroundings, intensity=self.ambient * surroundings.intensity)
        return replace(rig, lights=tuple(lights), surroundings=surroundings)

    def _direction(self, x: float, y: float, z: float) -> Vector3:
        """Return the direction in which the key light shines, given that of the rig."""
        if self.azimuth is None and self.elevation is None:
            return x, y, z
        azimuth = math.atan2(-y, -x) if self.azimuth is None else math.radians(self.azimuth)
        elevation = math.atan2(-z, math.hypot(x, y)) if self.elevation is None else math.radians(self.elevation)
        across = -math.cos(elevation)
        return across * math.cos(azimuth), across * math.sin(azimuth), -math.sin(elevation)


@dataclass(frozen=True, slots=True, eq=False)
class KeyLight:
    """A distant light with a shadow map."""

    level: float
    """Light on a surface that faces it, in the unit of ``CameraLight``."""
    camera: Camera
    """Camera of the shadow map; it looks along the light."""
    depth: NDArray[np.float32]
    """(S, S) float32, shadow map: depth seen by ``camera``, metres, +inf: nothing."""
    normal_offset: float
    """Offset of points along their normal, against self-shadowing, metres per metre of distance from ``camera``."""
    beyond: float = 1.0
    """Share of the light that reaches points outside of the shadow map."""


@dataclass(frozen=True, slots=True)
class CameraLight:
    """Light of a camera's images, in place of the headlight along the optical axis. Its parts add up.

    The unit is the light of the look ``gltf`` on a surface that faces the camera.
    """

    position: Vector3
    """Place of the camera's lamp, a point, in the world frame, metres."""
    lamp: float
    """Light of the lamp on a surface that faces it 1.5 m away."""
    sky: float
    """Light of the sky on a surface that faces up."""
    ground: float
    """Light from below on a surface that faces down."""
    lights: tuple[Light, ...] = ()
    """Further lights, without shadows. An illuminance of 1 lux is the light 1."""
    key: KeyLight | None = None
    """Key light, which is not in the colour image but in ``Frame.key_factor``: it may be brighter than white."""


def _normalized(x: float, y: float, z: float) -> Vector3:
    length = (x * x + y * y + z * z) ** 0.5
    return x / length, y / length, z / length


STUDIO: Final = Rig(
    lights=(Light(LightKind.DIRECTIONAL, (1.0, 0.96, 0.9), 2.3, direction=_normalized(0.35, 0.55, -1.0)),),
    exposure=0.88,
    surroundings=Surroundings(
        hemisphere=Hemisphere((0.34, 0.37, 0.42), (0.16, 0.155, 0.15)),
        softboxes=(
            Softbox((-0.6, -0.8, 0.9), (1.7, 1.65, 1.55), 0.5, 0.4),
            Softbox((1.0, -0.25, 0.5), (0.8, 0.9, 1.05), 0.2, 0.7),
            Softbox((0.2, 1.0, 0.7), (1.0, 1.0, 1.05), 0.7, 0.18),
        ),
    ),
)
"""Default rig: a key light with shadows, which comes from the left behind the viewer, and three softboxes."""
