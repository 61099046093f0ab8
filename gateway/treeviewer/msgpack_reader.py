"""Read tree viewer requests in MessagePack, the format ``treeviewer_msgpack``.

The commands are those of the JSON format; long number arrays are extensions that hold their bytes. See
docs/tree-viewer-binary.md.
"""

from __future__ import annotations

from functools import partial
from typing import Any, Final

import msgspec
import numpy as np

from gateway.treeviewer import msgpack_kernels
from gateway.treeviewer.config import Limits
from gateway.treeviewer.context import ReadContext
from gateway.treeviewer.packed_arrays import EXTENSION, unpack
from gateway.treeviewer.request_reader import DECODE_ERRORS, RequestReader
from gateway.treeviewer.requests import RequestError

SYNTAX_ERRORS: Final = {
    msgpack_kernels.TRUNCATED: "it ends too early",
    msgpack_kernels.UNUSED_BYTE: "byte c1 is never used",
    msgpack_kernels.TRAILING_BYTES: "bytes follow its end",
}


class UnknownExtension:
    """Placeholder of an extension that is not a number array.

    In a field that the protocol defines it is an error; elsewhere it is ignored.
    """


def _decode_extension(code: int, payload: memoryview) -> object:
    """Return the value of an extension (msgspec's ``ext_hook``)."""
    return unpack(payload) if code == EXTENSION else UnknownExtension()


class MsgpackReader(RequestReader):
    """Reader of ``treeviewer_msgpack`` requests."""

    type_text = "a MessagePack map"

    def __init__(self, limits: Limits | None = None) -> None:
        limits = limits or Limits()
        make_decoder = partial(msgspec.msgpack.Decoder, ext_hook=_decode_extension)
        # a request of fewer bytes has fewer objects than the limit: each takes at least a byte
        super().__init__(make_decoder, small_bytes=limits.binary_objects, limits=limits)

    def prepare_big(self, data: memoryview, context: ReadContext) -> memoryview:
        """Return the data, unless decoding would create more Python objects than the limit."""
        limit = self.limits.binary_objects
        count_or_error = msgpack_kernels.count_values(np.frombuffer(data, np.uint8), limit)
        if count_or_error in SYNTAX_ERRORS:
            raise RequestError(f"the request is not valid MessagePack ({SYNTAX_ERRORS[count_or_error]})")
        if count_or_error > limit:
            raise RequestError(f"the request has more than {limit} objects besides its arrays, the limit")
        return data

    def decode_plain(self, data: bytes | memoryview) -> Any:
        """Decode to dicts and lists, for requests that are no maps of texts."""
        try:
            return self.any_decoder.decode(data)
        except DECODE_ERRORS as error:
            raise RequestError(f"the request is not valid MessagePack ({error})") from None
