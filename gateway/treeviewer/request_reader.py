"""Turn a decoded message into a ``Request``: check paths, make geometry, give the reason of each failure.

Messages that fit ``fast_schema`` were checked by msgspec while they were decoded, which halves the time of 1000
transforms (docs/decisions/0016-fast-tree-viewer-requests.md). All others are read field by field, which accepts all
forms that known clients send.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Final, cast

import msgspec

from gateway.scene.tree import Path
from gateway.treeviewer import fast_schema, fields
from gateway.treeviewer.config import Limits
from gateway.treeviewer.context import MeshLoader, ReadContext
from gateway.treeviewer.fields import CommandError, show
from gateway.treeviewer.geometry import read_parts
from gateway.treeviewer.requests import Failure, Request, RequestError

DECODE_ERRORS: Final = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)
"""Raised by msgspec for data that it cannot decode."""


class RequestReader:
    """Base of the readers of both formats. Stateless, so that several threads may use it."""

    type_text = "an object"
    """Description of a request's type for error messages."""

    def __init__(self, limits: Limits | None = None, meshes: MeshLoader | None = None) -> None:
        self.limits = limits or Limits()
        self._meshes = meshes

    def read(self, data: memoryview) -> Request:
        """Return the commands of a request.

        Raises:
            RequestError: the data cannot be decoded, is not an object, or exceeds a limit.
        """
        raise NotImplementedError

    def context(self) -> ReadContext:
        """Return the context for a new request."""
        return ReadContext(self.limits, meshes=self._meshes)

    def from_schema(self, message: Any, context: ReadContext) -> Request | None:
        """Read a message of type ``fast_schema.message_type``; return None if it needs ``from_plain``."""
        if message.draw is not msgspec.UNSET or message.load is not msgspec.UNSET:
            return None
        request = Request()
        self._deletes(message.delete, request, context)
        geometries, transforms = message.setgeometry, message.settransform
        if isinstance(geometries, dict):
            self._geometries(geometries, request, context)
        elif geometries:
            for index, command in enumerate(geometries):
                parts = fast_schema.parts_of(command)
                if parts is None:
                    failure = Failure("setgeometry", index, command.path, "geometries is missing")
                    request.fail(failure, context.limits)
                else:
                    request.geometries.append((command.path, parts))
        if isinstance(transforms, dict):
            self._transforms(transforms, request, context)
        elif transforms:
            request.transforms = [(command.path, command.transform.pose()) for command in transforms]
        return request

    def from_plain(self, message: Any, context: ReadContext) -> Request:
        """Read a message of plain dicts and lists.

        Raises:
            RequestError: it is not an object.
        """
        request = Request()
        if message is None:
            return request
        if not isinstance(message, dict):
            raise RequestError(f"the request must be {self.type_text}, not {show(message)}")
        self._deletes(message.get("delete"), request, context)
        # Director's older keys override the new ones wherever they appear
        geometries = message["load"] if "load" in message else message.get("setgeometry")
        transforms = message["draw"] if "draw" in message else message.get("settransform")
        self._geometries(geometries, request, context)
        self._transforms(transforms, request, context)
        return request

    def _deletes(self, value: Any, request: Request, context: ReadContext) -> None:
        for index, command in _commands("delete", value, request, context):
            try:
                request.deletes.append(fields.path(command, context))
            except CommandError as error:
                request.fail(Failure("delete", index, None, str(error)), context.limits)

    def _geometries(self, value: Any, request: Request, context: ReadContext) -> None:
        for index, command in _commands("setgeometry", value, request, context):
            path = None
            try:
                path = fields.path(command, context)
                parts = read_parts(command, context)
            except CommandError as error:
                request.fail(Failure("setgeometry", index, path, str(error)), context.limits)
            else:
                request.geometries.append((path, parts))
            if context.warnings:
                request.warnings.extend(f"setgeometry[{index}] {_path_text(path)}: {text}" for text in context.warnings)
                context.warnings.clear()

    def _transforms(self, value: Any, request: Request, context: ReadContext) -> None:
        for index, command in _commands("settransform", value, request, context):
            path = None
            try:
                path = fields.path(command, context)
                if "transform" not in command:
                    raise CommandError("transform is missing")
                pose = fields.pose(command["transform"])
            except CommandError as error:
                request.fail(Failure("settransform", index, path, str(error)), context.limits)
            else:
                if not all(map(math.isfinite, pose)):
                    text = "transform is not finite, so nothing below it is drawn"
                    request.warnings.append(f"settransform[{index}] {_path_text(path)}: {text}")
                request.transforms.append((path, pose))


def _commands(name: str, value: Any, request: Request, context: ReadContext) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield index and fields of each command in a list.

    Missing and null lists, ``{}`` and null commands are empty. A single command counts as a list of one, since the
    protocol's document has such an example.
    """
    if value is None or value == {}:
        return
    if isinstance(value, dict) and "path" in value:
        value = [value]
    if not isinstance(value, list):
        failure = Failure(name, 0, None, f"{name} must be a list of commands, not {show(value)}")
        request.fail(failure, context.limits)
        return
    for index, command in enumerate(value):
        if isinstance(command, dict):
            yield index, cast("dict[str, Any]", command)
        elif command is not None:
            failure = Failure(name, index, None, f"a command must be an object, not {show(command)}")
            request.fail(failure, context.limits)


def _path_text(path: Path | None) -> str:
    return show(list(path)) if path is not None else "[?]"
