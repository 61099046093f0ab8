"""The reader's exception, and checked access to the arrays of a document."""

from __future__ import annotations

from typing import TypeVar

T = TypeVar("T")


class GltfError(ValueError):
    """A document that cannot be read. The message names the item, its value and the reason."""


def item(items: list[T | None] | None, index: object, kind: str, where: str) -> T:
    """Return ``items[index]`` for an index from the document.

    Args:
        kind: Name of the array in the document, for the message.
        where: Property that holds the index (``accessors[3].bufferView``), for the message.

    Raises:
        GltfError: The index is not an integer or out of range, or the item is null.
    """
    if type(index) is int and items is not None and 0 <= index < len(items):
        found = items[index]
        if found is not None:
            return found
        raise GltfError(f"{where}: {kind}[{index}] is null")
    raise GltfError(f"{where}: {index} is out of range ({len(items) if items else 0} {kind})")
