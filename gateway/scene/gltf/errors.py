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
    count = len(items) if items else 0
    if not isinstance(index, int) or isinstance(index, bool) or not 0 <= index < count:
        raise GltfError(f"{where}: {index} is out of range ({count} {kind})")
    assert items is not None
    item = items[index]
    if item is None:
        raise GltfError(f"{where}: {kind}[{index}] is null")
    return item
