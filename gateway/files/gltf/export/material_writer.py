"""Writes materials, textures and images into a ``GltfDocument``."""

import math
from collections.abc import Iterable
from typing import Any, Final

from gateway.files.gltf.export.glb_document import GltfDocument
from renderers.drawlist import AlphaMode, ImageError, Material, Sampler, Texture
from renderers.encode import png_pixels

_NEAREST: Final = 9728
_LINEAR: Final = 9729
_MIN_FILTERS: Final = {(True, True): 9987, (True, False): _LINEAR, (False, True): 9984, (False, False): _NEAREST}
"""``minFilter`` by (linear interpolation within a level, with mipmaps)."""
_UNLIT: Final = "KHR_materials_unlit"
_TEXTURE_TRANSFORM: Final = "KHR_texture_transform"


class MaterialWriter:
    """Writes materials; equal materials are written once."""

    def __init__(self, document: GltfDocument) -> None:
        self._document = document

    def material(self, material: Material) -> int:
        """Write a material if it is new, and return its index."""
        return self._document.get_or_add(
            "material", material, lambda: self._document.add("materials", self._item(material))
        )

    def _item(self, material: Material) -> dict[str, Any]:
        metallic_roughness: dict[str, Any] = {
            "baseColorFactor": _clamped_factors(material.base_color),
            "metallicFactor": _clamped_factors((material.metallic,))[0],
            "roughnessFactor": _clamped_factors((material.roughness,))[0],
        }
        self._set_texture(metallic_roughness, "baseColorTexture", material.base_color_texture)
        self._set_texture(metallic_roughness, "metallicRoughnessTexture", material.metallic_roughness_texture)
        item: dict[str, Any] = {"pbrMetallicRoughness": metallic_roughness}
        self._set_texture(item, "normalTexture", material.normal_texture, scale=material.normal_scale)
        self._set_texture(item, "occlusionTexture", material.occlusion_texture, strength=material.occlusion_strength)
        self._set_texture(item, "emissiveTexture", material.emissive_texture)
        if any(material.emissive):
            item["emissiveFactor"] = _clamped_factors(material.emissive)
        if material.alpha_mode is not AlphaMode.OPAQUE:
            item["alphaMode"] = material.alpha_mode.value
        if material.alpha_mode is AlphaMode.MASK:
            item["alphaCutoff"] = float(material.alpha_cutoff)
        if material.double_sided:
            item["doubleSided"] = True
        if material.unlit:
            self._document.extensions.add(_UNLIT)
            item["extensions"] = {_UNLIT: {}}
        return item

    def _set_texture(self, owner: dict[str, Any], name: str, texture: Texture | None, **factors: float) -> None:
        """Set the texture property ``name`` in the JSON of a material, or a part of it, if its image can be decoded.

        ``factors``: ``scale`` or ``strength`` of the texture.
        """
        if texture is None:
            return
        image = self._document.get_or_add("image", texture.image, lambda: self._image(texture))
        if image is None:
            return
        index = self._document.get_or_add(
            "texture",
            (image, texture.sampler),
            lambda: self._document.add("textures", {"source": image, "sampler": self._sampler(texture.sampler)}),
        )
        info: dict[str, Any] = {"index": index}
        if texture.uv_set:
            info["texCoord"] = texture.uv_set
        info.update({field: value for field, value in factors.items() if value != 1.0 and math.isfinite(value)})
        if texture.uv_transform is not None:
            self._document.extensions.add(_TEXTURE_TRANSFORM)
            info["extensions"] = {_TEXTURE_TRANSFORM: _transform_extension(texture.uv_transform)}
        owner[name] = info

    def _image(self, texture: Texture) -> int | None:
        """Return the index of a texture's image: its PNG or JPEG file, else a PNG; None if it cannot be decoded."""
        image = texture.image
        data = getattr(image.decode, "data", None)
        mime_type = _mime_type(bytes(data[:12])) if isinstance(data, bytes | memoryview) else None
        if mime_type is None:
            try:
                data, mime_type = png_pixels(image.decode()), "image/png"
            except ImageError:
                return None
        assert data is not None
        item: dict[str, Any] = {"bufferView": self._document.add_buffer_view(bytes(data)), "mimeType": mime_type}
        if texture.name:
            item["name"] = texture.name
        return self._document.add("images", item)

    def _sampler(self, sampler: Sampler) -> int:
        item = {
            "wrapS": sampler.wrap_s.value,
            "wrapT": sampler.wrap_t.value,
            "magFilter": _LINEAR if sampler.mag_linear else _NEAREST,
            "minFilter": _MIN_FILTERS[sampler.min_linear, sampler.mipmaps],
        }
        return self._document.get_or_add("sampler", sampler, lambda: self._document.add("samplers", item))


def _clamped_factors(values: Iterable[float]) -> list[float]:
    """Clamp factors to 0 .. 1, as the specification requires; 1 for those that are not finite."""
    return [min(max(float(value), 0.0), 1.0) if math.isfinite(value) else 1.0 for value in values]


def _mime_type(start: bytes) -> str | None:
    """Return the type of an image file by its first bytes; None for other formats than PNG and JPEG."""
    if start.startswith(b"\x89PNG\r\n\x1a\n"):
        return "image/png"
    return "image/jpeg" if start.startswith(b"\xff\xd8\xff") else None


def _transform_extension(matrix: tuple[float, float, float, float, float, float]) -> dict[str, Any]:
    """Return KHR_texture_transform for a matrix offset * rotation * scale.

    ``matrix``: first two rows, (u_u, u_v, offset_u, v_u, v_v, offset_v).
    """
    u_u, u_v, offset_u, v_u, v_v, offset_v = matrix
    rotation = math.atan2(-v_u, u_u)
    return {
        "offset": [offset_u, offset_v],
        "rotation": rotation,
        "scale": [math.hypot(u_u, v_u), u_v * math.sin(rotation) + v_v * math.cos(rotation)],
    }
