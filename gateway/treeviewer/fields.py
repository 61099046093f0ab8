"""Read single fields of a command, as tolerantly as Director's clients need.

Functions raise ``CommandError`` for a value that cannot be used, and ``NothingToDraw`` for one that is understood but
cannot be drawn (NaN, infinite, or farther than ``MAX_DISTANCE``).
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from gateway.scene.transforms import IDENTITY, from_pose
from gateway.scene.tree import Path, PathElement, Pose
from gateway.treeviewer.context import ReadContext

ZERO_TRANSLATION: Final = (0.0, 0.0, 0.0)
IDENTITY_QUATERNION: Final = (1.0, 0.0, 0.0, 0.0)
MAX_DISTANCE: Final = 1e15
"""Metres: beyond it float32 is too coarse for images, and squares of lengths overflow."""
_INT64: Final = 2**63
_NUMBER_TYPES: Final = frozenset((int, float))
_STRING_TYPE: Final = frozenset((str,))
_IDENTITY_POSE: Final = (*ZERO_TRANSLATION, *IDENTITY_QUATERNION)


class CommandError(ValueError):
    """A command cannot be executed; the message names field, value and reason."""


class NothingToDraw(Exception):  # noqa: N818 - no failure: the geometry is present and empty
    """A geometry is understood but has nothing that can be drawn (a NaN radius, a missing file)."""


def show(value: Any) -> str:
    """Return a value as short JSON for a message."""
    if isinstance(value, (list, dict)) and len(value) > 20:
        return f"a {type(value).__name__} of {len(value)}"
    try:
        text = json.dumps(value[:80] if isinstance(value, str) else value, ensure_ascii=False)
        text.encode()
    except (ValueError, TypeError, RecursionError):  # lone surrogates, integers of thousands of digits, deep nesting
        text = f"<{type(value).__name__}>"
    return text if len(text) <= 60 else text[:57] + "..."


def number(value: Any, name: str) -> float:
    """Return a number, which may be NaN, or a bool as 0 or 1 (a recorded client sends ``"radius": false``)."""
    if isinstance(value, (int, float)):
        try:
            return float(value)
        except OverflowError:
            return math.inf if value > 0 else -math.inf
    raise CommandError(f"{name} must be a number, not {show(value)}")


def numbers(value: Any, name: str, count: int) -> tuple[float, ...]:
    """Return a list of exactly ``count`` numbers."""
    if type(value) is list and len(value) == count and _NUMBER_TYPES.issuperset(map(type, value)):
        try:
            return tuple(map(float, value))
        except OverflowError:
            pass
    if not isinstance(value, list):
        raise CommandError(f"{name} must be a list of {count} numbers, not {show(value)}")
    if len(value) != count:
        raise CommandError(f"{name} has {len(value)} numbers, not {count}")
    return tuple(number(v, name) for v in value)


def drawable(value: float, name: str) -> float:
    """Return the value; raise NothingToDraw if it is not finite or too large."""
    if not abs(value) <= MAX_DISTANCE:
        raise NothingToDraw(f"{name} is {value:g}, so nothing is drawn")
    return value


def required(params: Mapping[str, Any], name: str) -> float:
    """Return a number that must be present."""
    value = params.get(name)
    if value is None:
        raise CommandError(f"{name} is missing")
    return drawable(number(value, name), name)


def size(params: Mapping[str, Any], name: str, default: float) -> float:
    """Return an optional length in metres, at least 0."""
    value = params.get(name)
    if value is None:
        return default
    return max(drawable(number(value, name), name), 0.0)


def radius(params: Mapping[str, Any], warnings: list[str]) -> float:
    """Return a required radius in metres. A negative one counts as 0, as in VTK, with a warning."""
    given = required(params, "radius")
    if given < 0.0:
        warnings.append(f"radius is {given:g}, it counts as 0")
    return max(given, 0.0)


def length(params: Mapping[str, Any], warnings: list[str]) -> float:
    """Return the absolute value of a required length in metres, as Director does; warn if it is negative."""
    given = required(params, "length")
    if given < 0.0:
        warnings.append(f"length is {given:g}, its absolute value is drawn")
    return abs(given)


def triple(params: Mapping[str, Any], name: str, warnings: list[str]) -> tuple[float, float, float]:
    """Return three required lengths. A single number counts for all three; negative ones as in ``length``."""
    value = params.get(name)
    if value is None:
        raise CommandError(f"{name} is missing")
    if isinstance(value, list) and len(value) != 1:
        x, y, z = (drawable(edge, name) for edge in numbers(value, name, 3))
    else:
        x = y = z = drawable(number(value[0] if isinstance(value, list) else value, name), name)
    if min(x, y, z) < 0.0:
        warnings.append(f"{name} has a negative number, its absolute value is drawn")
    return abs(x), abs(y), abs(z)


def color(params: Mapping[str, Any], warnings: list[str]) -> tuple[float, float, float, float]:
    """Return sRGB and alpha, white by default.

    Three numbers are opaque; a fifth is ignored with a warning, as in Director. Numbers outside 0 to 1 are clamped, NaN
    counts as 0.
    """
    value = params.get("color")
    if value is None:
        return 1.0, 1.0, 1.0, 1.0
    if not isinstance(value, list) or len(value) < 3:
        raise CommandError(f"color must be a list of 4 numbers, not {show(value)}")
    if len(value) > 4:
        warnings.append(f"color has {len(value)} numbers, the first 4 are used")
        value = value[:4]
    r, g, b, *alpha = numbers(value, "color", len(value))
    return _clamp(r), _clamp(g), _clamp(b), _clamp(alpha[0]) if alpha else 1.0


def _clamp(value: float) -> float:
    return 1.0 if value >= 1.0 else max(0.0, value)


def pose(value: Any, name: str = "transform") -> Pose:
    """Return the pose of a transform, of which both parts are optional. NaN and infinity are allowed."""
    if not isinstance(value, Mapping):
        raise CommandError(f"{name} must be an object with translation and quaternion, not {show(value)}")
    translation, quaternion = value.get("translation"), value.get("quaternion")
    t = ZERO_TRANSLATION if translation is None else numbers(translation, f"{name}.translation", 3)
    q = IDENTITY_QUATERNION if quaternion is None else numbers(quaternion, f"{name}.quaternion", 4)
    return cast("Pose", t + q)


def local_transform(params: Mapping[str, Any]) -> NDArray[np.float64]:
    """Return a geometry's own transform, (4, 4); ``IDENTITY`` itself if it has none."""
    value = params.get("transform")
    if value is None:
        return IDENTITY
    p = pose(value)
    if p == _IDENTITY_POSE:
        return IDENTITY
    if not all(abs(v) <= MAX_DISTANCE for v in p):
        raise NothingToDraw("transform is not finite, so nothing is drawn")
    return from_pose(p[:3], p[3:])


