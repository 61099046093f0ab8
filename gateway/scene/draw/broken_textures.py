"""Removes textures that cannot be decoded. Such a texture would make every image of the live scene fail."""

from dataclasses import replace

import msgspec

from gateway.scene.tree.geometry import Part
from gateway.scene.tree.materials import TEXTURE_FIELDS
from renderers.drawlist import Image, ImageError, Material, Texture


def without_broken_textures(parts: tuple[Part, ...], max_pixels: int, warnings: list[str]) -> tuple[Part, ...]:
    """Return the parts without textures that cannot be decoded, or are above ``max_pixels``; append warnings.

    A broken texture from one client must not break images for the other clients. Each texture is decoded once as a
    test; its pixels are not kept. Equal images count once.
    """
    is_usable: dict[Image, bool] = {}
    pixels_left = max_pixels
    materials: dict[Material, Material] = {}
    for material in dict.fromkeys(part.material for part in parts):
        fields: dict[str, Texture | None] = {field: getattr(material, field) for field in TEXTURE_FIELDS}
        textures = {field: texture for field, texture in fields.items() if texture is not None}
        for texture in textures.values():
            if texture.image in is_usable:
                continue
            try:
                height, width = texture.image.decode().shape[:2]
                problem = f"it has {height * width} pixels, and {pixels_left} are left to all textures"
                is_usable[texture.image] = height * width <= pixels_left
            except ImageError as error:
                problem, is_usable[texture.image] = str(error), False
            if is_usable[texture.image]:
                pixels_left -= height * width
            else:
                warnings.append(f"{texture.name[:120]!r} is left out: {problem}")
        broken = {field: None for field, texture in textures.items() if not is_usable[texture.image]}
        # mypy does not know that only textures, which may be None, are named.
        materials[material] = replace(material, **broken) if broken else material  # type: ignore[arg-type]
    if all(old is new for old, new in materials.items()):
        return parts
    return tuple(msgspec.structs.replace(part, material=materials[part.material]) for part in parts)
