"""Read requests in both formats: JSON (``treeviewer_json``) and MessagePack (``treeviewer_msgpack``).

A list of regular transforms or solids is decoded to typed objects (docs/decisions/0016-fast-tree-viewer-requests.md). A
list with an irregular command, and all other commands, are decoded to dicts and lists, of which ``commands`` reads
every form that clients send. Long number arrays in JSON are parsed apart, by ``NumberArrays``; in MessagePack they are
extensions that hold their bytes (docs/tree-viewer-binary.md).
"""

import json
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import msgspec
import numpy as np

from gateway.adapters.treeviewer import fields, msgpack_kernels
from gateway.adapters.treeviewer.commands import COMMANDS, list_types, read_commands
from gateway.adapters.treeviewer.config import Limits
from gateway.adapters.treeviewer.context import ReadContext
from gateway.adapters.treeviewer.number_arrays import EXTENSION, unpack
from gateway.adapters.treeviewer.requests import REQUEST, Finding, Request, UnreadableRequestError
from scenegate.messages.field_kinds import show

DECODE_ERRORS: Final = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)
"""Raised by msgspec for data that it cannot decode."""
SMALL_JSON_BYTES: Final = 16 * 1024
"""Maximum size of JSON requests whose long number arrays are not parsed apart."""
SYNTAX_ERRORS: Final = {
    msgpack_kernels.TRUNCATED: "it ends too early",
    msgpack_kernels.UNUSED_BYTE: "byte c1 is never used",
    msgpack_kernels.TRAILING_BYTES: "bytes follow its end",
}
_NAMES: Final = frozenset((*COMMANDS, *(command.older_name for command in COMMANDS.values() if command.older_name)))
_OTHER_NAMES: Final = frozenset(("timestamp", "utime", "list"))
"""Names in a request that clients of Director send and no viewer reads; the last one is a C++ client's."""


class RequestReader(ABC):
    """Base class of the readers of both formats. Thread-safe."""

    type_text: str
    """Description of a request's outermost value, for error texts."""

    def __init__(self, make_decoder: Callable[[Any], Any], small_bytes: int, limits: Limits) -> None:
        """Requests of more than ``small_bytes`` are decoded after ``prepare_big``."""
        self.limits = limits
        self._small_bytes = small_bytes
        self._envelope_decoder = make_decoder(dict[str, msgspec.Raw])
        self._list_decoders = {name: make_decoder(list_type) for name, list_type in list_types(limits).items()}
        """Decoders of lists of regular commands, by name and older name."""
        self._list_decoders |= {COMMANDS[name].older_name: each for name, each in self._list_decoders.items()}
        self.any_decoder = make_decoder(Any)

    def read(self, data: memoryview, context: ReadContext) -> Request:
        """Return the commands of a request. Raises ThreadRequired (see ``ReadContext.at_once``), or RequestError."""
        prepared = data if len(data) <= self._small_bytes else self.prepare_big(data, context)
        try:
            message: Any = self._decode(prepared)
        except DECODE_ERRORS:  # NaN in JSON, keys that are no text in MessagePack: slower, but accepted
            message = self.decode_plain(prepared)
        request = Request()
        if message is None:
            return request
        if not isinstance(message, dict):
            raise UnreadableRequestError(f"the request must be {self.type_text}, not {show(message)}")
        for name, command in COMMANDS.items():
            used_name = command.older_name if command.older_name and command.older_name in message else name
            if (value := message.get(used_name)) is not None:
                if command.is_newer:
                    request.newer_commands.append(name)
                read_commands(name, value, request, context)
        fields.check_names(message, _NAMES | _OTHER_NAMES, "the request", context.warnings)
        request.warnings.extend(Finding(REQUEST, 0, text) for text in context.warnings)
        context.warnings.clear()
        return request

    @abstractmethod
    def prepare_big(self, data: memoryview, context: ReadContext) -> bytes | memoryview:
        """Return the part of a big request that is decoded; raise RequestError if it has errors or exceeds a limit."""

    @abstractmethod
    def decode_plain(self, data: bytes | memoryview) -> Any:
        """Return a request that ``_decode`` cannot decode as plain values; raise RequestError if that fails, too."""

    def _decode(self, data: bytes | memoryview) -> dict[str, Any]:
        """Return the lists of commands by name: those of regular commands as typed objects, others as plain values.

        What has another name is None. Raises DECODE_ERRORS if the data cannot be decoded, or is not an object.
        """
        lists: dict[str, Any] = {}
        for name, raw in self._envelope_decoder.decode(data).items():
            if name not in _NAMES:
                lists[name] = None
                continue
            try:
                lists[name] = self._list_decoders.get(name, self.any_decoder).decode(raw)
            except msgspec.ValidationError:
                lists[name] = self.any_decoder.decode(raw)
        return lists


