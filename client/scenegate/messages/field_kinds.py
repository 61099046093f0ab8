"""Kinds of fields of geometries: how clients write a value, and how viewers read it.

A geometry's class annotates each of its fields with a kind, as in ``radius: Radius``. Readers accept the irregular
values that known clients of Director send. They raise ``CommandError`` for an invalid value, and ``NothingToDraw`` for
a valid one that cannot be drawn: NaN, infinite, or beyond ``MAX_DISTANCE``.
"""

import json
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Final, Protocol

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

from scenegate.messages.arguments import as_array, describe
from scenegate.messages.colors import RANGE_TOLERANCE, ImageLike, color_rows, image_field, rgba
from scenegate.messages.request_encoding import empty_with_header
from scenegate.transforms import Vector
from scenegate.warning_text import NOTHING_DRAWN

MAX_COLOR: Final = 1.0 + RANGE_TOLERANCE
"""Colours above it are reported."""
MAX_DISTANCE: Final = 1e15
"""Maximum of drawable lengths and coordinates, in metres. The squares of larger ones may overflow float32."""
MAX_PIXELS: Final = 256.0
"""Maximum width of points and lines, in pixels: browsers draw no wider points everywhere."""
MAX_CHANNEL_COLUMNS: Final = 16
"""Maximum number of values per point in one channel of a point cloud."""
MIN_TRIAD_SCALE: Final = 1e-6
"""Minimum length of a triad's axes, in metres."""
ARRAY_TEXTS: Final = ('[{"\\u0000', '{"\\u0000')
"""Starts of the JSON that stands for a long list of numbers in a viewer that reads JSON."""
_NUMBER_TYPES: Final = frozenset((int, float))


class CommandError(ValueError):
    """Failure of one command; the message names the field, its value and the reason."""


class NothingToDraw(Exception):  # noqa: N818 - no failure: the path gets an empty geometry
    """A geometry is valid but cannot be drawn (a NaN radius, a missing file); the message is the reason."""


class FieldReader(Protocol):
    """State of a viewer that reads a geometry, and its readers of arrays and images."""

    warnings: list[str]
    """One sentence for each irregularity that was tolerated."""

    def rows(self, value: Any, name: str, columns: tuple[int, ...], limit: str) -> NDArray[np.float32]:
        """Return (N, one of ``columns``), or (N,) for one column; ``limit`` is the name of the limit of N."""
        ...

    def grid(self, value: Any, name: str) -> NDArray[np.float32]:
        """Return rows of numbers of any length."""
        ...

    def colors(self, value: Any, name: str) -> NDArray[np.float32]:
        """Return sRGB colours from 0 to 1, (N, 3) or (N, 4)."""
        ...

    def image(self, value: Any, name: str) -> Any:
        """Return a decoded image."""
        ...

    def text(self, value: Any, name: str) -> str:
        """Return text within the viewer's limit."""
        ...


@dataclass(frozen=True, slots=True)
class FieldKind:
    """Kind of a field of the protocol."""

    read: Callable[[Any, str, FieldReader], Any] = field(repr=False)  # ``help`` shows kinds in signatures
    """Returns the value of a field for the scene. Arguments: the decoded value, not null; the field's name."""
    write: Callable[[str, Any], Any] = field(repr=False)
    """Returns the protocol's value for a value of the user; raises ValueError."""
    regular: Any = field(default=Any, repr=False)
    """Type for msgspec of values that need no reading."""


def show(value: Any) -> str:
    """Return a value as JSON of at most 60 characters, for an error text."""
    if isinstance(value, (list, dict)) and len(value) > 20:
        return f"a {type(value).__name__} of {len(value)}"
    try:
        text = json.dumps(value[:80] if isinstance(value, str) else value, ensure_ascii=False)
        text.encode()
    except (ValueError, TypeError, RecursionError):  # lone surrogates, integers of thousands of digits, deep nesting
        text = f"<{type(value).__name__}>"
    if text.startswith(ARRAY_TEXTS):
        return "a long list of numbers"
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
        raise NothingToDraw(f"{name} is {value:g}, {NOTHING_DRAWN}")
    return value


