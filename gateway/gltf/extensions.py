"""Extensions of glTF that the reader supports, and the warning about those that it does not."""

from __future__ import annotations

from typing import Final

from gateway.gltf.schema import Document

SUPPORTED: Final = frozenset(
    {
        "EXT_mesh_gpu_instancing",
        "EXT_meshopt_compression",
        "EXT_texture_webp",
        "KHR_accessor_float64",
        "KHR_draco_mesh_compression",
        "KHR_lights_punctual",
        "KHR_materials_emissive_strength",
        "KHR_materials_ior",
        "KHR_materials_pbrSpecularGlossiness",
        "KHR_materials_specular",
        "KHR_materials_transmission",
        "KHR_materials_unlit",
        "KHR_materials_variants",
        "KHR_mesh_quantization",
        "KHR_node_visibility",
        "KHR_texture_transform",
    }
)
_IMAGE_FORMATS: Final = frozenset({"KHR_texture_basisu", "EXT_texture_avif", "MSFT_texture_dds"})
"""Extensions that offer another image for a texture. They give no warning here: the texture's own image (PNG or JPEG)
is used, and ``textures`` warns about a texture without one."""
_MAX_LISTED_CHARACTERS: Final = 500
"""Maximum number of characters of extension names in a message."""


def check_extensions(document: Document, warnings: list[str]) -> None:
    """Warn about extensions that are ignored. Required ones are no error, as in other viewers."""
    names = {name for name in (*(document.extensions_required or ()), *(document.extensions_used or ())) if name}
    ignored = sorted(names - SUPPORTED - _IMAGE_FORMATS)
    if ignored:
        warnings.append(f"extensionsUsed: {', '.join(ignored)[:_MAX_LISTED_CHARACTERS]} ignored")
