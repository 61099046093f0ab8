"""Converts path elements to JSON values."""

from typing import Final

from gateway.scene.tree.nodes import PathElement

_MAX_INT: Final = (1 << 63) - 1
"""Maximum absolute value of an integer that is written as a number."""


def json_element(element: PathElement) -> PathElement:
    """Return a path element that JSON can express: unpaired surrogates escaped, huge integers as hexadecimal text."""
    if isinstance(element, int):
        return element if -_MAX_INT <= element <= _MAX_INT else hex(element)
    if element.isascii():
        return element
    return element.encode("utf-8", "backslashreplace").decode("utf-8")