def read_color(value: Any, name: str, reader: FieldReader) -> tuple[float, float, float, float]:
    """Return red, green, blue (sRGB) and alpha from 0 to 1.

    Alpha may be absent. A fifth number is ignored with a warning, as in Director. Numbers outside of 0 to 1 are
    clamped; NaN counts as 0.
    """
    if not isinstance(value, list) or len(value) < 3:
        raise CommandError(f"{name} must be a list of 4 numbers, not {show(value)}")
    if len(value) > 4:
        reader.warnings.append(f"{name} has {len(value)} numbers, the first 4 are used")
        value = value[:4]
    r, g, b, *alpha = numbers(value, name, len(value))
    if max(r, g, b) > MAX_COLOR:
        reader.warnings.append(f"{name} has {max(r, g, b):g}, colours are from 0 to 1; it counts as 1")
    return _clamp(r), _clamp(g), _clamp(b), _clamp(alpha[0]) if alpha else 1.0


def _clamp(value: float) -> float:
    return 1.0 if value >= 1.0 else max(0.0, value)


def number_list(name: str, values: ArrayLike, *counts: int) -> list[float]:
    """Return a field's values as floats. Raises ValueError if their number is not one of ``counts``."""
    wanted = f"{name} must have {' or '.join(map(str, counts))} numbers"
    array = as_array(values, wanted, np.float64)
    if array.ndim != 1 or len(array) not in counts:
        raise ValueError(f"{wanted}, not {describe(np.asarray(values))}")
    result: list[float] = array.tolist()
    return result


def number_rows(name: str, values: ArrayLike, *columns: int, dtype: type[np.generic] = np.float32) -> NDArray[Any]:
    """Return a copy of a field's values: (N, one of ``columns``), or (N,) if ``columns`` is 1.

    Raises ValueError for another shape, or values that are not numbers (integers for an integer ``dtype``).
    """
    return copied_rows(checked_rows(name, values, *columns, dtype=dtype), dtype)


def checked_rows(name: str, values: ArrayLike, *columns: int, dtype: type[np.generic] = np.float32) -> NDArray[Any]:
    """Return a field's values as ``number_rows`` does, of any type, and perhaps the caller's own array."""
    rows = f"{columns[0]} to {columns[-1]}" if len(columns) > 2 else " or ".join(map(str, columns))
    wanted = f"{name} must have {'numbers' if columns == (1,) else f'rows of {rows}'}"
    array = as_array(values, wanted)
    if array.size == 0:
        return np.empty((0, columns[0]) if columns[0] > 1 else (0,), dtype)
    width = array.shape[1] if array.ndim == 2 else 1
    if array.ndim != (1 if columns == (1,) else 2) or width not in columns:
        raise ValueError(f"{wanted}, not {describe(array)}")
    needs_integers = dtype in (np.int64, np.uint32)
    if array.dtype.kind not in ("iub" if needs_integers else "fiub"):
        raise ValueError(f"{name} must have {'integers' if needs_integers else 'numbers'}, not {array.dtype}")
    return array


def copied_rows(array: NDArray[Any], dtype: type[np.generic] = np.float32) -> NDArray[Any]:
    """Return a copy of values, which TreeViewer keeps, so that the caller's array may change."""
    copy = empty_with_header(array.shape, dtype)
    copy[...] = array
    return copy


def _read_radius(value: Any, name: str, reader: FieldReader) -> float:
    """Return a radius. A negative one counts as 0, as in VTK, with a warning."""
    radius = drawable(number(value, name), name)
    if radius < 0.0:
        reader.warnings.append(f"{name} is {radius:g}, it counts as 0")
    return max(radius, 0.0)


def _read_length(value: Any, name: str, reader: FieldReader) -> float:
    """Return the absolute value of a length, as Director does. Warns of a negative length."""
    length = drawable(number(value, name), name)
    if length < 0.0:
        reader.warnings.append(f"{name} is {length:g}, its absolute value is drawn")
    return abs(length)


def _read_lengths(value: Any, name: str, reader: FieldReader) -> tuple[float, float, float]:
    """Return three lengths along x, y, z. One number counts for all three; negative ones as in ``_read_length``."""
    x, y, z = _read_one_or_three(value, name)
    if min(x, y, z) < 0.0:
        reader.warnings.append(f"{name} has a negative number, its absolute value is drawn")
    return abs(x), abs(y), abs(z)


