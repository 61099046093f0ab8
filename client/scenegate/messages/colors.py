"""Convert colours and images from the forms that users pass (names, hexadecimal, uint8, floats, files) to the
protocol's fields.
"""

import os
from collections.abc import Mapping
from string import hexdigits
from typing import Any, Final, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scenegate.messages.arguments import as_array, describe
from scenegate.messages.request_encoding import empty_with_header
from scenegate.regular_files import read_regular

_TABLE: Final = """
aliceblue=f0f8ff antiquewhite=faebd7 aqua=00ffff aquamarine=7fffd4 azure=f0ffff beige=f5f5dc bisque=ffe4c4
black=000000 blanchedalmond=ffebcd blue=0000ff blueviolet=8a2be2 brown=a52a2a burlywood=deb887 cadetblue=5f9ea0
chartreuse=7fff00 chocolate=d2691e coral=ff7f50 cornflowerblue=6495ed cornsilk=fff8dc crimson=dc143c cyan=00ffff
darkblue=00008b darkcyan=008b8b darkgoldenrod=b8860b darkgray=a9a9a9 darkgreen=006400 darkgrey=a9a9a9
darkkhaki=bdb76b darkmagenta=8b008b darkolivegreen=556b2f darkorange=ff8c00 darkorchid=9932cc darkred=8b0000
darksalmon=e9967a darkseagreen=8fbc8f darkslateblue=483d8b darkslategray=2f4f4f darkslategrey=2f4f4f
darkturquoise=00ced1 darkviolet=9400d3 deeppink=ff1493 deepskyblue=00bfff dimgray=696969 dimgrey=696969
dodgerblue=1e90ff firebrick=b22222 floralwhite=fffaf0 forestgreen=228b22 fuchsia=ff00ff gainsboro=dcdcdc
ghostwhite=f8f8ff gold=ffd700 goldenrod=daa520 gray=808080 green=008000 greenyellow=adff2f grey=808080
honeydew=f0fff0 hotpink=ff69b4 indianred=cd5c5c indigo=4b0082 ivory=fffff0 khaki=f0e68c lavender=e6e6fa
lavenderblush=fff0f5 lawngreen=7cfc00 lemonchiffon=fffacd lightblue=add8e6 lightcoral=f08080 lightcyan=e0ffff
lightgoldenrodyellow=fafad2 lightgray=d3d3d3 lightgreen=90ee90 lightgrey=d3d3d3 lightpink=ffb6c1 lightsalmon=ffa07a
lightseagreen=20b2aa lightskyblue=87cefa lightslategray=778899 lightslategrey=778899 lightsteelblue=b0c4de
lightyellow=ffffe0 lime=00ff00 limegreen=32cd32 linen=faf0e6 magenta=ff00ff maroon=800000 mediumaquamarine=66cdaa
mediumblue=0000cd mediumorchid=ba55d3 mediumpurple=9370db mediumseagreen=3cb371 mediumslateblue=7b68ee
mediumspringgreen=00fa9a mediumturquoise=48d1cc mediumvioletred=c71585 midnightblue=191970 mintcream=f5fffa
mistyrose=ffe4e1 moccasin=ffe4b5 navajowhite=ffdead navy=000080 oldlace=fdf5e6 olive=808000 olivedrab=6b8e23
orange=ffa500 orangered=ff4500 orchid=da70d6 palegoldenrod=eee8aa palegreen=98fb98 paleturquoise=afeeee
palevioletred=db7093 papayawhip=ffefd5 peachpuff=ffdab9 peru=cd853f pink=ffc0cb plum=dda0dd powderblue=b0e0e6
purple=800080 rebeccapurple=663399 red=ff0000 rosybrown=bc8f8f royalblue=4169e1 saddlebrown=8b4513 salmon=fa8072
sandybrown=f4a460 seagreen=2e8b57 seashell=fff5ee sienna=a0522d silver=c0c0c0 skyblue=87ceeb slateblue=6a5acd
slategray=708090 slategrey=708090 snow=fffafa springgreen=00ff7f steelblue=4682b4 tan=d2b48c teal=008080
thistle=d8bfd8 tomato=ff6347 turquoise=40e0d0 violet=ee82ee wheat=f5deb3 white=ffffff whitesmoke=f5f5f5
yellow=ffff00 yellowgreen=9acd32
"""
CSS_COLORS: Final = dict(entry.split("=") for entry in _TABLE.split())
"""Six hexadecimal digits by name in lower case."""


WHITE: Final = (1.0, 1.0, 1.0, 1.0)
RANGE_TOLERANCE: Final = 1e-5
"""Accepted excess of a float beyond 0 or 1, for rounding errors. The viewer clamps such values."""


class HasPixels(Protocol):
    """A Pillow image, or another object that NumPy reads as an array."""

    @property
    def __array_interface__(self) -> Mapping[str, Any]:
        """See NumPy's array interface."""


ImageLike: TypeAlias = ArrayLike | HasPixels | bytes | str | os.PathLike[str]
"""Image that ``image_field`` reads."""


def rgba(value: ArrayLike, name: str = "color") -> list[float]:
    """Return red, green, blue and, if given, alpha, from 0 to 1. Raises ValueError, with ``name``, for other values.

    ``value``: three or four numbers from 0 to 1; three or four integers from 0 to 255, at least one of them above 1; a
    uint8 array; one integer 0xrrggbb; a CSS name; or ``#rgb``, ``#rgba``, ``#rrggbb``, ``#rrggbbaa``.
    """
    wanted = f"{name} must be 3 or 4 numbers, 0xrrggbb, a CSS name or '#ff8000'"
    array = np.array(_parse_color(value, name), np.uint8) if isinstance(value, str) else as_array(value, wanted)
    if array.dtype.kind in "iu" and array.dtype != np.uint8:
        array = _from_integers(array)
    numbers = array / 255.0 if array.dtype == np.uint8 else as_array(value, wanted, np.float64)
    if numbers.shape not in ((3,), (4,)):
        raise ValueError(f"{wanted}, not {describe(np.asarray(value))}")
    if np.isnan(numbers).any():
        raise ValueError(f"{name} must have numbers, not nan")
    check_range(name, numbers)
    channels: list[float] = numbers.tolist()
    return channels


