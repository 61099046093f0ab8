"""Converts textures that robot files name and that are not PNG, JPEG or WebP, as those of mesh files are."""

from __future__ import annotations

from typing import Final

import msgspec

from gateway.assets.mesh_formats import PARSER_LIMITS
from gateway.runtime.limited_process import ProcessFailed, call_limited
from renderers.drawlist import ImageError
from renderers.images import image_header

_result_decoder: Final = msgspec.msgpack.Decoder(bytes | None)


def decodable_texture(data: bytes) -> bytes:
    """Return the PNG file of an image in a format that mesh files may use, such as TGA; other data as they are.

    Raises:
        Exception: The current ``StopFlag`` was set, with its error.
    """
    try:
        image_header(data)
    except ImageError:
        limits = PARSER_LIMITS.for_size(len(data))
        try:
            converted = _result_decoder.decode(
                call_limited("gateway.parsers.texture_files:read_texture", (data,), limits)
            )
        except ProcessFailed:
            return data
        return data if converted is None else converted
    return data
