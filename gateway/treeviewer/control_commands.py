"""Read the commands of controls in the page: ``setcontrols`` and ``setvalues``."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, Final

import msgspec

from gateway.scene.tree import Path
from gateway.treeviewer import fields
from gateway.treeviewer.command_lists import read_list
from gateway.treeviewer.context import ReadContext
from gateway.treeviewer.packed_arrays import ArrayError
from gateway.treeviewer.requests import ControlChange, Finding, Request
from scenegate.messages.controls import MAX_SAMPLES, MAX_SERIES, AnyControl
from scenegate.messages.field_kinds import CommandError, show

_SAMPLE_COLUMNS: Final = tuple(range(2, 2 + MAX_SERIES))


def read_controls(value: Any, request: Request, context: ReadContext) -> None:
    """Read ``setcontrols``: set ``request.controls``. One invalid control fails the whole command."""
    context.require_thread()  # 1000 controls take 12 ms
    if not _is_short("setcontrols", value, request, context):
        return
    controls: list[AnyControl] = []
    failures_before = len(request.failures)
    read_list("setcontrols", value, request, context, partial(_control, context), controls)
    if len(request.failures) == failures_before:
        request.controls = controls


def read_values(value: Any, request: Request, context: ReadContext) -> None:
    """Read ``setvalues``: add the values and samples of controls to ``request.control_changes``."""
    if _is_short("setvalues", value, request, context):
        read_list("setvalues", value, request, context, partial(_control_change, context), request.control_changes)


def _is_short(name: str, value: Any, request: Request, context: ReadContext) -> bool:
    """Return True if a command has as many elements as the limit allows; else add a failure."""
    limit = context.limits.controls
    if isinstance(value, list) and len(value) > limit:
        request.fail(Finding(name, 0, f"{name} has {len(value)} elements, the limit is {limit}"), context.limits)
        return False
    return True


def _control_change(context: ReadContext, index: int, path: Path, command: Mapping[str, Any]) -> ControlChange:
    """Return the value or samples of a control in a command."""
    if ("value" in command) == ("samples" in command):
        raise CommandError("a command has either a value or samples")
    if "value" in command:
        return ControlChange(index, path, command["value"], None)
    try:
        samples = context.arrays.doubles(command["samples"], _SAMPLE_COLUMNS, MAX_SAMPLES)
    except ArrayError as error:
        raise CommandError(f"samples {error}") from None
    return ControlChange(index, path, None, samples)


def _control(context: ReadContext, _: int, path: Path, command: Mapping[str, Any]) -> AnyControl:
    """Return the control that a command describes."""
    values = {**command, "path": path}
    if "node" in values:
        values["node"] = fields.path({"path": values["node"]}, context)
    try:
        control: AnyControl = msgspec.convert(values, AnyControl)
    except UnicodeEncodeError:
        raise CommandError("a control has a text that is not Unicode") from None
    except msgspec.ValidationError as error:
        # msgspec: Expected `float`, got `str` - at `$.min`
        reason, __, place = str(error).partition(" - at `$.")
        name = place.rstrip("`")
        raise CommandError(f"{name} is {show(values.get(name))}: {reason}" if name in values else str(error)) from None
    return control
