"""What the viewer says to a request: Director's answers, and beyond them a reason for every command that failed."""

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
"""Director defines it and stays silent instead; its Python client's handler thread ends at any negative status, so it
is only sent when something really went wrong."""
SUPPORTED: Final = {name: [f"{wire.VERSION[0]}.{wire.VERSION[1]}"] for name in (wire.FORMAT, wire.BINARY_FORMAT)}


class Problem(msgspec.Struct, omit_defaults=True):
    """One failed command."""

    command: str
    index: int
    reason: str
    path: Path | None = None


class Answer(msgspec.Struct, omit_defaults=True):
    """Status 0 and 1: the first six fields, as Director sends them. Status -3: with the reasons."""

    timestamp: int
    """Of the LCM message (``utime``), not of the JSON."""
    status: int
    deleted_paths: list[Path]
    added_geometries: list[Path]
    set_transforms: list[Path]
    missing_paths: list[Path]
    error: str = ""
    """All in one sentence, for people."""
    errors: list[Problem] = []
    warnings: list[str] = []


class FormatAnswer(msgspec.Struct):
    """The encoding is not one of ours."""

    timestamp: int
    status: int
    supported_formats: dict[str, list[str]]


class ReadyAnswer(msgspec.Struct):
    """Sent once at start; Director's tests wait for it."""

    timestamp: int = 0
    status: int = OK
    ready: bool = True


_encoder: Final = msgspec.json.Encoder()
_packer: Final = msgspec.msgpack.Encoder()


def encode(answer: Answer | FormatAnswer | ReadyAnswer, *, binary: bool = False) -> bytes:
    """The answer as a viewer2_comms_t, in JSON or in MessagePack."""
    if binary:
        return wire.encode(_packer.encode(answer), name=wire.BINARY_FORMAT)
    return wire.encode(_encoder.encode(answer))


def failed(utime: int, reason: str) -> Answer:
    """Nothing of the request was carried out."""
    return Answer(utime, ERROR_HANDLING_REQUEST, [], [], [], [], error=reason)
