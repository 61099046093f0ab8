"""Path elements as they can be written: JSON strings cannot hold every Python string, nor 64 bits every integer."""

from __future__ import annotations

from gateway.scene.tree import PathElement

_LARGEST = (1 << 63) - 1


def written(element: PathElement) -> PathElement:
    """The element, with lone surrogates (which UTF-8 has no bytes for) spelled out and huge integers as text."""
    if isinstance(element, int):
        return element if -_LARGEST <= element <= _LARGEST else hex(element)
    if element.isascii():
        return element
    return element.encode("utf-8", "backslashreplace").decode("utf-8")