def _read_one_or_three(value: Any, name: str) -> tuple[float, float, float]:
    if isinstance(value, list) and len(value) != 1:
        x, y, z = (drawable(edge, name) for edge in numbers(value, name, 3))
    else:
        x = y = z = drawable(number(value[0] if isinstance(value, list) else value, name), name)
    return x, y, z


def _read_size(value: Any, name: str, _: FieldReader) -> float:
    """Return a length. A negative one counts as 0."""
    return max(drawable(number(value, name), name), 0.0)


def _read_positive(value: Any, name: str, _: FieldReader) -> float:
    """Return a number above 0."""
    positive = drawable(number(value, name), name)
    if positive <= 0.0:
        raise CommandError(f"{name} must be above 0, not {positive:g}")
    return positive


def _read_extents(value: Any, name: str, _: FieldReader) -> tuple[float, float]:
    """Return two lengths above 0."""
    x, y = (drawable(extent, name) for extent in numbers(value, name, 2))
    if min(x, y) <= 0.0:
        raise CommandError(f"{name} must be above 0, not {min(x, y):g}")
    return x, y


def _read_axis_length(value: Any, name: str, _: FieldReader) -> float:
    scale = drawable(number(value, name), name)
    if abs(scale) < MIN_TRIAD_SCALE:
        raise NothingToDraw(f"{name} is {scale:g}, {NOTHING_DRAWN}")
    return scale


def _read_scale(value: Any, name: str, _: FieldReader) -> tuple[float, float, float]:
    """Return the scale factors along x, y, z. The field has one number for all axes, or three."""
    single = value[0] if isinstance(value, list) and len(value) == 1 else value
    if not isinstance(single, (int, float)) and not (isinstance(value, list) and len(value) == 3):
        raise CommandError(f"{name} must be a number or three, not {show(value)}")
    return _read_one_or_three(value, name)


def _read_pixels(value: Any, name: str, _: FieldReader) -> float:
    width = number(value, name)
    if not 1.0 <= width <= MAX_PIXELS:
        raise CommandError(f"{name} must be from 1 to {MAX_PIXELS:g} pixels, not {width:g}")
    return width


def _read_name(value: Any, name: str, _: FieldReader) -> str:
    if not isinstance(value, str):
        raise CommandError(f"{name} must be a string, not {show(value)}")
    return value


def _write_lengths(name: str, value: ArrayLike) -> tuple[float, ...]:
    if isinstance(value, tuple) and len(value) == 3 and set(map(type, value)) == {float}:
        return value
    return tuple(number_list(name, value, 3))


def _write_scale(name: str, value: float | ArrayLike) -> list[float]:
    return number_list(name, [float(value)] * 3 if isinstance(value, (int, float)) else value, 3)


def write_number(name: str, value: float) -> float:
    """Return a field's number as float; raise ValueError if it is none."""
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be a number, not {describe(value)}") from None


def _write_text(name: str, value: str) -> str:
    if not isinstance(value, str):
        raise ValueError(f"{name} must be a string, not {describe(value)}")
    return value


def _write_file_name(name: str, value: str | os.PathLike[str]) -> str:
    if not isinstance(value, (str, os.PathLike)):
        raise ValueError(f"{name} must be a path, not {describe(value)}")
    return os.fspath(value)


def _write_faces(name: str, value: ArrayLike) -> NDArray[Any]:
    is_uint32 = getattr(value, "dtype", None) == np.uint32  # negative indices of other types must not wrap
    return number_rows(name, value, 3, dtype=np.uint32 if is_uint32 else np.int64)


def _write_channels(name: str, value: Mapping[str, ArrayLike]) -> dict[str, NDArray[Any]]:
    if not isinstance(value, Mapping):
        raise ValueError(f"{name} must be a mapping such as {{'height': z}}, not {describe(value)}")
    columns = tuple(range(1, MAX_CHANNEL_COLUMNS + 1))
    channels = {}
    for key, values in value.items():
        channel = f"{name}[{key!r}]"
        array = as_array(values, f"{channel} must have numbers")
        channels[key] = number_rows(channel, array, *((1,) if array.ndim == 1 else columns))
    return channels


