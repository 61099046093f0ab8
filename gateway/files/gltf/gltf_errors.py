"""Exceptions of the reader, their conversion to warnings, and checked access to the arrays of a document."""

from typing import Final, TypeVar

from renderers.drawlist import ImageError

T = TypeVar("T")

MAX_WARNINGS: Final = 10_000
"""Maximum number of warnings that are kept: a document may have millions of flaws."""


class GltfError(ValueError):
    """A document that cannot be read. The message names the property, its value and the reason."""


class GltfLimitError(GltfError):
    """A document beyond one of ``GltfLimits``."""


class as_warning:  # noqa: N801  # used like the functions of contextlib, which take twice as long
    """Context in which a ``GltfError`` or an ``ImageError`` becomes a warning. A ``GltfLimitError`` stays an error."""

    __slots__ = ("_consequence", "_warnings")

    def __init__(self, warnings: list[str], consequence: str) -> None:
        """``consequence``: what is done instead, for the end of the warning that is appended."""
        self._warnings, self._consequence = warnings, consequence

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> bool:
        if not isinstance(error, GltfError | ImageError) or isinstance(error, GltfLimitError):
            return False
        if len(self._warnings) < MAX_WARNINGS:
            self._warnings.append(f"{error}; {self._consequence}")
        return True


def checked_item(items: list[T | None] | None, index: object, array_name: str, path: str) -> T:
    """Return ``items[index]``, where ``index`` comes from the document.

    Raises GltfError with ``array_name`` and ``path``, the property that holds the index, if it is not an integer or out
    of range, or the item is null or invalid.
    """
    if type(index) is int and items is not None and 0 <= index < len(items):
        item = items[index]
        if isinstance(item, GltfError):  # from the parser, in place of an invalid object
            raise GltfError(str(item))
        if item is not None:
            return item
        raise GltfError(f"{path}: {array_name}[{index}] is null")
    raise GltfError(f"{path}: {index} is out of range ({len(items) if items else 0} {array_name})")
