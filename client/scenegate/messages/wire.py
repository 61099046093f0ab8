"""Encode and decode the LCM type ``robotlocomotion.viewer2_comms_t``: big-endian, with the fingerprint first.

``drake.lcmt_viewer2_comms`` has the same fields and therefore the same fingerprint: LCM hashes fields, not type names.
"""

import struct
from typing import Final

import msgspec

FINGERPRINT: Final = 0xD368E03F33C568BE
"""Hash 0x69b4701f99e2b45f of the fields in lcmtypes/viewer2_comms_t.lcm, rotated left by one bit."""
JSON: Final = "treeviewer_json"
BINARY: Final = "treeviewer_msgpack"
VERSION: Final = (1, 0)
REQUEST: Final = "DIRECTOR_TREE_VIEWER_REQUEST"
"""Channel of requests; ``_<client id>`` may follow."""
RESPONSE: Final = "DIRECTOR_TREE_VIEWER_RESPONSE"
"""Channel of responses and announcements; ``_<client id>`` may follow."""
OK: Final = 0
"""Status of a response: everything was executed. Negative ones are failures."""
MISSING_PATHS: Final = 1
"""Status of a response: everything was executed, but some paths have no geometry."""
UNKNOWN_FORMAT: Final = -1
UNKNOWN_FORMAT_VERSION: Final = -2
ERROR_HANDLING_REQUEST: Final = -3
"""A command failed. Director defines this status, but sends no response in this case. The thread of its Python client
that handles responses ends at a negative status, so irregularities that are tolerated get a warning instead."""
MAX_FORMAT_BYTES: Final = 256
"""Maximum length of the format's name with its final NUL. A longer name means that the message is damaged."""

_HEADER: Final = struct.Struct(">QqI")
"""Fields before the format's name: fingerprint, utime, length of the name with its final NUL."""
_TRAILER: Final = struct.Struct(">iii")
"""Fields after the format's name: major version, minor version, num_bytes. The data follows."""


class WireError(ValueError):
    """Some bytes are not a viewer2_comms_t; the message is the reason."""


class Comms(msgspec.Struct, frozen=True, gc=False):
    """A decoded viewer2_comms_t."""

    utime: int
    """The sender's time in microseconds. The response has it as ``timestamp``."""
    format: str
    """Name of the format of ``data``."""
    major: int
    minor: int
    data: memoryview
    """``num_bytes`` bytes, or fewer if the message is truncated."""
    fault: str = ""
    """Reason why ``data`` is invalid; empty if it is valid."""


def decode(message: bytes | memoryview) -> Comms:
    """Decode an LCM message; bytes after its end are ignored. Raises WireError if no response to it is possible."""
    view = memoryview(message)
    size = len(view)
    if size < _HEADER.size:
        raise WireError(
            f"the message has {size} bytes, a viewer2_comms_t has at least {_HEADER.size + 1 + _TRAILER.size}"
        )
    fingerprint, utime, name_length = _HEADER.unpack_from(view)
    if fingerprint != FINGERPRINT:
        raise WireError(f"fingerprint {fingerprint:016x} is not viewer2_comms_t's {FINGERPRINT:016x}")
    if not 1 <= name_length <= MAX_FORMAT_BYTES:
        raise WireError(f"the format's name has {name_length} bytes with its NUL, 1 to {MAX_FORMAT_BYTES} are possible")
    trailer_start = _HEADER.size + name_length
    data_start = trailer_start + _TRAILER.size
    if size < data_start:
        raise WireError(f"the message ends after {size} bytes, within its header")
    format_name = bytes(view[_HEADER.size : trailer_start - 1]).decode("utf-8", "replace")
    major, minor, num_bytes = _TRAILER.unpack_from(view, trailer_start)
    data = view[data_start : data_start + max(num_bytes, 0)]
    fault = "" if len(data) == num_bytes else f"num_bytes is {num_bytes}, but {size - data_start} bytes follow"
    return Comms(utime, format_name, major, minor, data, fault)


def encode(data: bytes, utime: int = 0, name: str = JSON, version: tuple[int, int] = VERSION) -> bytes:
    """Return an LCM message with ``data`` in the format ``name``. Responses have utime 0, as in Director."""
    return header(len(data), utime, name, version) + data


def header(num_bytes: int, utime: int, name: str, version: tuple[int, int] = VERSION) -> bytes:
    """Return what precedes the ``num_bytes`` bytes of data in an LCM message."""
    format_name = name.encode() + b"\0"
    fields = _HEADER.pack(FINGERPRINT, utime, len(format_name))
    return fields + format_name + _TRAILER.pack(*version, num_bytes)