class JsonReader(RequestReader):
    """Reader of ``treeviewer_json`` requests."""

    type_text = "a JSON object"

    def __init__(self, limits: Limits | None = None) -> None:
        limits = limits or Limits()
        super().__init__(msgspec.json.Decoder, min(SMALL_JSON_BYTES, limits.json_bytes), limits)

    def prepare_big(self, data: memoryview, context: ReadContext) -> bytes:
        """Return the JSON text without its long arrays."""
        json_text = context.arrays.extract(data)
        if len(json_text) > self.limits.json_bytes:
            raise UnreadableRequestError(
                f"the request has {len(json_text)} bytes of JSON, the limit is {self.limits.json_bytes}"
            )
        return json_text

    def decode_plain(self, data: bytes | memoryview) -> Any:
        """Decode by Python's json: Python clients write NaN and Infinity, which msgspec refuses."""
        try:
            return json.loads(bytes(data).decode())
        except UnicodeDecodeError as error:
            raise UnreadableRequestError(
                f"the request is not valid JSON text: {error.reason} at byte {error.start}"
            ) from None
        except RecursionError:
            raise UnreadableRequestError("the request is nested too deeply") from None
        except ValueError as error:  # not JSON, or an integer of more digits than Python converts
            raise UnreadableRequestError(f"the request is not valid JSON ({error})") from None


class UnknownExtension:
    """Placeholder of a MessagePack extension that is not a number array: an error in fields of the protocol only."""


class MsgpackReader(RequestReader):
    """Reader of ``treeviewer_msgpack`` requests."""

    type_text = "a MessagePack map"

    def __init__(self, limits: Limits | None = None) -> None:
        limits = limits or Limits()
        make_decoder = partial(
            msgspec.msgpack.Decoder,
            ext_hook=lambda code, payload: unpack(payload) if code == EXTENSION else UnknownExtension(),
        )
        # a request of fewer bytes has fewer objects than the limit: each takes at least a byte
        super().__init__(make_decoder, limits.binary_objects, limits)

    def prepare_big(self, data: memoryview, context: ReadContext) -> memoryview:
        """Return the data, unless decoding would create more Python objects than the limit."""
        limit = self.limits.binary_objects
        count_or_error = msgpack_kernels.count_values(np.frombuffer(data, np.uint8), limit)
        if count_or_error in SYNTAX_ERRORS:
            raise UnreadableRequestError(f"the request is not valid MessagePack ({SYNTAX_ERRORS[count_or_error]})")
        if count_or_error > limit:
            raise UnreadableRequestError(f"the request has more than {limit} objects besides its arrays, the limit")
        return data

    def decode_plain(self, data: bytes | memoryview) -> Any:
        """Decode to dicts and lists, for requests that are no maps of texts."""
        try:
            return self.any_decoder.decode(data)
        except DECODE_ERRORS as error:
            raise UnreadableRequestError(f"the request is not valid MessagePack ({error})") from None
