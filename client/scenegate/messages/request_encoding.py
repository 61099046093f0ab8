"""Encode requests and decode responses, in JSON or in MessagePack by docs/tree-viewer-binary.md."""

import math
import struct
from dataclasses import dataclass
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import DTypeLike, NDArray

from scenegate.messages import wire
from scenegate.png import encode_png

HEADER_BYTES: Final = 16
"""Reserved before an array's numbers for its header (at most 12 bytes), padded to 16 for alignment."""
_ARRAY_EXTENSION: Final = 1
"""MessagePack type code of number arrays."""


@dataclass(frozen=True, slots=True)
class Response:
    """A viewer's response."""

    timestamp: int
    """``utime`` of the request."""
    status: int
    body: dict[str, Any]
    """All fields of the response."""


def encode_request(body: dict[str, Any], utime: int, message_format: str) -> bytearray:
    """Return a request, the protocol's JSON object with NumPy arrays in place of long lists, as LCM message.

    The body is encoded directly behind the header, because copying a large body takes longer than encoding it.
    ``utime``: microseconds since 1970. ``message_format``: ``wire.JSON`` or ``wire.BINARY``.
    """
    body_start = len(wire.header(0, utime, message_format))
    buffer = bytearray(body_start)
    if message_format == wire.BINARY:
        _msgpack.encode_into(body, buffer, body_start)
    else:
        _json.encode_into(_with_json_values(body), buffer, body_start)
    buffer[:body_start] = wire.header(len(buffer) - body_start, utime, message_format)
    return buffer


def decode_response(message: bytes) -> Response | None:
    """Return the response in an LCM message, or None if the message is not a response."""
    try:
        comms = wire.decode(message)
        body = (msgspec.msgpack if comms.format == wire.BINARY else msgspec.json).decode(comms.data)
        return Response(int(body["timestamp"]), int(body["status"]), body)
    except (msgspec.DecodeError, KeyError, TypeError, ValueError, OverflowError, RecursionError):
        return None


def empty_with_header(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Return an uninitialised array with ``HEADER_BYTES`` of memory before it.

    ``pack`` writes the array's header there, so that the header and the numbers are sent without a copy.
    """
    dtype = np.dtype(dtype)
    memory = np.empty(HEADER_BYTES + math.prod(shape) * dtype.itemsize, np.uint8)
    return memory[HEADER_BYTES:].view(dtype).reshape(shape)


def pack(value: Any) -> Any:
    """Return a NumPy array as a MessagePack extension, a NumPy number as a Python number (msgspec's ``enc_hook``)."""
    if not isinstance(value, np.ndarray):
        return _to_python(value)
    dtype = value.dtype.newbyteorder("<")
    header = struct.pack(f"<2sBx{value.ndim}I", dtype.str[1:].encode(), value.ndim, *value.shape)
    if dtype != value.dtype or not _has_header(value):
        copy = empty_with_header(value.shape, dtype)
        copy[...] = value
        value = copy
    memory = value.base
    assert memory is not None
    memory[HEADER_BYTES - len(header) : HEADER_BYTES] = np.frombuffer(header, np.uint8)
    return msgspec.msgpack.Ext(_ARRAY_EXTENSION, memory[HEADER_BYTES - len(header) :].data)


def _has_header(array: NDArray[Any]) -> bool:
    """Return True if an array was made by ``empty_with_header``."""
    memory = array.base
    return (
        isinstance(memory, np.ndarray)
        and memory.dtype == np.uint8
        and memory.shape == (HEADER_BYTES + array.nbytes,)
        and array.flags.c_contiguous
        and array.ctypes.data == memory.ctypes.data + HEADER_BYTES
    )


def _to_python(value: Any) -> Any:
    """Return a NumPy array as lists, a NumPy number as a Python number (msgspec's ``enc_hook``)."""
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be sent")


def _with_json_values(body: dict[str, Any]) -> dict[str, Any]:
    """Return a body for JSON: uint8 colours as floats from 0 to 1, since JSON does not tell 0-255 from 0-1, and the
    pixels of images as PNG files, which the encoder writes as base64."""
    commands = [
        {**command, "geometries": [_with_json_fields(geometry) for geometry in command["geometries"]]}
        if "geometries" in command
        else command
        for command in body.get("setgeometry", ())
    ]
    return {**body, "setgeometry": commands} if commands else body


def _with_json_fields(geometry: Any) -> Any:
    """Return a geometry without uint8 arrays."""
    if not isinstance(geometry, dict):
        return geometry
    result = {**geometry, **_floats_of_colors(geometry, "colors")}
    channels = geometry.get("channels")
    if isinstance(channels, dict):
        result["channels"] = {**channels, **_floats_of_colors(channels, "rgb", "intensity")}
    if isinstance(geometry.get("image"), np.ndarray):
        result["image"] = encode_png(geometry["image"])
    return result


def _floats_of_colors(fields: dict[str, Any], *names: str) -> dict[str, Any]:
    """Return those of the named fields that are uint8 arrays, as floats from 0 to 1."""
    return {
        name: fields[name] / np.float32(255.0)
        for name in names
        if isinstance(fields.get(name), np.ndarray) and fields[name].dtype == np.uint8
    }


_json: Final = msgspec.json.Encoder(enc_hook=_to_python)
_msgpack: Final = msgspec.msgpack.Encoder(enc_hook=pack)
