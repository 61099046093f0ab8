"""Read requests in JSON (``treeviewer_json``)."""

from __future__ import annotations

import json
from typing import Any, Final

import msgspec

from gateway.treeviewer.config import Limits
from gateway.treeviewer.context import MeshLoader
from gateway.treeviewer.fast_schema import message_type
from gateway.treeviewer.number_arrays import JsonError
from gateway.treeviewer.request_reader import DECODE_ERRORS, RequestReader
from gateway.treeviewer.requests import Request, RequestError

MIN_EXTRACT_BYTES: Final = 16 * 1024
"""Long number arrays are taken out of requests of this size and more."""


class JsonReader(RequestReader):
    """Reads requests in JSON."""

    type_text = "a JSON object"

    def __init__(self, limits: Limits | None = None, meshes: MeshLoader | None = None) -> None:
        super().__init__(limits, meshes)
        self._schema_decoder: msgspec.json.Decoder[Any] = msgspec.json.Decoder(message_type(self.limits))
        self._plain_decoder = msgspec.json.Decoder()

    def read(self, data: memoryview) -> Request:
        context = self.context()
        body = context.arrays.extract(data) if len(data) >= MIN_EXTRACT_BYTES else data
        if len(body) > self.limits.json_bytes:
            raise RequestError(f"the request has {len(body)} bytes of JSON, the limit is {self.limits.json_bytes}")
        try:
            request = self.from_schema(self._schema_decoder.decode(body), context)
            if request is not None:
                return request
        except DECODE_ERRORS:
            pass
        try:
            return self.from_plain(self._decode_any(body), context)
        except JsonError as error:
            raise RequestError(f"the request is not valid JSON {error}") from None

    def _decode_any(self, body: bytes | memoryview) -> Any:
        """Return plain objects, by Python's json if msgspec refuses: Python clients write bare NaN and Infinity."""
        try:
            return self._plain_decoder.decode(body)
        except DECODE_ERRORS:
            pass
        try:
            return json.loads(bytes(body).decode())
        except UnicodeDecodeError as error:
            raise JsonError(f"text: {error.reason} at byte {error.start}") from None
        except RecursionError:
            raise RequestError("the request is nested too deeply") from None
        except ValueError as error:  # JSONDecodeError, and integers of thousands of digits
            raise JsonError(f"({error})") from None
