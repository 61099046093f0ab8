"""Iterate over the commands of a request, for ``request_reader`` and ``newer_commands``."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, cast

from gateway.treeviewer.context import ReadContext
from gateway.treeviewer.fields import show
from gateway.treeviewer.requests import Finding, Request


def commands(name: str, value: Any, request: Request, context: ReadContext) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield the index and the fields of each command in a decoded list, and add a failure for each invalid command.

    An absent list, null and ``{}`` count as an empty list, and null commands are skipped. An object with a path counts
    as a list of one command, because an example in the protocol's document has that form.
    """
    if value is None or value == {}:
        return
    if isinstance(value, dict) and "path" in value:
        value = [value]
    if not isinstance(value, list):
        failure = Finding(name, 0, None, f"{name} must be a list of commands, not {show(value)}")
        request.fail(failure, context.limits)
        return
    for index, command in enumerate(value):
        if isinstance(command, dict):
            yield index, cast("dict[str, Any]", command)
        elif command is not None:
            failure = Finding(name, index, None, f"a command must be an object, not {show(command)}")
            request.fail(failure, context.limits)
