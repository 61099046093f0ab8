"""Requests and answers as bytes: ``viewer2_comms_t`` around JSON or MessagePack (docs/tree-viewer-binary.md)."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any, Final

import msgspec
import numpy as np

FINGERPRINT: Final = 0xD368E03F33C568BE
JSON: Final = "treeviewer_json"
BINARY: Final = "treeviewer_msgpack"
REQUEST: Final = "DIRECTOR_TREE_VIEWER_REQUEST"
RESPONSE: Final = "DIRECTOR_TREE_VIEWER_RESPONSE"
_ARRAY: Final = 1
_HEAD: Final = struct.Struct(">QqI")
_TAIL: Final = struct.Struct(">iii")


@dataclass(frozen=True, slots=True)
class Reply:
    """What a viewer said."""

    timestamp: int
    status: int
    body: dict[str, Any]


def encode(body: dict[str, Any], utime: int, name: str) -> bytes:
    """A request; ``name`` is that of the format."""
    if name == BINARY:
        data = msgspec.msgpack.encode(body, enc_hook=_packed)
    else:
        data = msgspec.json.encode(_with_float_colors(body), enc_hook=_listed)
    text = name.encode() + b"\0"
    return b"".join((_HEAD.pack(FINGERPRINT, utime, len(text)), text, _TAIL.pack(1, 0, len(data)), data))


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


def _packed(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        kind = value.dtype.newbyteorder("<")
        head = struct.pack(f"<2sBx{value.ndim}I", kind.str[1:].encode(), value.ndim, *value.shape)
        return msgspec.msgpack.Ext(_ARRAY, head + value.astype(kind, copy=False).tobytes())
    return _listed(value)


def _listed(value: Any) -> Any:
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be sent")


def _with_float_colors(body: dict[str, Any]) -> dict[str, Any]:
    """JSON has no types: colours of 0 to 255 become 0 to 1."""
    for command in body.get("setgeometry", ()):
        for geometry in command["geometries"]:
            channels = geometry.get("channels") if isinstance(geometry, dict) else None
            if not isinstance(channels, dict):
                continue
            for name in ("rgb", "intensity"):
                values = channels.get(name)
                if isinstance(values, np.ndarray) and values.dtype == np.uint8:
                    channels[name] = values / np.float32(255.0)
    return body
