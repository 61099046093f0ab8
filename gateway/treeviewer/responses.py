"""Responses to requests: Director's, with a reason for every command that failed."""

from __future__ import annotations

from typing import Final

import msgspec

from gateway.scene.tree import Path
from gateway.treeviewer import wire

OK: Final = 0
MISSING_PATHS: Final = 1
UNKNOWN_FORMAT: Final = -1
UNKNOWN_FORMAT_VERSION: Final = -2
ERROR_HANDLING_REQUEST: Final = -3
"""Director defines it but sends nothing instead. Its Python client's handler thread ends at any negative status, so it
is sent for errors only, never for tolerated oddities."""
SUPPORTED_FORMATS: Final = {
    name: [f"{wire.VERSION[0]}.{wire.VERSION[1]}"] for name in (wire.FORMAT, wire.BINARY_FORMAT)
}


class CommandProblem(msgspec.Struct, omit_defaults=True):
    """One failed command."""

    command: str
    index: int
    reason: str
    path: Path | None = None


class Response(msgspec.Struct, omit_defaults=True):
    """Response to a request: the first six fields as Director sends them, with status -3 also the reasons."""

    timestamp: int
    """``utime`` of the LCM message, not the timestamp in its data."""
    status: int
    deleted_paths: list[Path]
    added_geometries: list[Path]
    set_transforms: list[Path]
    missing_paths: list[Path]
    error: str = ""
    """The first error in one sentence, with the number of further ones."""
    errors: list[CommandProblem] = []
    warnings: list[str] = []


class FormatResponse(msgspec.Struct):
    """Response to an unknown format or version."""

    timestamp: int
    status: int
    supported_formats: dict[str, list[str]]


class ReadyMessage(msgspec.Struct):
    """Published once at start; Director's tests wait for it."""

    timestamp: int = 0
    status: int = OK
    ready: bool = True


AnyResponse = Response | FormatResponse

_json: Final = msgspec.json.Encoder()
_msgpack: Final = msgspec.msgpack.Encoder()


def encode(response: AnyResponse | ReadyMessage, *, binary: bool = False) -> bytes:
    """Return the response as a viewer2_comms_t, in JSON or in MessagePack."""
    if binary:
        return wire.encode(_msgpack.encode(response), name=wire.BINARY_FORMAT)
    return wire.encode(_json.encode(response))


def failed(utime: int, reason: str) -> Response:
    """Return the response to a request of which nothing was executed."""
    return Response(utime, ERROR_HANDLING_REQUEST, [], [], [], [], error=reason)
