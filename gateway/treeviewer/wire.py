"""``robotlocomotion.viewer2_comms_t`` on the wire, as LCM encodes it: big endian, fingerprint first.

``drake.lcmt_viewer2_comms`` has the same fields and so the same fingerprint (LCM hashes members, not type names).
"""

from __future__ import annotations

import struct
from typing import Final

import msgspec

FINGERPRINT: Final = 0xD368E03F33C568BE
"""The base hash 0x69b4701f99e2b45f of lcmtypes/viewer2_comms_t.lcm, rotated left by one bit."""
FORMAT: Final = "treeviewer_json"
BINARY_FORMAT: Final = "treeviewer_msgpack"
VERSION: Final = (1, 0)
MAX_FORMAT_BYTES: Final = 256
"""Maximum length of the format's name with its NUL; a longer one is a damaged message."""

_HEADER: Final = struct.Struct(">QqI")
"""Fingerprint, utime, length of the format's name."""
_TRAILER: Final = struct.Struct(">iii")
"""Major version, minor version, num_bytes."""
_BINARY_NAME: Final = struct.pack(">I", len(BINARY_FORMAT) + 1) + BINARY_FORMAT.encode() + b"\0"


class WireError(ValueError):
    """The bytes are not a viewer2_comms_t; the message is the reason."""


class Comms(msgspec.Struct, frozen=True, gc=False):
    """One viewer2_comms_t."""

    utime: int
    """The sender's time in microseconds; the response repeats it."""
    format: str
    major: int
    minor: int
    data: memoryview
    """``num_bytes`` bytes, or fewer if the message is truncated."""
    fault: str = ""
    """Reason why ``data`` cannot be used although the header can; empty if there is none."""


def decode(message: bytes | memoryview) -> Comms:
    """Decode a message; ignore bytes after it, as LCM does.

    Raises:
        WireError: the fingerprint or the header is wrong, so that no response is possible.
    """
    view = memoryview(message)
    size = len(view)
    if size < _HEADER.size:
        raise WireError(
            f"the message has {size} bytes, a viewer2_comms_t has at least {_HEADER.size + 1 + _TRAILER.size}"
        )
    fingerprint, utime, length = _HEADER.unpack_from(view)
    if fingerprint != FINGERPRINT:
        raise WireError(f"fingerprint {fingerprint:016x} is not viewer2_comms_t's {FINGERPRINT:016x}")
    if not 1 <= length <= MAX_FORMAT_BYTES:
        raise WireError(f"the format's name has {length} bytes with its NUL, 1 to {MAX_FORMAT_BYTES} are possible")
    end = _HEADER.size + length
    if size < end + _TRAILER.size:
        raise WireError(f"the message ends after {size} bytes, within its header")
    name = bytes(view[_HEADER.size : end - 1]).decode("utf-8", "replace")
    major, minor, count = _TRAILER.unpack_from(view, end)
    begin = end + _TRAILER.size
    data = view[begin : begin + max(count, 0)]
    fault = "" if len(data) == count else f"num_bytes is {count}, but {size - begin} bytes follow"
    return Comms(utime, name, major, minor, data, fault)


def is_binary(message: bytes | memoryview) -> bool:
    """Return whether the format of a message is MessagePack, without decoding it."""
    return message[16 : 16 + len(_BINARY_NAME)] == _BINARY_NAME


def encode(data: bytes, utime: int = 0, name: str = FORMAT, version: tuple[int, int] = VERSION) -> bytes:
    """Return a message with ``data``. Responses have utime 0, as Director's do."""
    text = name.encode() + b"\0"
    return b"".join((_HEADER.pack(FINGERPRINT, utime, len(text)), text, _TRAILER.pack(*version, len(data)), data))
