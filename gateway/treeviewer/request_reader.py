"""Read requests: paths, geometries, transforms, and the reason of each command that failed.

``JsonReader`` and ``MsgpackReader`` are the subclasses. A list of regular transforms or solids is decoded to typed
objects (docs/decisions/0016-fast-tree-viewer-requests.md). A list with an irregular command, and all other commands,
are decoded to dicts and lists, and read in every form that known clients send.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

import msgspec

from gateway.scene.tree import Path
from gateway.treeviewer import fields
from gateway.treeviewer.command_lists import commands
from gateway.treeviewer.config import Limits
from gateway.treeviewer.context import MeshLoader, ReadContext
from gateway.treeviewer.fields import CommandError, show
from gateway.treeviewer.geometry import read_parts
from gateway.treeviewer.newer_commands import NAMES, read_newer_commands
from gateway.treeviewer.regular_commands import list_types, parts_of, pose_of
from gateway.treeviewer.requests import Finding, Request, RequestError
from scenegate.warning_text import strict_refusal

DECODE_ERRORS: Final = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)
"""Raised by msgspec for data that it cannot decode."""
_COMMANDS: Final = ("delete", "setgeometry", "load", "settransform", "draw", *NAMES)
"""Names of all lists of commands. ``load`` and ``draw`` are Director's older names of setgeometry and settransform."""
_ABSENT: Final = msgspec.Raw()
_ENVELOPE: Final = msgspec.defstruct("Envelope", [(name, msgspec.Raw, _ABSENT) for name in _COMMANDS], gc=False)
"""Type of a request whose lists of commands are not decoded."""


class RequestReader:
    """Base class of the readers of both formats. Thread-safe."""

    type_text = "an object"
    """Description of a request's outermost value, for error texts."""

    def __init__(self, decoder: Callable[[Any], Any], limits: Limits | None = None, *, strict: bool = False) -> None:
        """
        Args:
            decoder: returns msgspec's decoder of the format for a type.
            limits: limits of a request.
            strict: True: a geometry or transform with a warning is refused.
        """
        self.limits = limits or Limits()
        self._strict = strict
        self._envelope = decoder(_ENVELOPE)
        geometries, transforms = map(decoder, list_types(self.limits))
        self._regular = {"setgeometry": geometries, "load": geometries, "settransform": transforms, "draw": transforms}
        """Decoders of lists of regular commands."""
        self._plain = decoder(Any)

    def read(self, data: memoryview, meshes: MeshLoader | None = None) -> Request:
        """Return the commands of a request.

        Args:
            meshes: loader of mesh files; None: the request cannot name files.

        Raises:
            RequestError: the data cannot be decoded, is not an object, or exceeds a limit.
        """
        raise NotImplementedError

    def context(self, meshes: MeshLoader | None) -> ReadContext:
        """Return the context in which one request is read."""
        return ReadContext(self.limits, meshes=meshes, strict=self._strict)

    def decode(self, data: bytes | memoryview) -> dict[str, Any]:
        """Return the lists of commands by name: those of regular commands as typed objects, others as plain values.

        Raises:
            DECODE_ERRORS: the data cannot be decoded, or is not an object.
        """
        envelope = self._envelope.decode(data)
        lists: dict[str, Any] = {}
        for name in _COMMANDS:
            raw = getattr(envelope, name)
            if raw is not _ABSENT:
                try:
                    lists[name] = self._regular.get(name, self._plain).decode(raw)
                except msgspec.ValidationError:
                    lists[name] = self._plain.decode(raw)
        return lists

    def read_commands(self, message: Any, context: ReadContext) -> Request:
        """Return the commands of a decoded message.

        Raises:
            RequestError: the message is not an object.
        """
        request = Request()
        if message is None:
            return request
        if not isinstance(message, dict):
            raise RequestError(f"the request must be {self.type_text}, not {show(message)}")
        for read, value in (
            (self._read_deletes, message.get("delete")),
            # as in Director, its older keys override the newer ones
            (self._read_geometries, message["load"] if "load" in message else message.get("setgeometry")),
            (self._read_transforms, message["draw"] if "draw" in message else message.get("settransform")),
        ):
            if value is not None and value != []:
                read(value, request, context)
        read_newer_commands(message, request, context)
        return request

    def _read_deletes(self, value: Any, request: Request, context: ReadContext) -> None:
        """Add the delete commands of a decoded list to the request."""
        for index, command in commands("delete", value, request, context):
            try:
                request.deletes.append(fields.path(command, context))
            except CommandError as error:
                request.fail(Finding("delete", index, None, str(error)), context.limits)

    def _read_geometries(self, value: Any, request: Request, context: ReadContext) -> None:
        """Add the setgeometry commands of a decoded list to the request, with warnings."""
        if _is_regular(value):
            for index, command in enumerate(value):
                parts = parts_of(command)
                if parts is None:
                    failure = Finding("setgeometry", index, command.path, "geometries is missing")
                    request.fail(failure, context.limits)
                else:
                    request.geometries.append((command.path, parts))
            return
        for index, command in commands("setgeometry", value, request, context):
            path = None
            try:
                path = fields.path(command, context)
                parts = read_parts(command, context)
                _refuse_warnings(context)
            except CommandError as error:
                request.fail(Finding("setgeometry", index, path, str(error)), context.limits)
            else:
                request.geometries.append((path, parts))
            _take_warnings("setgeometry", index, path, request, context)

    def _read_transforms(self, value: Any, request: Request, context: ReadContext) -> None:
        """Add the settransform commands of a decoded list to the request, with warnings."""
        if _is_regular(value):
            request.transforms = list(map(pose_of, value))
            return
        for index, command in commands("settransform", value, request, context):
            path = None
            try:
                path = fields.path(command, context)
                if "transform" not in command:
                    raise CommandError("transform is missing")
                pose = fields.pose(command["transform"])
                if not all(map(math.isfinite, pose)):
                    context.warnings.append("transform is not finite, so nothing below it is drawn")
                _refuse_warnings(context)
            except CommandError as error:
                request.fail(Finding("settransform", index, path, str(error)), context.limits)
            else:
                request.transforms.append((path, pose))
            _take_warnings("settransform", index, path, request, context)


def _is_regular(commands: Any) -> bool:
    """Return True for a list of typed objects."""
    return isinstance(commands, list) and bool(commands) and isinstance(commands[0], msgspec.Struct)


def _refuse_warnings(context: ReadContext) -> None:
    """Raise CommandError if the current command has a warning and ``context.strict`` is true."""
    if context.strict and context.warnings:
        raise CommandError(strict_refusal(context.warnings))


def _take_warnings(command: str, index: int, path: Path | None, request: Request, context: ReadContext) -> None:
    """Move the warnings about a command from the context to the request."""
    request.warnings.extend(Finding(command, index, path, text) for text in context.warnings)
    context.warnings.clear()
