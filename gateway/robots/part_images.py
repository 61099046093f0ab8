"""Encodes the texture and the vertex colours of a part's mesh as fields of a published ``Mesh``."""

from __future__ import annotations

from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from renderers.color import srgb_colors_from_linear
from renderers.drawlist import AlphaMode, Image, ImageError, Material, Mesh, Texture
from renderers.encode import jpeg_rgb, png_rgb, png_rgba

MAX_IMAGE_SIDE: Final = 2048
"""Maximum width and height of a published texture, pixels. Larger ones are reduced: a message has at most 256 MiB."""
MAX_PNG_BYTES: Final = 1 << 20
"""Maximum size of the PNG file of an opaque texture. A larger texture, such as a photograph, is sent as JPEG."""
_JPEG_QUALITY: Final = 95


class PartImages:
    """Encodes textures. An image that several parts use is encoded once."""

    def __init__(self) -> None:
        self._encoded: dict[tuple[Image, bool], bytes | None] = {}

    def fields(self, mesh: Mesh, material: Material) -> dict[str, Any]:
        """Return those of the fields ``colors``, ``uv`` and ``image`` for which the mesh and its material have data."""
        fields: dict[str, Any] = {}
        if mesh.colors is not None:
            fields["colors"] = np.clip(srgb_colors_from_linear(mesh.colors), 0.0, 1.0)
        texture = material.base_color_texture
        uv = _texture_coordinates(mesh, texture) if texture is not None else None
        if texture is not None and uv is not None:
            image = self._encode(texture.image, material.alpha_mode is not AlphaMode.OPAQUE)
            if image is not None:
                fields |= {"uv": uv, "image": image}
        return fields

    def _encode(self, image: Image, has_alpha: bool) -> bytes | None:
        """Return a PNG or JPEG file; None if the image cannot be decoded."""
        key = image, has_alpha
        if key not in self._encoded:
            try:
                self._encoded[key] = _encoded_file(image.decode(), has_alpha)
            except ImageError:
                self._encoded[key] = None
        return self._encoded[key]


def _texture_coordinates(mesh: Mesh, texture: Texture) -> NDArray[np.float32] | None:
    """Return the texture's coordinates, (N, 2) float32; None if the mesh has none."""
    uv = mesh.uv1 if texture.uv_set == 1 else mesh.uv0
    if uv is None or texture.uv_transform is None:
        return uv
    a, b, c, d, e, f = texture.uv_transform
    return np.stack((a * uv[:, 0] + b * uv[:, 1] + c, d * uv[:, 0] + e * uv[:, 1] + f), axis=1).astype(np.float32)


def _encoded_file(pixels: NDArray[np.uint8], has_alpha: bool) -> bytes:
    """Return a PNG or JPEG file of (H, W, 4) uint8 pixels."""
    longest = max(pixels.shape[:2])
    if longest > MAX_IMAGE_SIDE:
        size = [max(1, side * MAX_IMAGE_SIDE // longest) for side in (pixels.shape[1], pixels.shape[0])]
        pixels = np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), np.uint8)
    if has_alpha:
        return png_rgba(np.ascontiguousarray(pixels))
    rgb = np.ascontiguousarray(pixels[..., :3])
    png = png_rgb(rgb)
    return png if len(png) <= MAX_PNG_BYTES else jpeg_rgb(rgb, quality=_JPEG_QUALITY)
