"""Reads single fields of a command, with the tolerance that Director's clients rely on."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from gateway.scene.transforms import IDENTITY, from_pose
from gateway.scene.tree import Path, PathElement, Pose
from gateway.treeviewer.config import Limits
from gateway.treeviewer.number_arrays import Numbers

ZERO_TRANSLATION: Final = (0.0, 0.0, 0.0)
IDENTITY_QUATERNION: Final = (1.0, 0.0, 0.0, 0.0)
FARTHEST: Final = 1e15
"""Metres; beyond it float32 pictures mean nothing and squares of lengths overflow."""
_INT64: Final = 2**63
_PLAIN: Final = frozenset((int, float))
_NAME: Final = frozenset((str,))
_IDENTITY_POSE: Final = (*ZERO_TRANSLATION, *IDENTITY_QUATERNION)


class CommandError(ValueError):
    """A command cannot be carried out; the message names field, value and reason."""


class NothingToDraw(Exception):  # noqa: N818 - not a failure: the geometry is present and empty
    """A geometry is understood but has nothing that can be drawn (a NaN radius, a missing file)."""


def show(value: Any) -> str:
    """A value for a message, as JSON writes it, short."""
    if isinstance(value, (list, dict)) and len(value) > 20:
        return f"a {type(value).__name__} of {len(value)}"
    try:
        text = json.dumps(value[:80] if isinstance(value, str) else value, ensure_ascii=False)
        text.encode()
    except (ValueError, TypeError, RecursionError):  # surrogates, endless digits, deep nesting
        text = f"<{type(value).__name__}>"
    return text if len(text) <= 60 else text[:57] + "..."


def number(value: Any, name: str) -> float:
    """A JSON number, or a bool as Python counts it (a recorded client sends ``"radius": false``). May be NaN."""
    if isinstance(value, (int, float)):
        try:
            return float(value)
        except OverflowError:
            return math.inf if value > 0 else -math.inf
    raise CommandError(f"{name} must be a number, not {show(value)}")


def numbers(value: Any, name: str, count: int) -> tuple[float, ...]:
    """A list of exactly ``count`` numbers."""
    if type(value) is list and len(value) == count and _PLAIN.issuperset(map(type, value)):
        try:
            return tuple(map(float, value))
        except OverflowError:
            pass
    if not isinstance(value, list):
        raise CommandError(f"{name} must be a list of {count} numbers, not {show(value)}")
    if len(value) != count:
        raise CommandError(f"{name} has {len(value)} numbers, not {count}")
    return tuple(number(v, name) for v in value)


def size(params: Mapping[str, Any], name: str, default: float) -> float:
    """An optional length in metres, at least 0.

    Raises:
        NothingToDraw: NaN, infinite or farther than pictures reach.
    """
    value = params.get(name)
    if value is None:
        return default
    return max(drawable(number(value, name), name), 0.0)


def drawable(value: float, name: str) -> float:
    """The value, if a picture can show it."""
    if not abs(value) <= FARTHEST:
        raise NothingToDraw(f"{name} is {value:g}, so nothing is drawn")
    return value


def radius(params: Mapping[str, Any], warnings: list[str]) -> float:
    """A required radius in metres; a negative one counts as 0, as in VTK's sources, with a warning."""
    given = required(params, "radius")
    if given < 0.0:
        warnings.append(f"radius is {given:g}, it counts as 0")
    return max(given, 0.0)


def length(params: Mapping[str, Any], warnings: list[str]) -> float:
    """A required length in metres; of a negative one the absolute value counts, as in Director, with a warning."""
    given = required(params, "length")
    if given < 0.0:
        warnings.append(f"length is {given:g}, its absolute value is drawn")
    return abs(given)


def required(params: Mapping[str, Any], name: str) -> float:
    """A number that must be there.

    Raises:
        NothingToDraw: NaN, infinite or farther than pictures reach.
    """
    value = params.get(name)
    if value is None:
        raise CommandError(f"{name} is missing")
    return drawable(number(value, name), name)


def triple(params: Mapping[str, Any], name: str, warnings: list[str]) -> tuple[float, float, float]:
    """Three lengths in metres; a single number counts for all three. Negative ones as in ``length``."""
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
    """RGBA in 0..1 as displays show it; three numbers are opaque, a fifth is ignored with a warning, as in Director.

    Values outside are clamped, NaN counts as 0.
    """
    value = params.get("color")
    if value is None:
        return 1.0, 1.0, 1.0, 1.0
    if not isinstance(value, list) or len(value) < 3:
        raise CommandError(f"color must be a list of 4 numbers, not {show(value)}")
    if len(value) > 4:
        warnings.append(f"color has {len(value)} numbers, the first 4 are used")
        value = value[:4]
    r, g, b, *rest = numbers(value, "color", len(value))
    return _unit(r), _unit(g), _unit(b), _unit(rest[0]) if rest else 1.0


def _unit(value: float) -> float:
    return 1.0 if value >= 1.0 else max(0.0, value)


def pose(value: Any, name: str = "transform") -> Pose:
    """A transform of the protocol; both parts are optional. NaN goes through: it is the client's to send."""
    if not isinstance(value, Mapping):
        raise CommandError(f"{name} must be an object with translation and quaternion, not {show(value)}")
    translation, quaternion = value.get("translation"), value.get("quaternion")
    t = ZERO_TRANSLATION if translation is None else numbers(translation, f"{name}.translation", 3)
    q = IDENTITY_QUATERNION if quaternion is None else numbers(quaternion, f"{name}.quaternion", 4)
    return cast("Pose", t + q)


def placement(params: Mapping[str, Any]) -> NDArray[np.float64]:
    """(4, 4): a geometry's own transform; ``IDENTITY`` itself where it has none."""
    value = params.get("transform")
    if value is None:
        return IDENTITY
    p = pose(value)
    if p == _IDENTITY_POSE:
        return IDENTITY
    if not all(abs(v) <= FARTHEST for v in p):
        raise NothingToDraw("transform is not finite, so nothing is drawn")
    return from_pose(p[:3], p[3:])


def path(command: Mapping[str, Any], limits: Limits, held: Numbers) -> Path:
    """The command's path; a string is split at slashes."""
    if "path" not in command:
        raise CommandError("path is missing")
    value = command["path"]
    if isinstance(value, str):
        if held.holds(value):
            raise CommandError(f"path has more than {limits.path_elements} elements")
        value = [name for name in value.split("/") if name]
    if not isinstance(value, list):
        raise CommandError(f"path must be a list of strings, not {show(value)}")
    if len(value) > limits.path_elements:
        raise CommandError(f"path has {len(value)} elements, the limit is {limits.path_elements}")
    if (
        _NAME.issuperset(map(type, value))
        and sum(map(len, value)) <= limits.element_chars
        and all(map(str.isascii, value))
    ):
        return tuple(value)
    return tuple(_element(element, index, limits) for index, element in enumerate(value))


def _element(value: Any, index: int, limits: Limits) -> PathElement:
    if isinstance(value, str):
        if len(value) > limits.element_chars:
            raise CommandError(f"path[{index}] has {len(value)} characters, the limit is {limits.element_chars}")
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
