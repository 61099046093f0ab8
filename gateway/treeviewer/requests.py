"""A request's JSON as commands ready to apply: paths checked, geometry made, every failure with its reason.

Three readers, the fastest that understands: typed (what well-behaved clients send), untyped (with the oddities of the
others), and Python's own, which alone knows the bare NaN and Infinity tokens of Python clients.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final, cast

import msgspec

from gateway.scene.geometry import Part
from gateway.scene.tree import Path, Pose
from gateway.treeviewer import fast_schema, fields
from gateway.treeviewer.config import Limits
from gateway.treeviewer.fields import CommandError, show
from gateway.treeviewer.geometry import Context, MeshLoader, parts_of
from gateway.treeviewer.number_arrays import WORTH_SCANNING, JsonError, Numbers
from gateway.treeviewer.slices import pieces

TypedDecoder = msgspec.json.Decoder[Any] | msgspec.msgpack.Decoder[Any]
UNREADABLE: Final = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)
"""What msgspec raises for text that it does not understand."""
LEAST_SCANNED: Final = 4096
"""Bytes; shorter requests have no array worth taking out."""


_ORDER: Final = ("delete", "setgeometry", "settransform")


class RequestError(ValueError):
    """Nothing of the request can be used; the message says why."""


@dataclass(frozen=True, slots=True)
class Failure:
    """A command that was not carried out."""

    command: str
    index: int
    path: Path | None
    reason: str


class Request(msgspec.Struct, gc=False):
    """Commands in the order in which they apply: all deletes, then all geometries, then all transforms."""

    deletes: list[Path] = []
    geometries: list[tuple[Path, tuple[Part, ...]]] = []
    transforms: list[tuple[Path, Pose]] = []
    failures: list[Failure] = []
    warnings: list[str] = []
    """Sentences about what was tolerated."""

    @property
    def commands(self) -> int:
        return len(self.deletes) + len(self.geometries) + len(self.transforms)

    def fail(self, failure: Failure, limits: Limits) -> None:
        """Remembers a command that cannot be carried out.

        Raises:
            RequestError: there are too many of them.
        """
        self.failures.append(failure)
        self._bound(limits)

    def extend(self, other: Request, limits: Limits) -> None:
        """Takes the commands of a piece of the same request; raises as ``fail`` does."""
        self.deletes += other.deletes
        self.geometries += other.geometries
        self.transforms += other.transforms
        self.failures += other.failures
        self.warnings += other.warnings
        self._bound(limits)

    def _bound(self, limits: Limits) -> None:
        if len(self.failures) > limits.failed_commands:
            first = self.failures[0]
            raise RequestError(
                f"more than {limits.failed_commands} commands cannot be carried out, so nothing is done; "
                f"{first.command}[{first.index}]: {first.reason}"
            )


class RequestReader:
    """Reads requests under given limits. Has no state of its own and may be used by several threads."""

    _whole = "a JSON object"
    """What a request is."""

    def __init__(self, limits: Limits | None = None, meshes: MeshLoader | None = None) -> None:
        self._limits = limits or Limits()
        self._meshes = meshes
        self._typed: msgspec.json.Decoder[Any] = msgspec.json.Decoder(fast_schema.message_types(self._limits)[0])
        self._untyped = msgspec.json.Decoder()

    def read(self, data: memoryview, *, extract: bool | None = None) -> Request:
        """The commands of a request.

        Args:
            data: the JSON text.
            extract: whether to take long number arrays out first; None: if it looks worth it.
        Raises:
            RequestError: the text is not a JSON object, or too much of it.
        """
        if extract is None and len(data) <= self._limits.json_bytes:
            usual = self._usual(data, self._typed)
            if usual is not None:
                return usual
        numbers = Numbers()
        body = numbers.take_from(data) if extract else bytes(data)
        if extract is None and len(body) >= LEAST_SCANNED and any(key in body for key in WORTH_SCANNING):
            body = numbers.take_from(data)
        if len(body) > self._limits.json_bytes:
            raise RequestError(f"the request has {len(body)} bytes of JSON, the limit is {self._limits.json_bytes}")
        context = Context(self._limits, numbers, self._meshes)
        small = pieces(body)
        try:
            if small is None:
                return self._read_text(body, context)
            request = Request()
            for piece, index in small:
                context.first = index
                request.extend(self._read_text(piece, context), self._limits)
                time.sleep(0)  # the interpreter is free for a moment
            request.failures.sort(key=lambda failure: _ORDER.index(failure.command))
            return request
        except JsonError as error:
            raise RequestError(f"the request is not valid JSON {error}") from None

    def _usual(self, data: memoryview, decoder: TypedDecoder) -> Request | None:
        """A small request without any oddity; None: a closer look is needed."""
        try:
            message = decoder.decode(data)
        except UNREADABLE:
            return None
        geometries, transforms = message.setgeometry, message.settransform
        odd = message.delete not in (None, []) or isinstance(geometries, dict) or isinstance(transforms, dict)
        if odd or message.draw is not msgspec.UNSET or message.load is not msgspec.UNSET:
            return None
        request = Request()
        if geometries:
            for command in geometries:
                parts = fast_schema.parts_of(command)
                if parts is None:
                    return None
                request.geometries.append((command.path, parts))
        if transforms:
            request.transforms = fast_schema.transforms_of(transforms)
        return request

    def _read_text(self, body: bytes, context: Context) -> Request:
        try:
            message = self._typed.decode(body)
        except UNREADABLE:
            return self._lenient(_any_json(self._untyped, body), context)
        if message.draw is not msgspec.UNSET or message.load is not msgspec.UNSET:
            return self._lenient(self._untyped.decode(body), context)
        return self._from_typed(message, context)

    def _from_typed(self, message: Any, context: Context) -> Request:
        request = Request()
        if message.delete is not None and message.delete != []:
            self._deletes(message.delete, request, context)
        geometries = message.setgeometry
        if isinstance(geometries, dict):
            self._geometries(geometries, request, context)
        elif geometries:
            for index, command in enumerate(geometries, context.first):
                parts = fast_schema.parts_of(command)
                if parts is None:
                    failure = Failure("setgeometry", index, command.path, "geometries is missing")
                    request.fail(failure, context.limits)
                else:
                    request.geometries.append((command.path, parts))
        transforms = message.settransform
        if isinstance(transforms, dict):
            self._transforms(transforms, request, context)
        elif transforms:
            request.transforms = fast_schema.transforms_of(transforms)
        return request

    def _lenient(self, message: Any, context: Context) -> Request:
        request = Request()
        if message is None:
            return request
        if not isinstance(message, dict):
            raise RequestError(f"the request must be {self._whole}, not {show(message)}")
        self._deletes(message.get("delete"), request, context)
        # Director's older keys override the new ones wherever they appear
        geometries = message["load"] if "load" in message else message.get("setgeometry")
        transforms = message["draw"] if "draw" in message else message.get("settransform")
        self._geometries(geometries, request, context)
        self._transforms(transforms, request, context)
        return request

    def _deletes(self, value: Any, request: Request, context: Context) -> None:
        for index, command in _commands("delete", value, request, context):
            path = None
            try:
                path = fields.path(command, context.limits, context.numbers)
            except CommandError as error:
                request.fail(Failure("delete", index, path, str(error)), context.limits)
            else:
                request.deletes.append(path)

    def _geometries(self, value: Any, request: Request, context: Context) -> None:
        for index, command in _commands("setgeometry", value, request, context):
            path = None
            try:
                path = fields.path(command, context.limits, context.numbers)
                parts = parts_of(command, context)
            except CommandError as error:
                request.fail(Failure("setgeometry", index, path, str(error)), context.limits)
            else:
                request.geometries.append((path, parts))
            if context.warnings:
                request.warnings.extend(f"setgeometry[{index}] {_named(path)}: {text}" for text in context.warnings)
                context.warnings.clear()

    def _transforms(self, value: Any, request: Request, context: Context) -> None:
        for index, command in _commands("settransform", value, request, context):
            path = None
            try:
                path = fields.path(command, context.limits, context.numbers)
                if "transform" not in command:
                    raise CommandError("transform is missing")
                pose = fields.pose(command["transform"])
            except CommandError as error:
                request.fail(Failure("settransform", index, path, str(error)), context.limits)
            else:
                if not all(map(math.isfinite, pose)):
                    text = "transform is not finite, so nothing below it is drawn"
                    request.warnings.append(f"settransform[{index}] {_named(path)}: {text}")
                request.transforms.append((path, pose))


def _commands(name: str, value: Any, request: Request, context: Context) -> Iterator[tuple[int, dict[str, Any]]]:
    """The commands of one list. Absent and null lists, ``{}`` and null commands are empty; one bare command is a list
    of one (the protocol document itself has such an example)."""
    if value is None or value == {}:
        return
    if isinstance(value, dict) and "path" in value:
        value = [value]
    if not isinstance(value, list):
        failure = Failure(name, 0, None, f"{name} must be a list of commands, not {show(value)}")
        request.fail(failure, context.limits)
        return
    for index, command in enumerate(value, context.first):
        if isinstance(command, dict):
            yield index, cast("dict[str, Any]", command)
        elif command is not None:
            failure = Failure(name, index, None, f"a command must be an object, not {show(command)}")
            request.fail(failure, context.limits)


def _any_json(decoder: msgspec.json.Decoder[Any], body: bytes) -> Any:
    try:
        return decoder.decode(body)
    except UNREADABLE:
        pass
    try:
        return json.loads(body.decode())
    except UnicodeDecodeError as error:
        raise JsonError(f"text: {error.reason} at byte {error.start}") from None
    except RecursionError:
        raise RequestError("the request is nested too deeply") from None
    except ValueError as error:  # JSONDecodeError, and integers of thousands of digits
        raise JsonError(f"({error})") from None


def _named(path: Path | None) -> str:
    return show(list(path)) if path is not None else "[?]"