def path(command: Mapping[str, Any], context: ReadContext) -> Path:
    """Return the command's path; a string is split at slashes."""
    limits = context.limits
    if "path" not in command:
        raise CommandError("path is missing")
    value = command["path"]
    if isinstance(value, str):
        if context.arrays.is_reference(value):
            raise CommandError(f"path has more than {limits.path_elements} elements")
        value = [name for name in value.split("/") if name]
    if not isinstance(value, list):
        raise CommandError(f"path must be a list of strings, not {show(value)}")
    if len(value) > limits.path_elements:
        raise CommandError(f"path has {len(value)} elements, the limit is {limits.path_elements}")
    if (
        _STRING_TYPE.issuperset(map(type, value))
        and sum(map(len, value)) <= limits.element_chars
        and all(map(str.isascii, value))
    ):
        return tuple(value)
    return tuple(_element(element, index, limits.element_chars) for index, element in enumerate(value))


def _element(value: Any, index: int, max_chars: int) -> PathElement:
    if isinstance(value, str):
        if len(value) > max_chars:
            raise CommandError(f"path[{index}] has {len(value)} characters, the limit is {max_chars}")
        try:
            value.encode()
        except UnicodeEncodeError:
            raise CommandError(f"path[{index}] is not Unicode text: {show(value)}") from None
        return value
    if isinstance(value, int) and not isinstance(value, bool):
        if not -_INT64 <= value < 2 * _INT64:
            raise CommandError(f"path[{index}] is a number of more than 64 bits")
        return value
    raise CommandError(f"path[{index}] must be a string or an integer, not {show(value)}")
