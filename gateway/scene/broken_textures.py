"""Takes out of geometry what would make every picture of the scene fail: textures that cannot be decoded."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import msgspec

from gateway.scene.geometry import Part
from renderers.drawlist import Image, ImageError, Material, Texture

TEXTURE_FIELDS: Final = (
    "base_color_texture",
    "metallic_roughness_texture",
    "normal_texture",
    "occlusion_texture",
    "emissive_texture",
)


def without_broken_textures(parts: tuple[Part, ...], max_pixels: int) -> tuple[Part, ...]:
    """The parts, their textures decoded once to see that it works; those that fail are left out.

    One client's broken picture in the live scene must not keep all others from theirs. What is decoded here is let go
    again at once.

    Args:
        max_pixels: of all different textures together; the ones beyond are left out, too.
    """
    usable: dict[Image, bool] = {}
    left = max_pixels
    materials: dict[Material, Material] = {}
    for part in parts:
        if part.material in materials:
            continue
        broken: dict[str, None] = {}
        for field in TEXTURE_FIELDS:
            texture: Texture | None = getattr(part.material, field)
            if texture is None:
                continue
            if texture.image not in usable:
                pixels = _pixels(texture.image)
                usable[texture.image] = pixels is not None and pixels <= left
                left -= pixels if pixels is not None and pixels <= left else 0
            if not usable[texture.image]:
                broken[field] = None
        materials[part.material] = replace(part.material, **broken) if broken else part.material  # type: ignore[arg-type]  # by name
    if all(old is new for old, new in materials.items()):
        return parts
    return tuple(msgspec.structs.replace(part, material=materials[part.material]) for part in parts)


def _pixels(image: Image) -> int | None:
    """How many pixels an image has; None when it cannot be decoded."""
    try:
        pixels = image.decode()
    except ImageError:
        return None
    return int(pixels.shape[0] * pixels.shape[1])
