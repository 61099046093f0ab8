"""Extensions of glTF that the reader supports or ignores; a document that requires any other one is an error."""

from __future__ import annotations

from typing import Final

from gateway.gltf.errors import GltfError
from gateway.gltf.schema import Document

SUPPORTED: Final = frozenset(
    {
        "KHR_lights_punctual",
        "KHR_materials_emissive_strength",
        "KHR_materials_ior",
        "KHR_materials_pbrSpecularGlossiness",
        "KHR_materials_specular",
        "KHR_materials_unlit",
        "KHR_mesh_quantization",
        "KHR_texture_transform",
    }
)
IMAGE_FORMATS: Final = frozenset({"KHR_texture_basisu", "EXT_texture_webp", "EXT_texture_avif", "MSFT_texture_dds"})
"""Extensions that offer another image for a texture.

The texture's own image (PNG or JPEG) is used instead. A texture without one takes the image of EXT_texture_webp.
"""
IGNORED: Final = frozenset(
    {
        "KHR_materials_clearcoat",
        "KHR_materials_sheen",
        "KHR_materials_transmission",
        "KHR_materials_volume",
        "KHR_materials_iridescence",
        "KHR_materials_anisotropy",
        "KHR_materials_variants",
        "KHR_xmp_json_ld",
        "KHR_accessor_float64",
    }
)
"""Extensions that at most change the look: a document that requires them is rendered without them."""
_MAX_LISTED_CHARACTERS: Final = 500
"""Maximum number of characters of extension names in a message."""


def check_extensions(document: Document, warnings: list[str]) -> None:
    """Warn about extensions that are ignored.

    Raises:
        GltfError: The document requires an extension that is not supported.
    """
    required = {name for name in document.extensions_required or () if name}
    unknown = sorted(required - SUPPORTED - IMAGE_FORMATS - IGNORED)
    if unknown:
        raise GltfError(f"extensionsRequired: {', '.join(unknown)[:_MAX_LISTED_CHARACTERS]} cannot be read")
    used = {name for name in document.extensions_used or () if name}
    ignored = sorted(used - SUPPORTED - IMAGE_FORMATS)
    if ignored:
        warnings.append(f"extensionsUsed: {', '.join(ignored)[:_MAX_LISTED_CHARACTERS]} ignored")
