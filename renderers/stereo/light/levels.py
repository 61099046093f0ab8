"""Levels of the light in camera images, and the parser of their option."""

from dataclasses import dataclass, fields
from typing import Final

MAX_LEVEL: Final = 100.0
"""Maximum of every level."""


@dataclass(frozen=True, slots=True)
class LightLevels:
    """Levels of the light in camera images. All light adds up.

    The unit is the light under which the look ``gltf`` shows a surface that faces the camera.
    """

    lamp: float = 0.6
    """Lamp at the camera, a point: its light on a surface that faces it 1.5 m away."""
    sky: float = 1.6
    """Light of the sky on a surface that faces up."""
    ground: float = 1.25
    """Light from below, or from the walls of a room, on a surface that faces down."""
    key: float = 2.4
    """Key light of the realism part ``shadows``, which replaces the lamp, on a surface that faces it."""
    scene: float = 1.0
    """Factor of the scene's lights; see ``scene_light.camera_light``."""
    projector: float = 1.0
    """Factor of the projector's light."""

    def __str__(self) -> str:
        """Return the levels as ``parse_light_levels`` reads them."""
        return ",".join(f"{field.name}={getattr(self, field.name):g}" for field in fields(self))


def parse_light_levels(text: str) -> LightLevels:
    """Return the levels of a text such as ``lamp=1,sky=0.2``; others have their defaults.

    Raises:
        ValueError: unknown name, of which the message lists the known ones, or a value that is not 0 .. ``MAX_LEVEL``.
    """
    names, values = [field.name for field in fields(LightLevels)], dict[str, float]()
    for part in filter(None, text.split(",")):
        name, _, value = (each.strip() for each in part.partition("="))
        if name not in names:
            raise ValueError(f"{name!r} is not a light; use NAME=LEVEL with some of {', '.join(names)}")
        try:
            values[name] = float(value)
        except ValueError:
            values[name] = -1.0
        if not 0.0 <= values[name] <= MAX_LEVEL:
            raise ValueError(f"{name} must be 0 to {MAX_LEVEL:g}, not {value!r}")
    return LightLevels(**values)
