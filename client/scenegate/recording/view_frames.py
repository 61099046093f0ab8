"""Frames of the gateway's view, ``/view/ws``: a JSON header and arrays. ``gateway.viewer.frames`` writes them."""

from __future__ import annotations

import struct
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import DTypeLike, NDArray

MAGIC: Final = 0x31564753
"""The bytes "SGV1" as a little-endian integer."""
_PREFIX: Final = struct.Struct("<II")


class ViewFrameError(ValueError):
    """A frame is invalid; the message is one sentence."""


class ViewFrame:
    """A frame that was received."""

    def __init__(self, data: bytes) -> None:
        """
        Raises:
            ViewFrameError: it has no valid prefix or header, or ends within its header.
        """
        magic, header_bytes = _PREFIX.unpack_from(data) if len(data) >= _PREFIX.size else (None, 0)
        if magic != MAGIC:
            raise ViewFrameError("not a frame of Scenegate's view: it does not start with SGV1")
        end = _PREFIX.size + header_bytes
        if end > len(data):
            raise ViewFrameError(f"a frame of {len(data)} bytes ends within its header of {header_bytes} bytes")
        try:
            self.header: dict[str, Any] = msgspec.json.decode(data[_PREFIX.size : end], type=dict[str, Any])
        except msgspec.DecodeError as error:
            raise ViewFrameError(f"a frame's header is not a JSON object: {error}") from None
        self._body = memoryview(data)[end:]

    def array(self, reference: Any, dtype: DTypeLike) -> NDArray[Any]:
        """Return an array of the body, (N,), read-only.

        Args:
            reference: ``[offset, count]`` of the header: bytes from the start of the body, number of values.

        Raises:
            ViewFrameError: the array is not within the body.
        """
        try:
            offset, count = (int(number) for number in reference)
            return np.frombuffer(self._body, dtype, count, offset)
        except (TypeError, ValueError):
            raise ViewFrameError(f"a frame of {len(self._body)} bytes has no array at {reference!r}") from None
