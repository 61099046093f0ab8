"""The reader's exception, and checked access to the arrays of a document."""

from __future__ import annotations

from typing import TypeVar

T = TypeVar("T")


class GltfError(ValueError):
    """A document that cannot be read. The message names the property, its value and the reason."""


class GltfLimitError(GltfError):
    """A document beyond one of ``GltfLimits``."""


def checked_item(items: list[T | None] | None, index: object, array_name: str, path: str) -> T:
    """Return ``items[index]``, where ``index`` comes from the document.

    Args:
        array_name: Name of the array in the document, for the message.
        path: Property that holds the index, such as ``accessors[3].bufferView``, for the message.

    Raises:
        GltfError: The index is not an integer or out of range, or the item is null.
    """
    if type(index) is int and items is not None and 0 <= index < len(items):
        item = items[index]
        if item is not None:
            return item
        raise GltfError(f"{path}: {array_name}[{index}] is null")
    raise GltfError(f"{path}: {index} is out of range ({len(items) if items else 0} {array_name})")