def _write_heights(name: str, value: ArrayLike) -> NDArray[Any]:
    wanted = f"{name} must have at least 2 rows of 2 numbers"
    array = as_array(value, wanted)
    if array.ndim != 2 or min(array.shape) < 2:
        raise ValueError(f"{wanted}, not {describe(array)}")
    return number_rows(name, array, array.shape[1])


def _as_it_is(value: Any, _name: str, _reader: FieldReader) -> Any:
    return value


def _rows(limit: str, columns: int, write: Callable[..., NDArray[Any]] = number_rows) -> FieldKind:
    def read(value: Any, name: str, reader: FieldReader) -> NDArray[np.float32]:
        return reader.rows(value, name, (columns,), limit)

    return FieldKind(read, lambda name, values: write(name, values, columns))


_DISTANCE: Final = Annotated[float, Meta(ge=0, le=MAX_DISTANCE)]
_TRIPLE: Final = tuple[_DISTANCE, _DISTANCE, _DISTANCE]  # type: ignore[valid-type]  # mypy takes it for a variable

Number = Annotated[float, FieldKind(lambda value, name, _: drawable(number(value, name), name), write_number)]
"""A drawable number of any sign."""
Radius = Annotated[float, FieldKind(_read_radius, write_number, _DISTANCE)]
Length = Annotated[float, FieldKind(_read_length, write_number, _DISTANCE)]
Lengths = Annotated[Vector, FieldKind(_read_lengths, _write_lengths, _TRIPLE)]
"""Three lengths."""
Size = Annotated[float, FieldKind(_read_size, write_number)]
"""A length for decoration, without warnings."""
Positive = Annotated[float, FieldKind(_read_positive, write_number)]
Extents = Annotated[Vector, FieldKind(_read_extents, lambda name, value: number_list(name, value, 2))]
"""Two lengths above 0."""
AxisLength = Annotated[
    float, FieldKind(_read_axis_length, write_number, Annotated[float, Meta(ge=MIN_TRIAD_SCALE, le=MAX_DISTANCE)])
]
Scale = Annotated[float | Vector, FieldKind(_read_scale, _write_scale)]
Pixels = Annotated[float, FieldKind(_read_pixels, write_number)]
Flag = Annotated[bool, FieldKind(lambda value, _name, _reader: bool(value), lambda _, value: bool(value), bool)]
Points = Annotated[ArrayLike, _rows("points", 3, checked_rows)]
"""Positions, which ``Geometry.body`` copies from a point amid them. ``Vertices``, too."""
Ranges = Annotated[ArrayLike, _rows("points", 1)]
Vertices = Annotated[ArrayLike, _rows("vertices", 3, checked_rows)]
Heights = Annotated[ArrayLike, FieldKind(lambda value, name, reader: reader.grid(value, name), _write_heights)]
VertexColors = Annotated[ArrayLike, FieldKind(lambda value, name, reader: reader.colors(value, name), color_rows)]
Color = Annotated[ArrayLike, FieldKind(read_color, lambda name, value: rgba(value, name))]
Image = Annotated[
    ImageLike, FieldKind(lambda value, name, r: r.image(value, name), lambda _, value: image_field(value))
]
LabelText = Annotated[str, FieldKind(lambda value, name, reader: reader.text(value, name), _write_text)]
FileName = Annotated[str, FieldKind(_read_name, _write_file_name)]
UNCONVERTED: Final = FieldKind(_as_it_is, lambda _, value: value)
"""Kind of a field that is read with others of its geometry."""
ColorOnUse = Annotated[ArrayLike, FieldKind(_as_it_is, lambda name, value: rgba(value, name))]
"""A colour that is read with other fields of its geometry."""
Faces = Annotated[ArrayLike, FieldKind(_as_it_is, _write_faces)]
"""Vertex indices, which are checked with the vertices."""
TextureCoordinates = Annotated[ArrayLike, FieldKind(_as_it_is, lambda name, value: number_rows(name, value, 2))]
"""Texture coordinates, which are read only for an image."""
Channels = Annotated[Mapping[str, ArrayLike], FieldKind(_as_it_is, _write_channels)]
"""Channels of points, each of which may be left out with a warning."""
