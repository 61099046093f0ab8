"""Reads the headers of PLY files: elements and their properties."""

import re
from typing import Any, Final, Literal, NamedTuple

import numpy as np

_TYPES: Final = {
    "char": "int8",
    "uchar": "uint8",
    "short": "int16",
    "ushort": "uint16",
    "int": "int32",
    "uint": "uint32",
    "float": "float32",
    "double": "float64",
}
"""NumPy's names of the types that PLY names as C does."""
_TYPE_NAMES: Final = frozenset({*_TYPES.values(), "int64", "uint64", "float16"})
_END: Final = re.compile(rb"end_header\r?\n")
_END_WITHOUT_LINE_FEED: Final = re.compile(rb"end_header\r")
_INDEX_NAMES: Final = ("vertex_indices", "vertex_index")


class Property(NamedTuple):
    """A property of an element in a header."""

    name: str
    dtype: np.dtype[Any]
    counter: np.dtype[Any] | None
    """Type of a list's length; None: it is no list."""


class Element(NamedTuple):
    """An element of a header."""

    name: str
    row_count: int
    properties: list[Property]

    @property
    def index_list(self) -> str:
        """Name of the list of vertex indices: any name if it is the only list. Raises ValueError without one."""
        lists = [each for each in self.properties if each.counter is not None]
        for each in lists:
            if each.dtype.kind in "iu" and (each.name in _INDEX_NAMES or len(lists) == 1):
                return each.name
        raise ValueError(f"its element {self.name!r} has no list 'vertex_indices' of integers")


def split_header(data: bytes) -> tuple[str, bytes]:
    """Return the header, with elements and properties in lower case, and the data. Raises ValueError without them.

    Rhinoceros ends its lines with carriage returns, other programs only the last one with both; comments are not always
    UTF-8.
    """
    if b"ply" not in data[:20].lower():
        raise ValueError("it does not start with 'ply'")
    end = (_END if b"\n" in data[:20] else _END_WITHOUT_LINE_FEED).search(data)
    if end is None:
        raise ValueError("its header does not end")
    lines = (line.decode("utf-8", "replace") for line in data[: end.start()].splitlines())
    return "\n".join(
        " ".join(line.split()).lower() if line.lstrip().startswith(("element", "property", "format")) else line
        for line in lines
    ), data[end.end() :]


def read_header(header: str) -> tuple[list[Element], bool]:
    """Return the elements, and True for text. Raises ValueError."""
    elements: list[Element] = []
    encoding = next((line for line in header.split("\n") if line.startswith("format")), "")
    order: Literal["<", ">"] = ">" if "big" in encoding else "<"
    for number, line in enumerate(header.split("\n")):
        try:
            match line.split():
                case ["element", name, count] if 0 <= int(count) < 1 << 63:
                    elements.append(Element(name, int(count), []))
                case ["property", "list", length, values, name]:
                    counter = _type(length, order)
                    if counter.kind == "f" or counter.itemsize > 4:
                        raise ValueError(length)
                    elements[-1].properties.append(Property(name, _type(values, order), counter))
                case ["property", values, name]:
                    elements[-1].properties.append(Property(name, _type(values, order), None))
                case ["element" | "property", *_]:
                    raise ValueError(line)
        except (ValueError, IndexError):
            raise ValueError(f"line {number + 1} of its header is wrong: {line[:60]!r}") from None
    return elements, "ascii" in encoding


def _type(name: str, order: Literal["<", ">"]) -> np.dtype[Any]:
    """Return a type by its name in a header; raises ValueError for another name."""
    numpy_name = _TYPES.get(name, name)
    if numpy_name not in _TYPE_NAMES:
        raise ValueError(name)
    return np.dtype(numpy_name).newbyteorder(order)
