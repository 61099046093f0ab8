"""Read the commands of a decoded request that Director has: deletes, geometries and transforms."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import msgspec

from gateway.adapters.treeviewer import fields
from gateway.adapters.treeviewer.context import ReadContext
from gateway.adapters.treeviewer.geometry import read_parts
from gateway.adapters.treeviewer.regular_commands import parts_of
from gateway.adapters.treeviewer.requests import Finding, Request
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.nodes import Path, Pose
from scenegate.messages.field_kinds import CommandError, show
from scenegate.warning_text import strict_refusal

T = TypeVar("T")


def read_list(
    name: str,
    value: Any,
    request: Request,
    context: ReadContext,
    read: Callable[[int, Path, dict[str, Any]], T],
    results: list[T],
) -> None:
    """Append the result of ``read`` for each command to ``results``, and add failures and warnings to the request.

    An absent list, null and ``{}`` count as an empty list, and null commands are skipped. An object with a path counts
    as a list of one command, because an example in the protocol's document has that form.

    Args:
        name: name of the list.
        value: the list as decoded.
        read: called with index, path and fields of a command. Raises CommandError if it cannot be executed.
    """
    if value is None or value == {}:
        return
    if isinstance(value, dict) and "path" in value:
        value = [value]
    if not isinstance(value, list):
        failure = Finding(name, 0, f"{name} must be a list of commands, not {show(value)}")
        request.fail(failure, context.limits)
        return
    for index, command in enumerate(value):
        if command is None:
            continue
        path = None
        try:
            if not isinstance(command, dict):
                raise CommandError(f"a command must be an object, not {show(command)}")
            path = fields.path(command, context)
            result = read(index, path, command)
            if context.strict and context.warnings:
                raise CommandError(strict_refusal(context.warnings))
        except CommandError as error:
            request.fail(Finding(name, index, str(error), path), context.limits)
        else:
            results.append(result)
        request.warnings.extend(Finding(name, index, text, path) for text in context.warnings)
        context.warnings.clear()


def read_path(_index: int, path: Path, _command: dict[str, Any]) -> Path:
    """Return the path of a command that has no other fields; for ``read_list``."""
    return path


def read_deletes(value: Any, request: Request, context: ReadContext) -> None:
    """Add the delete commands of a decoded list to the request."""
    read_list("delete", value, request, context, read_path, request.deletes)


def read_geometries(value: Any, request: Request, context: ReadContext) -> None:
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


def read_transforms(value: Any, request: Request, context: ReadContext) -> None:
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
