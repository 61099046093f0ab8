"""``robotlocomotion.viewer2_comms_t`` on the wire, as LCM writes it: big endian, fingerprint first.

``drake.lcmt_viewer2_comms`` has the same fields and so the same fingerprint (LCM hashes members, not names of types).
"""

from __future__ import annotations

import struct
from typing import Final

import msgspec

FINGERPRINT: Final = 0xD368E03F33C568BE
"""Of lcmtypes/viewer2_comms_t.lcm: the base hash 0x69b4701f99e2b45f, rotated left by one."""
FORMAT: Final = "treeviewer_json"
BINARY_FORMAT: Final = "treeviewer_msgpack"
VERSION: Final = (1, 0)

_HEAD: Final = struct.Struct(">QqI")
_TAIL: Final = struct.Struct(">iii")
_USUAL: Final = struct.Struct(">Qq20s8si")
_USUAL_NAME: Final = struct.pack(">I", len(FORMAT) + 1) + FORMAT.encode() + b"\0"
_USUAL_VERSION: Final = struct.pack(">ii", *VERSION)
_ANSWER_HEAD: Final = struct.pack(">Qq", FINGERPRINT, 0) + _USUAL_NAME + _USUAL_VERSION
_COUNT: Final = struct.Struct(">i")
_BINARY_NAME: Final = struct.pack(">I", len(BINARY_FORMAT) + 1) + BINARY_FORMAT.encode() + b"\0"
_MAX_FORMAT_BYTES: Final = 256
"""Of the format's name; a longer one is not a name but damage."""


class WireError(ValueError):
    """The bytes are not a viewer2_comms_t; the message says why."""


class Comms(msgspec.Struct, frozen=True, gc=False):
    """One viewer2_comms_t."""

    utime: int
    """Microseconds; requests' own, echoed in the answer."""
    format: str
    major: int
    minor: int
    data: memoryview
    """What ``num_bytes`` announced, or less when fewer bytes follow."""
    fault: str = ""
    """Why ``data`` cannot be trusted although the header can; empty when all is well."""


def decode(message: bytes | memoryview) -> Comms:
    """Reads a message; bytes after it are ignored, as LCM does.

    Raises:
        WireError: fingerprint or header are wrong, so that not even the sender's time is known.
    """
    view = memoryview(message)
    size = len(view)
    if size >= _USUAL.size:  # what nearly all messages are, in one step
        fingerprint, utime, name, version, count = _USUAL.unpack_from(view)
        usual = fingerprint == FINGERPRINT and name == _USUAL_NAME and version == _USUAL_VERSION
        if usual and count == size - _USUAL.size:
            return Comms(utime, FORMAT, 1, 0, view[_USUAL.size :])
    if size < _HEAD.size:
        raise WireError(f"the message has {size} bytes, a viewer2_comms_t has at least {_HEAD.size + 1 + _TAIL.size}")
    fingerprint, utime, length = _HEAD.unpack_from(view)
    if fingerprint != FINGERPRINT:
        raise WireError(f"fingerprint {fingerprint:016x} is not viewer2_comms_t's {FINGERPRINT:016x}")
    if not 1 <= length <= _MAX_FORMAT_BYTES:
        raise WireError(f"the format's name has {length} bytes with its NUL, 1 to {_MAX_FORMAT_BYTES} are possible")
    end = _HEAD.size + length
    if size < end + _TAIL.size:
        raise WireError(f"the message ends after {size} bytes, within its header")
    name = bytes(view[_HEAD.size : end - 1])
    major, minor, count = _TAIL.unpack_from(view, end)
    begin = end + _TAIL.size
    data = view[begin : begin + max(count, 0)]
    fault = "" if len(data) == count else f"num_bytes is {count}, but {size - begin} bytes follow"
    return Comms(utime, name.decode("utf-8", "replace"), major, minor, data, fault)


def is_binary(message: bytes | memoryview) -> bool:
    """Whether the message says that its data is MessagePack; quick."""
    return message[16 : 16 + len(_BINARY_NAME)] == _BINARY_NAME


def encode(data: bytes, utime: int = 0, name: str = FORMAT, version: tuple[int, int] = VERSION) -> bytes:
    """A message around ``data``. Answers carry utime 0, as Director's do."""
    if utime == 0 and name is FORMAT and version is VERSION:
        return b"".join((_ANSWER_HEAD, _COUNT.pack(len(data)), data))
    text = name.encode() + b"\0"
    return b"".join((_HEAD.pack(FINGERPRINT, utime, len(text)), text, _TAIL.pack(*version, len(data)), data))
