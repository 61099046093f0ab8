"""Turn decoded data into a ``Request``: paths, geometries, transforms, and the reason of each command that failed.

``JsonReader`` and ``MsgpackReader`` are the subclasses. msgspec decodes most requests as ``fast_schema`` types and
checks them meanwhile, which halves the time of 1000 transforms (docs/decisions/0016-fast-tree-viewer-requests.md).
All other requests are read field by field, in every form that known clients send.
"""

from __future__ import annotations

import math
from typing import Any, Final

import msgspec

from gateway.scene.tree import Path
from gateway.treeviewer import fast_schema, fields
from gateway.treeviewer.command_lists import commands
from gateway.treeviewer.config import Limits
from gateway.treeviewer.context import MeshLoader, ReadContext
from gateway.treeviewer.fields import CommandError, show
from gateway.treeviewer.geometry import read_parts
from gateway.treeviewer.newer_commands import NAMES, read_newer_commands
from gateway.treeviewer.requests import Finding, Request, RequestError
from scenegate.warning_text import strict_refusal

DECODE_ERRORS: Final = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)
"""Raised by msgspec for data that it cannot decode."""


class RequestReader:
    """Base class of the readers of both formats. Thread-safe."""

    type_text = "an object"
    """Description of a request's outermost value, for error texts."""

    def __init__(self, limits: Limits | None = None, *, strict: bool = False) -> None:
        self.limits = limits or Limits()
        self._strict = strict

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

    def from_schema(self, message: Any, context: ReadContext) -> Request | None:
        """Return the commands of a message of type ``fast_schema.message_type``.

        Returns None for a message with Director's older keys, which only ``from_plain`` reads.
        """
        if message.draw is not msgspec.UNSET or message.load is not msgspec.UNSET:
            return None
        request = Request()
        self._read_deletes(message.delete, request, context)
        geometries, transforms = message.setgeometry, message.settransform
        if isinstance(geometries, dict):
            self._read_geometries(geometries, request, context)
        elif geometries:
            for index, command in enumerate(geometries):
                parts = fast_schema.parts_of(command)
                if parts is None:
                    failure = Finding("setgeometry", index, command.path, "geometries is missing")
                    request.fail(failure, context.limits)
                else:
                    request.geometries.append((command.path, parts))
        if isinstance(transforms, dict):
            self._read_transforms(transforms, request, context)
        elif transforms:
            request.transforms = [(command.path, command.transform.pose()) for command in transforms]
        read_newer_commands({name: getattr(message, name) for name in NAMES}, request, context)
        return request

    def from_plain(self, message: Any, context: ReadContext) -> Request:
        """Return the commands of a message of dicts and lists.

        Raises:
            RequestError: the message is not an object.
        """
        request = Request()
        if message is None:
            return request
        if not isinstance(message, dict):
            raise RequestError(f"the request must be {self.type_text}, not {show(message)}")
        self._read_deletes(message.get("delete"), request, context)
        # as in Director, its older keys override the newer ones
        geometries = message["load"] if "load" in message else message.get("setgeometry")
        transforms = message["draw"] if "draw" in message else message.get("settransform")
        self._read_geometries(geometries, request, context)
        self._read_transforms(transforms, request, context)
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


def _refuse_warnings(context: ReadContext) -> None:
    """Raise CommandError if the current command has a warning and ``context.strict`` is true."""
    if context.strict and context.warnings:
        raise CommandError(strict_refusal(context.warnings))


def _take_warnings(command: str, index: int, path: Path | None, request: Request, context: ReadContext) -> None:
    """Move the warnings about a command from the context to the request."""
    request.warnings.extend(Finding(command, index, path, text) for text in context.warnings)
    context.warnings.clear()