def color_rows(name: str, values: ArrayLike) -> NDArray[np.uint8]:
    """Return a copy of colours, (N, 3) or (N, 4) uint8; a grid of colours is flattened row by row.

    Raises ValueError, with ``name``, for a wrong shape, or a value outside of its range.
    """
    wanted = f"{name} must have rows of 3 or 4 numbers"
    array = as_uint8_or_floats(values, wanted)
    if array.ndim < 2 or array.shape[-1] not in (3, 4):
        raise ValueError(f"{wanted}, not {describe(array)}")
    return _bytes(name, array.reshape(-1, array.shape[-1]))


def check_color_count(colors: NDArray[Any], count: int) -> None:
    """Raise ValueError if there is not one colour for each of ``count`` vertices."""
    if len(colors) != count:
        raise ValueError(f"colors must have 3 or 4 numbers for each of {count} vertices, not shape {colors.shape}")


def image_field(value: ImageLike) -> NDArray[np.uint8] | bytes:
    """Return an image as the protocol's field: an encoded file, or a copy of its pixels as uint8.

    ``value``: an encoded PNG or JPEG file, the path of one, or pixels: (H, W), (H, W, 3) or (H, W, 4), uint8 or floats
    from 0 to 1, top row first. A Pillow image counts as its pixels. Raises ValueError, or OSError for a file.
    """
    if isinstance(value, bytes):
        return value
    if isinstance(value, (str, os.PathLike)):
        return read_regular(value)
    mode = getattr(value, "mode", None)
    if isinstance(mode, str) and mode not in ("L", "RGB", "RGBA"):  # Pillow: palettes, 1 bit, CMYK
        raise ValueError(f"an image of mode {mode} is not supported; use image.convert('RGB') or 'RGBA'")
    wanted = "image must have shape (H, W), (H, W, 3) or (H, W, 4)"
    array = as_array(value, wanted)
    if array.ndim not in (2, 3) or array.shape[2:] not in ((), (3,), (4,)) or not array.size:
        raise ValueError(f"{wanted}, not {array.shape if array.ndim else describe(value)}")
    if array.dtype.kind not in "fu" or (array.dtype.kind == "u" and array.dtype != np.uint8):
        raise ValueError(f"image must be uint8, or floats from 0 to 1, not {array.dtype}")
    return _bytes("image", array)


def _bytes(name: str, values: NDArray[Any]) -> NDArray[np.uint8]:
    """Return a copy of colours as uint8, ready to be sent. NaN is 0. Raises ValueError as ``check_range``."""
    check_range(name, values)
    copy = empty_with_header(values.shape, np.uint8)
    if values.dtype != np.uint8:
        values = values * 255.0
        values += 0.5
        if np.isnan(values.sum()):
            values = np.nan_to_num(values)
        np.clip(values, 0.0, 255.0, out=values)
    copy[...] = values
    return copy


def check_range(name: str, values: NDArray[Any]) -> None:
    """Raise ValueError, with ``name``, unless colours are uint8 or floats from 0 to 1. NaN is allowed, shown as 0."""
    if values.dtype == np.uint8 or not values.size:
        return
    low, high = values.min(), values.max()
    if np.isnan(high):  # fmin and fmax ignore NaN, but are ten times slower than min and max
        low, high = np.fmin.reduce(values, axis=None), np.fmax.reduce(values, axis=None)
    if low < -RANGE_TOLERANCE or high > 1.0 + RANGE_TOLERANCE:
        invalid = high if high > 1.0 + RANGE_TOLERANCE else low
        raise ValueError(f"{name} must be from 0 to 1, or a uint8 array from 0 to 255, not {invalid:g}")


def as_uint8_or_floats(values: ArrayLike, wanted: str) -> NDArray[Any]:
    """Return colours as an array. Integers from 0 to 255, one of them above 1, become uint8. Raises as ``as_array``."""
    array = as_array(values, wanted)
    is_integer = array.ndim > 0 and array.dtype.kind in "iu" and array.dtype != np.uint8
    return _from_integers(array) if is_integer else array


def _from_integers(array: NDArray[Any]) -> NDArray[Any]:
    """Return an integer 0xrrggbb, or channels from 0 to 255, as uint8. Other integers are returned unchanged.

    Channels that are all 0 or 1 are unchanged, too: they count as numbers from 0 to 1.
    """
    if array.ndim == 0 and 0 <= array <= 0xFFFFFF:
        number = int(array)
        return np.array([number >> 16, number >> 8 & 255, number & 255], np.uint8)
    if array.size and array.min() >= 0 and 1 < array.max() <= 255:
        return array.astype(np.uint8)
    return array


def _parse_color(text: str, name: str) -> tuple[int, ...]:
    """Return the channels, 0 to 255, of a CSS name or of hexadecimal digits after ``#``."""
    digits = text[1:] if text.startswith("#") else CSS_COLORS.get(text.lower(), "")
    if len(digits) in (3, 4):
        digits = "".join(2 * digit for digit in digits)
    if len(digits) in (6, 8) and set(digits) <= set(hexdigits):
        return tuple(bytes.fromhex(digits))
    raise ValueError(f"{name} {text[:40]!r} is neither a CSS name nor #rgb, #rgba, #rrggbb or #rrggbbaa")
