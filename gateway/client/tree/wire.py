"""Requests and answers as bytes: ``viewer2_comms_t`` around JSON or MessagePack (docs/tree-viewer-binary.md)."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import DTypeLike, NDArray

FINGERPRINT: Final = 0xD368E03F33C568BE
JSON: Final = "treeviewer_json"
BINARY: Final = "treeviewer_msgpack"
REQUEST: Final = "DIRECTOR_TREE_VIEWER_REQUEST"
RESPONSE: Final = "DIRECTOR_TREE_VIEWER_RESPONSE"
ROOM: Final = 16
"""Bytes before an array's numbers; the head needs 12, and numbers are quicker at their natural places."""
_ARRAY: Final = 1
_HEAD: Final = struct.Struct(">QqI")
_TAIL: Final = struct.Struct(">iii")


@dataclass(frozen=True, slots=True)
class Reply:
    """What a viewer said."""

    timestamp: int
    status: int
    body: dict[str, Any]


def encode(body: dict[str, Any], utime: int, name: str) -> NDArray[np.uint8]:
    """A request, (N,) uint8; ``name`` is that of the format.

    The body is made behind the head instead of being copied there: fresh memory costs a big one more than its encoding.
    liblcm takes arrays, but no bytearray.
    """
    text = name.encode() + b"\0"
    begin = _HEAD.size + len(text) + _TAIL.size
    buffer = bytearray(begin)
    if name == BINARY:
        _msgpack.encode_into(body, buffer, begin)
    else:
        _json.encode_into(_with_float_colors(body), buffer, begin)
    tail = _TAIL.pack(1, 0, len(buffer) - begin)
    buffer[:begin] = b"".join((_HEAD.pack(FINGERPRINT, utime, len(text)), text, tail))
    return np.frombuffer(buffer, np.uint8)


def decode(message: bytes) -> Reply | None:
    """An answer; None: something else is on the channel."""
    try:
        fingerprint, _, length = _HEAD.unpack_from(message)
        begin = _HEAD.size + length
        _, _, count = _TAIL.unpack_from(message, begin)
        name = message[_HEAD.size : begin - 1].decode()
        data = message[begin + _TAIL.size :][:count]
        if fingerprint != FINGERPRINT:
            return None
        body = (msgspec.msgpack if name == BINARY else msgspec.json).decode(data)
        return Reply(int(body["timestamp"]), int(body["status"]), body)
    except (struct.error, msgspec.DecodeError, UnicodeDecodeError, KeyError, TypeError, ValueError):
        return None


def with_room(shape: tuple[int, ...], kind: DTypeLike) -> NDArray[Any]:
    """An empty array with room for its head before it, so that it is sent without being copied once more."""
    dtype = np.dtype(kind)
    whole = np.empty(ROOM + math.prod(shape) * dtype.itemsize, np.uint8)
    return whole[ROOM:].view(dtype).reshape(shape)


def _has_room(array: NDArray[Any]) -> bool:
    """Whether it was made by ``with_room``."""
    whole = array.base
    return (
        isinstance(whole, np.ndarray)
        and whole.dtype == np.uint8
        and whole.shape == (ROOM + array.nbytes,)
        and array.flags.c_contiguous
        and array.ctypes.data == whole.ctypes.data + ROOM
    )


def _packed(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        kind = value.dtype.newbyteorder("<")
        head = struct.pack(f"<2sBx{value.ndim}I", kind.str[1:].encode(), value.ndim, *value.shape)
        if kind != value.dtype or not _has_room(value):
            copy = with_room(value.shape, kind)
            copy[...] = value
            value = copy
        payload = value.base
        payload[ROOM - len(head) : ROOM] = np.frombuffer(head, np.uint8)
        return msgspec.msgpack.Ext(_ARRAY, payload[ROOM - len(head) :].data)
    return _listed(value)


def _listed(value: Any) -> Any:
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be sent")


def _with_float_colors(body: dict[str, Any]) -> dict[str, Any]:
    """JSON has no types: colours of 0 to 255 become 0 to 1. What was given stays as it was, since it is remembered."""
    commands = [
        {**command, "geometries": [_with_floats(geometry) for geometry in command["geometries"]]}
        for command in body.get("setgeometry", ())
    ]
    return {**body, "setgeometry": commands} if commands else body


def _with_floats(geometry: Any) -> Any:
    channels = geometry.get("channels") if isinstance(geometry, dict) else None
    if not isinstance(channels, dict):
        return geometry
    floats = {
        name: channels[name] / np.float32(255.0)
        for name in ("rgb", "intensity")
        if isinstance(channels.get(name), np.ndarray) and channels[name].dtype == np.uint8
    }
    return {**geometry, "channels": {**channels, **floats}} if floats else geometry


_json: Final = msgspec.json.Encoder(enc_hook=_listed)
_msgpack: Final = msgspec.msgpack.Encoder(enc_hook=_packed)
