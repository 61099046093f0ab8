"""Read the commands that Director does not have: properties of paths, the page's view, clicks and controls.

Other viewers ignore them. A response of Scenegate lists those of the request in ``newer_commands``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

import msgspec
import numpy as np

from gateway.adapters.treeviewer import fields
from gateway.adapters.treeviewer.commands import read_list, read_path
from gateway.adapters.treeviewer.context import ReadContext
from gateway.adapters.treeviewer.packed_arrays import ArrayError
from gateway.adapters.treeviewer.requests import ControlChange, Finding, Request
from gateway.scene.draw.cameras import LookAtCamera
from gateway.scene.tree.nodes import Path
from scenegate.messages.controls import MAX_SAMPLES, MAX_SERIES, AnyControl
from scenegate.messages.field_kinds import MAX_DISTANCE, CommandError, number, numbers, show

_SAMPLE_COLUMNS: Final = tuple(range(2, 2 + MAX_SERIES))


def _read_properties(value: Any, request: Request, context: ReadContext) -> None:
    """Read ``setproperty``: add the visibility and opacity of paths to ``request.properties``."""

    def read(_: int, path: Path, command: Mapping[str, Any]) -> tuple[Path, bool | None, float | None]:
        visible, opacity = command.get("visible"), command.get("opacity")
        if visible is None and opacity is None:
            raise CommandError("visible and opacity are missing")
        if visible is not None and not isinstance(visible, bool):
            raise CommandError(f"visible must be true or false, not {show(visible)}")
        if opacity is not None:
            opacity = number(opacity, "opacity")
            if not 0.0 <= opacity <= 1.0:
                raise CommandError(f"opacity must be from 0 to 1, not {show(opacity)}")
        return path, visible, opacity

    read_list("setproperty", value, request, context, read, request.properties)


def _read_view(value: Any, request: Request, context: ReadContext) -> None:
    """Read ``setview``: set ``request.view`` to the fields of the page's view that change."""
    try:
        if not isinstance(value, dict):
            raise CommandError(f"setview must be an object, not {show(value)}")
        changes: dict[str, Any] = {}
        for name, read in (("background", _background), ("grid", _grid), ("home", _home)):
            if name in value:
                changes[name] = None if value[name] is None else read(value[name])
    except CommandError as error:
        request.fail(Finding("setview", 0, str(error)), context.limits)
    else:
        request.view = changes


def _background(value: Any) -> tuple[float, ...]:
    """Return red, green and blue, sRGB from 0 to 1."""
    color = numbers(value, "background", 3)
    if not all(0.0 <= channel <= 1.0 for channel in color):
        raise CommandError(f"background must have numbers from 0 to 1, not {show(value)}")
    return color


def _grid(value: Any) -> bool:
    if not isinstance(value, bool):
        raise CommandError(f"grid must be true, false or null, not {show(value)}")
    return value


def _home(value: Any) -> LookAtCamera:
    """Return the camera of the page's home view: eye and target in metres, and the direction up, by default +z."""
    if not isinstance(value, dict):
        raise CommandError(f"home must be an object with eye, target and up, not {show(value)}")
    vectors: list[tuple[float, float, float]] = []
    for name, default in (("eye", None), ("target", None), ("up", [0.0, 0.0, 1.0])):
        sent = value.get(name)
        x, y, z = numbers(default if sent is None else sent, f"home.{name}", 3)
        if not max(abs(x), abs(y), abs(z)) <= MAX_DISTANCE:
            raise CommandError(f"home.{name} must have numbers up to {MAX_DISTANCE:g}, not {show(sent)}")
        vectors.append((x, y, z))
    eye, target, up = vectors
    line_of_sight = np.subtract(target, eye)
    distance = float(np.linalg.norm(line_of_sight))
    if not distance > 0.0:
        raise CommandError("home.eye and home.target are the same point")
    up_across_sight = float(np.linalg.norm(np.cross(line_of_sight, up))) / distance  # length of this part of ``up``
    if not up_across_sight > 1e-6 * float(np.linalg.norm(up)):
        raise CommandError("home.up must not be zero nor along the line of sight")
    return LookAtCamera(eye, target, up)


def _read_clicks(value: Any, request: Request, context: ReadContext) -> None:
    """Read ``setclicks``: set ``request.click_paths``. One invalid path fails the whole command."""
    paths: list[Path] = []
    failures_before = len(request.failures)
    read_list("setclicks", value, request, context, read_path, paths)
    if len(request.failures) == failures_before:
        request.click_paths = paths


def _read_controls(value: Any, request: Request, context: ReadContext) -> None:
    """Read ``setcontrols``: set ``request.controls``. One invalid control fails the whole command."""
    context.require_thread()  # 1000 controls take 12 ms

    def read(_: int, path: Path, command: Mapping[str, Any]) -> AnyControl:
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
            clause = f"{name} is {show(values.get(name))}: {reason}" if name in values else str(error)
            raise CommandError(clause) from None
        return control

    controls: list[AnyControl] = []
    failures_before = len(request.failures)
    if _is_short("setcontrols", value, request, context):
        read_list("setcontrols", value, request, context, read, controls)
    if len(request.failures) == failures_before:
        request.controls = controls


def _read_values(value: Any, request: Request, context: ReadContext) -> None:
    """Read ``setvalues``: add the values and samples of controls to ``request.control_changes``."""

    def read(index: int, path: Path, command: Mapping[str, Any]) -> ControlChange:
        if ("value" in command) == ("samples" in command):
            raise CommandError("a command has either a value or samples")
        if "value" in command:
            return ControlChange(index, path, command["value"], None)
        try:
            samples = context.arrays.doubles(command["samples"], _SAMPLE_COLUMNS, MAX_SAMPLES)
        except ArrayError as error:
            raise CommandError(f"samples {error}") from None
        return ControlChange(index, path, None, samples)

    if _is_short("setvalues", value, request, context):
        read_list("setvalues", value, request, context, read, request.control_changes)


def _is_short(name: str, value: Any, request: Request, context: ReadContext) -> bool:
    """Return True if a command has as many elements as the limit allows; else add a failure."""
    limit = context.limits.controls
    if isinstance(value, list) and len(value) > limit:
        request.fail(Finding(name, 0, f"{name} has {len(value)} elements, the limit is {limit}"), context.limits)
        return False
    return True


READERS: Final[Mapping[str, Callable[[Any, Request, ReadContext], None]]] = {
    "setproperty": _read_properties,
    "setview": _read_view,
    "setclicks": _read_clicks,
    "setcontrols": _read_controls,
    "setvalues": _read_values,
}
"""Functions that read a decoded command into the request, by name."""
