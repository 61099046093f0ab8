"""Read tree viewer requests in JSON, the format ``treeviewer_json``. ``dispatch`` chooses the reader of a request."""

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
"""Minimum size of requests whose long number arrays are parsed apart, by ``NumberArrays``."""


class JsonReader(RequestReader):
    """Reader of ``treeviewer_json`` requests."""

    type_text = "a JSON object"

    def __init__(self, limits: Limits | None = None, *, strict: bool = False) -> None:
        super().__init__(limits, strict=strict)
        self._schema_decoder: msgspec.json.Decoder[Any] = msgspec.json.Decoder(message_type(self.limits))
        self._plain_decoder = msgspec.json.Decoder()

    def read(self, data: memoryview, meshes: MeshLoader | None = None) -> Request:
        context = self.context(meshes)
        json_text = context.arrays.extract(data) if len(data) >= MIN_EXTRACT_BYTES else data
        if len(json_text) > self.limits.json_bytes:
            raise RequestError(f"the request has {len(json_text)} bytes of JSON, the limit is {self.limits.json_bytes}")
        try:
            request = self.from_schema(self._schema_decoder.decode(json_text), context)
            if request is not None:
                return request
        except DECODE_ERRORS:
            pass
        try:
            return self.from_plain(self._decode_plain(json_text), context)
        except JsonError as error:
            raise RequestError(f"the request is not valid JSON {error}") from None

    def _decode_plain(self, json_text: bytes | memoryview) -> Any:
        """Return dicts, lists, strings and numbers.

        Python clients write NaN and Infinity, which msgspec refuses and Python's json accepts.
        """
        try:
            return self._plain_decoder.decode(json_text)
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
