"""Read tree viewer requests in JSON, the format ``treeviewer_json``. ``dispatch`` chooses the reader of a request."""

from __future__ import annotations

import json
from typing import Any, Final

import msgspec

from gateway.treeviewer.config import Limits
from gateway.treeviewer.context import ReadContext
from gateway.treeviewer.number_arrays import JsonError
from gateway.treeviewer.request_reader import DECODE_ERRORS, RequestReader
from gateway.treeviewer.requests import Request, RequestError

MIN_EXTRACT_BYTES: Final = 16 * 1024
"""Minimum size of requests whose long number arrays are parsed apart, by ``NumberArrays``."""


class JsonReader(RequestReader):
    """Reader of ``treeviewer_json`` requests."""

    type_text = "a JSON object"

    def __init__(self, limits: Limits | None = None) -> None:
        super().__init__(msgspec.json.Decoder, limits)

    def read(self, data: memoryview, context: ReadContext) -> Request:
        json_text = context.arrays.extract(data) if len(data) >= MIN_EXTRACT_BYTES else data
        if len(json_text) > self.limits.json_bytes:
            raise RequestError(f"the request has {len(json_text)} bytes of JSON, the limit is {self.limits.json_bytes}")
        try:
            return self.read_commands(self._decode_leniently(json_text), context)
        except JsonError as error:
            raise RequestError(f"the request is not valid JSON {error}") from None

    def _decode_leniently(self, json_text: bytes | memoryview) -> Any:
        """Return the decoded message.

        Python clients write NaN and Infinity, which msgspec refuses and Python's json accepts.
        """
        try:
            return self.decode(json_text)
        except DECODE_ERRORS:
            pass
        try:
            return json.loads(bytes(json_text).decode())
        except UnicodeDecodeError as error:
            raise JsonError(f"text: {error.reason} at byte {error.start}") from None
        except RecursionError:
            raise RequestError("the request is nested too deeply") from None
        except ValueError as error:  # not JSON, or an integer of more digits than Python converts
            raise JsonError(f"({error})") from None
