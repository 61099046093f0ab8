"""Read single fields of a command. Irregular values that known clients of Director send are accepted.

The functions raise ``CommandError`` for an invalid value, and ``NothingToDraw`` for a valid one that cannot be drawn:
NaN, infinite, or beyond ``MAX_DISTANCE``. ``params`` are the fields of a decoded JSON object.
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
"""Maximum of drawable lengths and coordinates, in metres. The squares of larger ones may overflow float32."""
MAX_PIXELS: Final = 256.0
"""Maximum width of points and lines, in pixels: browsers draw no wider points everywhere."""
_INT64: Final = 2**63
_NUMBER_TYPES: Final = frozenset((int, float))
_STRING_TYPE: Final = frozenset((str,))
_IDENTITY_POSE: Final = (*ZERO_TRANSLATION, *IDENTITY_QUATERNION)


class CommandError(ValueError):
    """Failure of one command; the message names the field, its value and the reason."""


class NothingToDraw(Exception):  # noqa: N818 - no failure: the path gets an empty geometry
    """A geometry is valid but cannot be drawn (a NaN radius, a missing file); the message is the reason."""


def show(value: Any) -> str:
    """Return a value as JSON of at most 60 characters, for an error text."""
    if isinstance(value, (list, dict)) and len(value) > 20:
        return f"a {type(value).__name__} of {len(value)}"
    try:
        text = json.dumps(value[:80] if isinstance(value, str) else value, ensure_ascii=False)
        text.encode()
    except (ValueError, TypeError, RecursionError):  # lone surrogates, integers of thousands of digits, deep nesting
        text = f"<{type(value).__name__}>"
    return text if len(text) <= 60 else text[:57] + "..."


def number(value: Any, name: str) -> float:
    """Return a number, which may be NaN or infinite. A bool counts as 0 or 1: a client sends ``"radius": false``."""
    if isinstance(value, (int, float)):
        try:
            return float(value)
        except OverflowError:
            return math.inf if value > 0 else -math.inf
    raise CommandError(f"{name} must be a number, not {show(value)}")


def numbers(value: Any, name: str, count: int) -> tuple[float, ...]:
    """Return the ``count`` numbers of a list. Another length is an error."""
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
    """Return the value; raise NothingToDraw if it is not finite or beyond ``MAX_DISTANCE``."""
    if not abs(value) <= MAX_DISTANCE:
        raise NothingToDraw(f"{name} is {value:g}, so nothing is drawn")
    return value


def required(params: Mapping[str, Any], name: str) -> float:
    """Return a required, drawable number."""
    value = params.get(name)
    if value is None:
        raise CommandError(f"{name} is missing")
    return drawable(number(value, name), name)


def size(params: Mapping[str, Any], name: str, default: float) -> float:
    """Return an optional length in metres. A negative one counts as 0."""
    value = params.get(name)
    if value is None:
        return default
    return max(drawable(number(value, name), name), 0.0)


def positive(params: Mapping[str, Any], name: str) -> float:
    """Return a required number above 0."""
    value = required(params, name)
    if value <= 0.0:
        raise CommandError(f"{name} must be above 0, not {value:g}")
    return value


def pixels(params: Mapping[str, Any], name: str, default: float) -> float:
    """Return an optional width in pixels, from 1 to ``MAX_PIXELS``."""
    value = params.get(name)
    if value is None:
        return default
    width = number(value, name)
    if not 1.0 <= width <= MAX_PIXELS:
        raise CommandError(f"{name} must be from 1 to {MAX_PIXELS:g} pixels, not {width:g}")
    return width


def radius(params: Mapping[str, Any], warnings: list[str]) -> float:
    """Return a required radius in metres. A negative one counts as 0, as in VTK, with a warning."""
    value = required(params, "radius")
    if value < 0.0:
        warnings.append(f"radius is {value:g}, it counts as 0")
    return max(value, 0.0)


def length(params: Mapping[str, Any], warnings: list[str]) -> float:
    """Return the absolute value of a required length in metres, as Director does. Warns of a negative length."""
    value = required(params, "length")
    if value < 0.0:
        warnings.append(f"length is {value:g}, its absolute value is drawn")
    return abs(value)


def lengths_xyz(params: Mapping[str, Any], name: str, warnings: list[str]) -> tuple[float, float, float]:
    """Return three required lengths along x, y, z. One number counts for all three; negative ones as in ``length``."""
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


def color(
    params: Mapping[str, Any],
    warnings: list[str],
    name: str = "color",
    default: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0),
) -> tuple[float, float, float, float]:
    """Return red, green, blue (sRGB) and alpha from 0 to 1.

    Alpha may be absent. A fifth number is ignored with a warning, as in Director. Numbers outside of 0 to 1 are
    clamped; NaN counts as 0.
    """
    value = params.get(name)
    if value is None:
        return default
    if not isinstance(value, list) or len(value) < 3:
        raise CommandError(f"{name} must be a list of 4 numbers, not {show(value)}")
    if len(value) > 4:
        warnings.append(f"{name} has {len(value)} numbers, the first 4 are used")
        value = value[:4]
    r, g, b, *alpha = numbers(value, name, len(value))
    return _clamp(r), _clamp(g), _clamp(b), _clamp(alpha[0]) if alpha else 1.0


def _clamp(value: float) -> float:
    return 1.0 if value >= 1.0 else max(0.0, value)


def pose(value: Any, name: str = "transform") -> Pose:
    """Return the pose of a transform. Translation and quaternion are optional, and may be NaN or infinite."""
    if not isinstance(value, Mapping):
        raise CommandError(f"{name} must be an object with translation and quaternion, not {show(value)}")
    translation, quaternion = value.get("translation"), value.get("quaternion")
    t = ZERO_TRANSLATION if translation is None else numbers(translation, f"{name}.translation", 3)
    q = IDENTITY_QUATERNION if quaternion is None else numbers(quaternion, f"{name}.quaternion", 4)
    return cast("Pose", t + q)


def local_transform(params: Mapping[str, Any]) -> NDArray[np.float64]:
    """Return the transform from a geometry's frame to its path's, (4, 4); the object ``IDENTITY`` if there is none."""
    value = params.get("transform")
    if value is None:
        return IDENTITY
    translation_quaternion = pose(value)
    if translation_quaternion == _IDENTITY_POSE:
        return IDENTITY
    if not all(abs(v) <= MAX_DISTANCE for v in translation_quaternion):
        raise NothingToDraw("transform is not finite, so nothing is drawn")
    return from_pose(translation_quaternion[:3], translation_quaternion[3:])


def path(command: Mapping[str, Any], context: ReadContext) -> Path:
    """Return the command's path: a list of names, or a string that is split at slashes."""
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
    return tuple(_path_element(element, index, limits.element_chars) for index, element in enumerate(value))


def _path_element(value: Any, index: int, max_chars: int) -> PathElement:
    """Return element ``index`` of a path: a string or an integer."""
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
