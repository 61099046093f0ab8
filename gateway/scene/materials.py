"""Materials of geometries that clients publish with a colour."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Final

from renderers.color import linear_from_srgb
from renderers.drawlist import AlphaMode, Material

Color = tuple[float, float, float, float]
"""Red, green, blue (sRGB) and alpha from 0 to 1."""
WHITE: Final[Color] = (1.0, 1.0, 1.0, 1.0)
POINT_SIZE: Final = 2.0
"""Diameter of points in pixels, as in Director."""


@lru_cache(maxsize=4096)
def material(rgba: Color) -> Material:
    """Return a diffuse, double-sided material, as Director and Drake draw geometries of this colour."""
    r, g, b, a = rgba
    return Material(
        base_color=(linear_from_srgb(r), linear_from_srgb(g), linear_from_srgb(b), a),
        metallic=0.0,
        roughness=1.0,
        alpha_mode=AlphaMode.BLEND if a < 1.0 else AlphaMode.OPAQUE,
        double_sided=True,
        point_size=POINT_SIZE,
    )


@lru_cache(maxsize=4096)
def faded(source: Material, opacity: float) -> Material:
    """Return a material whose alpha is multiplied by the opacity of its node, 0 to 1."""
    r, g, b, alpha = source.base_color
    return replace(source, base_color=(r, g, b, alpha * opacity), alpha_mode=AlphaMode.BLEND)


def tinted(source: Material, rgba: Color) -> Material:
    """Return the material of a mesh file, multiplied by the command's colour."""
    if rgba == WHITE:
        return source
    r, g, b, a = rgba
    base = source.base_color
    alpha = base[3] * a
    return replace(
        source,
        base_color=(base[0] * linear_from_srgb(r), base[1] * linear_from_srgb(g), base[2] * linear_from_srgb(b), alpha),
        alpha_mode=AlphaMode.BLEND if a < 1.0 and source.alpha_mode is AlphaMode.OPAQUE else source.alpha_mode,
    )
