"""What the reader raises, and how it names elements of a document."""

from __future__ import annotations

from typing import TypeVar

T = TypeVar("T")


class GltfError(ValueError):
    """The document cannot be read; the message names the element, its value and the reason."""


def element(items: list[T | None] | None, index: object, kind: str, where: str) -> T:
    """``items[index]``, where ``index`` comes from the document.

    Args:
        kind: name of the array in the document, for the message.
        where: who refers to it (``accessors[3].bufferView``).
    """
    if type(index) is int and items is not None and 0 <= index < len(items):
        item = items[index]
        if item is not None:
            return item
        raise GltfError(f"{where}: {kind}[{index}] is null")
    raise GltfError(f"{where}: {index} is out of range ({len(items) if items else 0} {kind})")
