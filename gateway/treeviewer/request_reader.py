"""Read requests: paths, geometries, transforms, and the reason of each command that failed.

``JsonReader`` and ``MsgpackReader`` are the subclasses: they prepare big requests, and decode irregular data. A list of
regular transforms or solids is decoded to typed objects (docs/decisions/0016-fast-tree-viewer-requests.md). A list with
an irregular command, and all other commands, are decoded to dicts and lists, and read in every form that known clients
send.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

import msgspec

from gateway.scene.geometry import Part
from gateway.scene.tree import Path, Pose
from gateway.treeviewer import fields
from gateway.treeviewer.command_lists import read_list, read_path
from gateway.treeviewer.config import Limits
from gateway.treeviewer.context import ReadContext
from gateway.treeviewer.geometry import read_parts
from gateway.treeviewer.newer_commands import READERS as NEWER_COMMANDS
from gateway.treeviewer.regular_commands import list_types, parts_of
from gateway.treeviewer.requests import Finding, Request, RequestError
from scenegate.messages.field_kinds import CommandError, show

DECODE_ERRORS: Final = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)
"""Raised by msgspec for data that it cannot decode."""


class RequestReader:
    """Base class of the readers of both formats. Thread-safe."""

    type_text = "an object"
    """Description of a request's outermost value, for error texts."""

    def __init__(self, make_decoder: Callable[[Any], Any], small_bytes: int, limits: Limits) -> None:
        """
        Args:
            make_decoder: returns msgspec's decoder of the format for a type.
            small_bytes: size up to which requests are decoded without ``prepare_big``.
            limits: limits of a request.
        """
        self.limits = limits
        self._small_bytes = small_bytes
        self._envelope_decoder = make_decoder(_ENVELOPE)
        geometries_type, transforms_type = list_types(self.limits)
        geometries = make_decoder(geometries_type)
        transforms = make_decoder(transforms_type)
        self._list_decoders = {
            "setgeometry": geometries,
            "load": geometries,
            "settransform": transforms,
            "draw": transforms,
        }
        """Decoders of lists of regular commands."""
        self.any_decoder = make_decoder(Any)

    def read(self, data: memoryview, context: ReadContext) -> Request:
        """Return the commands of a request.

        Raises:
            ThreadRequired: see ``ReadContext.at_once``.
            RequestError: the data cannot be decoded, is not an object, or exceeds a limit.
        """
        prepared = data if len(data) <= self._small_bytes else self.prepare_big(data, context)
        try:
            message: Any = self._decode(prepared)
        except DECODE_ERRORS:  # NaN in JSON, keys that are no text in MessagePack: slower, but accepted
            message = self.decode_plain(prepared)
        return self._read_commands(message, context)

    def prepare_big(self, data: memoryview, context: ReadContext) -> bytes | memoryview:
        """Check a big request; return the part of it that is decoded.

        Raises:
            RequestError: the data exceeds a limit, or has errors.
        """
        raise NotImplementedError

    def decode_plain(self, data: bytes | memoryview) -> Any:
        """Return a request as plain values, of data that ``_decode`` cannot decode.

        Raises:
            RequestError: the data cannot be decoded.
        """
        raise NotImplementedError

    def _decode(self, data: bytes | memoryview) -> dict[str, Any]:
        """Return the lists of commands by name: those of regular commands as typed objects, others as plain values.

        Raises:
            DECODE_ERRORS: the data cannot be decoded, or is not an object.
        """
        envelope = self._envelope_decoder.decode(data)
        lists: dict[str, Any] = {}
        for name in envelope.__struct_fields__:
            raw = getattr(envelope, name)
            if raw is not _ABSENT:
                try:
                    lists[name] = self._list_decoders.get(name, self.any_decoder).decode(raw)
                except msgspec.ValidationError:
                    lists[name] = self.any_decoder.decode(raw)
        return lists

    def _read_commands(self, message: Any, context: ReadContext) -> Request:
        """Return the commands of a decoded message.

        Raises:
            RequestError: the message is not an object.
        """
        request = Request()
        if message is None:
            return request
        if not isinstance(message, dict):
            raise RequestError(f"the request must be {self.type_text}, not {show(message)}")
        for old_name, name in _OLD_NAMES.items():
            if old_name in message:
                message[name] = message[old_name]
        for name, read_commands in READERS.items():
            if (value := message.get(name)) is not None:
                if name in NEWER_COMMANDS:
                    request.newer_commands.append(name)
                read_commands(value, request, context)
        return request


def _read_deletes(value: Any, request: Request, context: ReadContext) -> None:
    """Add the delete commands of a decoded list to the request."""
    read_list("delete", value, request, context, read_path, request.deletes)


def _read_geometries(value: Any, request: Request, context: ReadContext) -> None:
    """Add the setgeometry commands of a decoded list to the request, with warnings."""
    if _is_regular(value):  # msgspec has checked paths and limits, and nothing was tolerated
        for index, command in enumerate(value):
            parts = parts_of(command)
            if parts is None:
                request.fail(Finding("setgeometry", index, "geometries is missing", command.path), context.limits)
            else:
                request.geometries.append((command.path, parts))
        return

    def read(_index: int, path: Path, command: dict[str, Any]) -> tuple[Path, tuple[Part, ...]]:
        return path, read_parts(command, context)

    read_list("setgeometry", value, request, context, read, request.geometries)


def _read_transforms(value: Any, request: Request, context: ReadContext) -> None:
    """Add the settransform commands of a decoded list to the request, with warnings."""
    if _is_regular(value):
        request.transforms += [
            (command.path, command.transform.translation + command.transform.quaternion) for command in value
        ]
        return

    def read(_index: int, path: Path, command: dict[str, Any]) -> tuple[Path, Pose]:
        if "transform" not in command:
            raise CommandError("transform is missing")
        pose = fields.pose(command["transform"])
        if not all(map(math.isfinite, pose)):
            context.warnings.append("transform is not finite, so nothing below it is drawn")
        return path, pose

    read_list("settransform", value, request, context, read, request.transforms)


def _is_regular(commands: Any) -> bool:
    """Return True for a list of typed objects."""
    return isinstance(commands, list) and bool(commands) and isinstance(commands[0], msgspec.Struct)


READERS: Final = {
    "delete": _read_deletes,
    "setgeometry": _read_geometries,
    "settransform": _read_transforms,
    **NEWER_COMMANDS,
}
"""Functions that read a decoded list of commands into the request, by name, in the order of execution."""
_OLD_NAMES: Final = {"load": "setgeometry", "draw": "settransform"}
"""Director's older names of commands. As in Director, they override the newer ones."""
_ABSENT: Final = msgspec.Raw()
_ENVELOPE: Final = msgspec.defstruct(
    "Envelope", [(name, msgspec.Raw, _ABSENT) for name in (*READERS, *_OLD_NAMES)], gc=False
)
"""Type of a request whose lists of commands are not decoded."""
