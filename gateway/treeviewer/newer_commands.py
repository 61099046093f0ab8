"""Read the commands that Director does not have: ``setproperty``, ``setview``, ``setclicks``, and those of controls.

Other viewers ignore them. A response of Scenegate lists those of the request in ``newer_commands``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from gateway.scene.cameras import LookAtCamera
from gateway.scene.tree import Path
from gateway.treeviewer.command_lists import read_list, read_path
from gateway.treeviewer.context import ReadContext
from gateway.treeviewer.control_commands import read_controls, read_values
from gateway.treeviewer.requests import Finding, Request
from scenegate.messages.field_kinds import MAX_DISTANCE, CommandError, number, numbers, show


def _read_properties(value: Any, request: Request, context: ReadContext) -> None:
    """Read ``setproperty``: add the visibility and opacity of paths to ``request.properties``."""
    read_list("setproperty", value, request, context, _properties, request.properties)


def _properties(_: int, path: Path, command: Mapping[str, Any]) -> tuple[Path, bool | None, float | None]:
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
    """Return the camera of the page's home view."""
    if not isinstance(value, dict):
        raise CommandError(f"home must be an object with eye, target and up, not {show(value)}")
    eye, target, up = (_home_vector(value, name) for name in ("eye", "target", "up"))
    line_of_sight = np.subtract(target, eye)
    distance = float(np.linalg.norm(line_of_sight))
    up_length = float(np.linalg.norm(up))
    if not distance > 0.0:
        raise CommandError("home.eye and home.target are the same point")
    if not float(np.linalg.norm(np.cross(line_of_sight, up))) > 1e-6 * distance * up_length:
        raise CommandError("home.up must not be zero nor along the line of sight")
    return LookAtCamera(eye, target, up)


def _home_vector(home: Mapping[str, Any], name: str) -> tuple[float, float, float]:
    """Return ``eye`` or ``target`` in metres, or the direction ``up``, which is +z by default."""
    value = home.get(name)
    if value is None and name == "up":
        return 0.0, 0.0, 1.0
    x, y, z = numbers(value, f"home.{name}", 3)
    if not max(abs(x), abs(y), abs(z)) <= MAX_DISTANCE:
        raise CommandError(f"home.{name} must have numbers up to {MAX_DISTANCE:g}, not {show(value)}")
    return x, y, z


def _read_clicks(value: Any, request: Request, context: ReadContext) -> None:
    """Read ``setclicks``: set ``request.click_paths``. One invalid path fails the whole command."""
    paths: list[Path] = []
    failures_before = len(request.failures)
    read_list("setclicks", value, request, context, read_path, paths)
    if len(request.failures) == failures_before:
        request.click_paths = paths


READERS: Final[Mapping[str, Callable[[Any, Request, ReadContext], None]]] = {
    "setproperty": _read_properties,
    "setview": _read_view,
    "setclicks": _read_clicks,
    "setcontrols": read_controls,
    "setvalues": read_values,
}
"""Functions that read a decoded command into the request, by name."""
