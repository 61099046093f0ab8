"""Path elements as JSON values."""

from __future__ import annotations

from gateway.scene.tree import PathElement

_MAX_INT = (1 << 63) - 1


def json_element(element: PathElement) -> PathElement:
    """Return a path element with lone surrogates escaped (UTF-8 has no bytes for them) and huge integers as text."""
    if isinstance(element, int):
        return element if -_MAX_INT <= element <= _MAX_INT else hex(element)
    if element.isascii():
        return element
    return element.encode("utf-8", "backslashreplace").decode("utf-8")
