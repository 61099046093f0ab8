"""Removes textures that cannot be decoded. Such a texture would make every image of the live scene fail."""

from __future__ import annotations

from dataclasses import replace

import msgspec

from gateway.scene.geometry import Part
from gateway.scene.materials import TEXTURE_FIELDS
from renderers.drawlist import Image, ImageError, Material, Texture


def without_broken_textures(parts: tuple[Part, ...], max_pixels: int, warnings: list[str]) -> tuple[Part, ...]:
    """Return the parts without textures that cannot be decoded.

    A broken texture from one client must not break images for the other clients. Each texture is decoded once as a
    test; its pixels are not kept.

    Args:
        max_pixels: Maximum total number of pixels, each different image counted once. A texture beyond it is removed,
            too.
        warnings: A sentence is appended for each image that is removed.
    """
    is_usable: dict[Image, bool] = {}
    remaining_pixels = max_pixels
    materials: dict[Material, Material] = {}
    for part in parts:
        if part.material in materials:
            continue
        broken: dict[str, None] = {}
        for field in TEXTURE_FIELDS:
            texture: Texture | None = getattr(part.material, field)
            if texture is None:
                continue
            if texture.image not in is_usable:
                problem, pixels = _check(texture.image, remaining_pixels)
                is_usable[texture.image] = not problem
                if problem:
                    warnings.append(f"{texture.name[:120]!r} is left out: {problem}")
                else:
                    remaining_pixels -= pixels
            if not is_usable[texture.image]:
                broken[field] = None
        materials[part.material] = replace(part.material, **broken) if broken else part.material  # type: ignore[arg-type]
    if all(old is new for old, new in materials.items()):
        return parts
    return tuple(msgspec.structs.replace(part, material=materials[part.material]) for part in parts)


def _check(image: Image, remaining_pixels: int) -> tuple[str, int]:
    """Return why an image cannot be used, or an empty text, and its number of pixels."""
    try:
        pixels = image.decode()
    except ImageError as error:
        return str(error), 0
    count = int(pixels.shape[0] * pixels.shape[1])
    if count > remaining_pixels:
        return f"it has {count} pixels, and {remaining_pixels} are left to all textures", 0
    return "", count
