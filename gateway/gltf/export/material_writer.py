"""Materials, textures and images of a glTF document under construction."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, Final

from gateway.gltf.export.glb_document import GltfDocument
from renderers.drawlist import AlphaMode, ImageError, Material, Sampler, Texture
from renderers.encode import png_rgba

_MIN_FILTERS: Final = {(True, True): 9987, (True, False): 9729, (False, True): 9984, (False, False): 9728}
"""By (linear, mipmaps)."""
_UNLIT: Final = "KHR_materials_unlit"
_TRANSFORM: Final = "KHR_texture_transform"


class MaterialWriter:
    """Writes materials; equal ones once."""

    def __init__(self, document: GltfDocument) -> None:
        self._document = document

    def material(self, material: Material) -> int:
        """Return the index of a material."""
        index = self._document.once_equal(
            "material", material, lambda: self._document.add("materials", self._entry(material))
        )
        assert index is not None
        return index

    def _entry(self, material: Material) -> dict[str, Any]:
        metallic_roughness: dict[str, Any] = {
            "baseColorFactor": _units(material.base_color),
            "metallicFactor": _units((material.metallic,))[0],
            "roughnessFactor": _units((material.roughness,))[0],
        }
        self._put_texture(metallic_roughness, "baseColorTexture", material.base_color_texture)
        self._put_texture(metallic_roughness, "metallicRoughnessTexture", material.metallic_roughness_texture)
        entry: dict[str, Any] = {"pbrMetallicRoughness": metallic_roughness}
        self._put_texture(entry, "normalTexture", material.normal_texture, scale=material.normal_scale)
        self._put_texture(entry, "occlusionTexture", material.occlusion_texture, strength=material.occlusion_strength)
        self._put_texture(entry, "emissiveTexture", material.emissive_texture)
        if any(material.emissive):
            entry["emissiveFactor"] = _units(material.emissive)
        if material.alpha_mode is not AlphaMode.OPAQUE:
            entry["alphaMode"] = material.alpha_mode.value
        if material.alpha_mode is AlphaMode.MASK:
            entry["alphaCutoff"] = float(material.alpha_cutoff)
        if material.double_sided:
            entry["doubleSided"] = True
        if material.unlit:
            self._document.extensions.add(_UNLIT)
            entry["extensions"] = {_UNLIT: {}}
        return entry

    def _put_texture(self, entry: dict[str, Any], name: str, texture: Texture | None, **more: float) -> None:
        """Write a texture, unless its image cannot be decoded."""
        if texture is None:
            return
        image = self._document.once("image", texture.image, lambda: self._image(texture))
        if image is None:
            return
        index = self._document.once_equal(
            "texture",
            (image, texture.sampler),
            lambda: self._document.add("textures", {"source": image, "sampler": self._sampler(texture.sampler)}),
        )
        info: dict[str, Any] = {"index": index}
        if texture.uv_set:
            info["texCoord"] = texture.uv_set
        info.update({field: value for field, value in more.items() if value != 1.0 and math.isfinite(value)})
        if texture.uv_transform is not None:
            self._document.extensions.add(_TRANSFORM)
            info["extensions"] = {_TRANSFORM: _uv_transform(texture.uv_transform)}
        entry[name] = info

    def _image(self, texture: Texture) -> int | None:
        """Return the index of a texture's image: its own PNG or JPEG file, else a PNG of its pixels."""
        image = texture.image
        data = getattr(image.decode, "data", None)
        kind = _media_type(bytes(data[:12])) if isinstance(data, bytes | memoryview) else None
        if kind is None:
            try:
                data, kind = png_rgba(image.decode()), "image/png"
            except ImageError:
                return None
        assert data is not None
        entry: dict[str, Any] = {"bufferView": self._document.view(bytes(data)), "mimeType": kind}
        if texture.name:
            entry["name"] = texture.name
        return self._document.add("images", entry)

    def _sampler(self, sampler: Sampler) -> int:
        index = self._document.once_equal(
            "sampler",
            sampler,
            lambda: self._document.add(
                "samplers",
                {
                    "wrapS": sampler.wrap_s.value,
                    "wrapT": sampler.wrap_t.value,
                    "magFilter": 9729 if sampler.mag_linear else 9728,
                    "minFilter": _MIN_FILTERS[sampler.min_linear, sampler.mipmaps],
                },
            ),
        )
        assert index is not None
        return index


def _units(values: Iterable[float]) -> list[float]:
    """Clamp factors to 0 .. 1, as the specification requires."""
    return [min(max(float(value), 0.0), 1.0) if math.isfinite(value) else 1.0 for value in values]


def _media_type(start: bytes) -> str | None:
    if start.startswith(b"\x89PNG\r\n\x1a\n"):
        return "image/png"
    return "image/jpeg" if start.startswith(b"\xff\xd8\xff") else None


def _uv_transform(values: tuple[float, float, float, float, float, float]) -> dict[str, Any]:
    """Return offset, rotation and scale of KHR_texture_transform from a matrix T R S without shear."""
    a, b, c, d, e, f = values
    rotation = math.atan2(-d, a)
    return {
        "offset": [c, f],
        "rotation": rotation,
        "scale": [math.hypot(a, d), b * math.sin(rotation) + e * math.cos(rotation)],
    }
