"""Read tree viewer requests in JSON, the format ``treeviewer_json``. ``dispatch`` chooses the reader of a request."""

from __future__ import annotations

import json
from typing import Any, Final

import msgspec

from gateway.treeviewer.config import Limits
from gateway.treeviewer.context import ReadContext
from gateway.treeviewer.request_reader import RequestReader
from gateway.treeviewer.requests import RequestError

SMALL_BYTES: Final = 16 * 1024
"""Maximum size of requests whose long number arrays are not parsed apart, by ``NumberArrays``."""


class JsonReader(RequestReader):
    """Reader of ``treeviewer_json`` requests."""

    type_text = "a JSON object"

    def __init__(self, limits: Limits | None = None) -> None:
        limits = limits or Limits()
        super().__init__(msgspec.json.Decoder, small_bytes=min(SMALL_BYTES, limits.json_bytes), limits=limits)

    def prepare_big(self, data: memoryview, context: ReadContext) -> bytes:
        """Return the JSON text without its long arrays."""
        json_text = context.arrays.extract(data)
        if len(json_text) > self.limits.json_bytes:
            raise RequestError(f"the request has {len(json_text)} bytes of JSON, the limit is {self.limits.json_bytes}")
        return json_text

    def decode_plain(self, data: bytes | memoryview) -> Any:
        """Decode by Python's json: Python clients write NaN and Infinity, which msgspec refuses."""
        try:
            return json.loads(bytes(data).decode())
        except UnicodeDecodeError as error:
            raise RequestError(f"the request is not valid JSON text: {error.reason} at byte {error.start}") from None
        except RecursionError:
            raise RequestError("the request is nested too deeply") from None
        except ValueError as error:  # not JSON, or an integer of more digits than Python converts
            raise RequestError(f"the request is not valid JSON ({error})") from None
