"""Read requests in MessagePack (``treeviewer_msgpack``): the commands of the JSON format, with long arrays as bytes.

See docs/tree-viewer-binary.md.
"""

from __future__ import annotations

from typing import Any, Final

import msgspec
import numpy as np

from gateway.treeviewer import msgpack_kernels
from gateway.treeviewer.config import Limits
from gateway.treeviewer.context import MeshLoader
from gateway.treeviewer.fast_schema import message_type
from gateway.treeviewer.packed_arrays import EXTENSION, unpack
from gateway.treeviewer.request_reader import DECODE_ERRORS, RequestReader
from gateway.treeviewer.requests import Request, RequestError

FAULTS: Final = {
    msgpack_kernels.TRUNCATED: "it ends too early",
    msgpack_kernels.MALFORMED: "byte c1 is never used",
    msgpack_kernels.TRAILING_BYTES: "bytes follow its end",
}


class UnknownExtension:
    """An extension of another type than number arrays; it is ignored, or fails the field that it is in."""


def _decode_extension(code: int, payload: memoryview) -> object:
    return unpack(payload) if code == EXTENSION else UnknownExtension()


class MsgpackReader(RequestReader):
    """Reads requests in MessagePack."""

    type_text = "a MessagePack map"

    def __init__(self, limits: Limits | None = None, meshes: MeshLoader | None = None) -> None:
        super().__init__(limits, meshes)
        self._schema_decoder: msgspec.msgpack.Decoder[Any] = msgspec.msgpack.Decoder(message_type(self.limits))
        self._plain_decoder = msgspec.msgpack.Decoder(ext_hook=_decode_extension)

    def read(self, data: memoryview) -> Request:
        if len(data) > self.limits.binary_objects:  # each value takes a byte at least
            self._check_values(data)
        try:
            request = self.from_schema(self._schema_decoder.decode(data), self.context())
            if request is not None:
                return request
        except DECODE_ERRORS:
            pass
        try:
            message = self._plain_decoder.decode(data)
        except DECODE_ERRORS as error:
            raise RequestError(f"the request is not valid MessagePack ({error})") from None
        return self.from_plain(message, self.context())

    def _check_values(self, data: memoryview) -> None:
        """Raise RequestError if the request would become too many objects, before any is made."""
        limit = self.limits.binary_objects
        found = msgpack_kernels.count_values(np.frombuffer(data, np.uint8), limit)
        if found in FAULTS:
            raise RequestError(f"the request is not valid MessagePack ({FAULTS[found]})")
        if found > limit:
            raise RequestError(f"the request has more than {limit} objects besides its arrays, the limit")
