"""What lights a picture of the ``studio`` look: values only."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, Literal

from renderers.drawlist import Light, LightKind

MAX_LIGHTS: Final = 64
"""Every pixel is lit by all of them."""
MAX_SHADOWS: Final = 4
"""Lights with a shadow map: each costs a drawing of the scene into ``shadow_size`` squared pixels."""

Rgb = tuple[float, float, float]
ToneName = Literal["neutral", "aces", "none"]


@dataclass(frozen=True, slots=True)
class Hemisphere:
    """Light from everywhere: the radiance goes from ``ground`` at the nadir to ``sky`` at the zenith with the sine of
    the height, linear RGB."""

    sky: Rgb = (1.0, 1.0, 1.0)
    ground: Rgb = (0.4, 0.4, 0.4)


@dataclass(frozen=True, slots=True)
class Softbox:
    """A bright patch of the surroundings with soft edges, as photographers use."""

    direction: Rgb
    """From the scene to its middle; any length."""
    radiance: Rgb
    """Linear, added to what lies behind it."""
    width: float
    """Half its angular width, radians."""
    height: float
    """Half its angular height, radians."""
    softness: float = 0.3
    """Part of the half sizes over which it fades."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What is far away all around: reflected by metals, and light from everywhere. World frame, Z up."""

    hemisphere: Hemisphere = Hemisphere()
    softboxes: tuple[Softbox, ...] = ()
    image: bytes | None = None
    """A Radiance picture (``.hdr``), equirectangular, its top is up; replaces hemisphere and softboxes."""
    intensity: float = 1.0
    """Multiplies all of it."""
    turn: float = 0.0
    """Radians about the world's Z axis, counter-clockwise seen from above."""


@dataclass(frozen=True, slots=True)
class Rig:
    """Everything that lights a picture."""

    lights: tuple[Light, ...] = ()
    """In the world, Z up."""
    surroundings: Surroundings | None = field(default_factory=Surroundings)
    """None: black."""
    scene_lights: bool = True
    """Whether lights that the scene brings replace ``lights``."""
    exposure: float = 1.0
    """Multiplies all light before tone mapping."""
    tone: ToneName = "neutral"
    """The curve from light to the display: Khronos' PBR Neutral; ``aces``, what most glTF viewers show; none."""
    shadow_size: int = 2048
    """Side of a shadow map, texels; 0: no shadows."""
    shadow_radius: int = 2
    """Texels either way over which shadow borders are filtered."""

    def __post_init__(self) -> None:
        if len(self.lights) > MAX_LIGHTS:
            raise ValueError(f"a rig has at most {MAX_LIGHTS} lights, not {len(self.lights)}")
        if not (self.shadow_size == 0 or 64 <= self.shadow_size <= 8192):
            raise ValueError(f"shadow_size must be 0 or 64 .. 8192 texels, not {self.shadow_size}")
        if not 0 <= self.shadow_radius <= 8:
            raise ValueError(f"shadow_radius must be 0 .. 8 texels, not {self.shadow_radius}")


def _towards(x: float, y: float, z: float) -> Rgb:
    length = (x * x + y * y + z * z) ** 0.5
    return x / length, y / length, z / length


STUDIO: Final = Rig(
    lights=(Light(LightKind.DIRECTIONAL, (1.0, 0.96, 0.9), 2.3, direction=_towards(0.35, 0.55, -1.0)),),
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
"""The default: a key light from the left over the viewer's shoulder that casts shadows, soft boxes around."""
