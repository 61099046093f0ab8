"""Frames of the browser view, as tests read them."""

from typing import Any

import msgspec

from gateway.adapters.viewer.frames import MAGIC, PREFIX


def parse_frame(frame: bytes) -> tuple[dict[str, Any], memoryview]:
    """Split a frame into its header and its body.

    Raises:
        ValueError: ``frame`` has no valid prefix, or ends within its header.
    """
    if len(frame) < PREFIX.size or PREFIX.unpack_from(frame)[0] != MAGIC:
        raise ValueError("not a view frame: it does not start with SGV1")
    end = PREFIX.size + PREFIX.unpack_from(frame)[1]
    if end > len(frame):
        raise ValueError(f"view frame of {len(frame)} bytes ends within its header of {end - PREFIX.size} bytes")
    return msgspec.json.decode(frame[PREFIX.size : end]), memoryview(frame)[end:]
