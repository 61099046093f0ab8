"""Read the commands of a decoded list one by one: those of ``request_reader``, ``newer_commands`` and controls."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from gateway.scene.tree import Path
from gateway.treeviewer import fields
from gateway.treeviewer.context import ReadContext
from gateway.treeviewer.requests import Finding, Request
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
