"""The changes of one request, and a record of everything published, to publish it again to a viewer that lost it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

Path = tuple[str | int, ...]
"""Names from the root down; () is the root."""


def path_of(value: str | int | tuple[str | int, ...]) -> Path:
    """Return a path from one element, from a tuple of elements, or from ``a/b`` in one string."""
    if isinstance(value, str):
        return tuple(name for name in value.split("/") if name)
    return tuple(value) if isinstance(value, tuple) else (value,)


def is_below(path: Path, top: Path) -> bool:
    """Return True if ``path`` is ``top`` or under it."""
    return path[: len(top)] == top


@dataclass(slots=True)
class Entry:
    """Geometries and transform of one path, as sent."""

    geometries: list[dict[str, Any]] | None = None
    transform: dict[str, Any] | None = None


class Changes:
    """Changes of one request. A viewer applies deletes first, so a delete discards what was set before."""

    def __init__(self) -> None:
        self.deleted: dict[Path, None] = {}
        self.entries: dict[Path, Entry] = {}

    def set(self, path: Path, geometries: list[dict[str, Any]]) -> None:
        """Replace the geometries at a path."""
        self.entries.setdefault(path, Entry()).geometries = geometries

    def transform(self, path: Path, transform: dict[str, Any]) -> None:
        """Replace the transform at a path."""
        self.entries.setdefault(path, Entry()).transform = transform

    def delete(self, path: Path) -> None:
        """Delete a path and everything below it."""
        self.entries = {other: entry for other, entry in self.entries.items() if not is_below(other, path)}
        self.deleted[path] = None

    def body(self, timestamp: int) -> dict[str, Any]:
        """Return the data of a request."""
        entries = self.entries.items()
        return {
            "timestamp": timestamp,
            "delete": [{"path": path} for path in self.deleted],
            "setgeometry": [
                {"path": path, "geometries": entry.geometries}
                for path, entry in entries
                if entry.geometries is not None
            ],
            "settransform": [
                {"path": path, "transform": entry.transform} for path, entry in entries if entry.transform is not None
            ],
        }


class PublishedTree:
    """Record of everything that is published now."""

    def __init__(self) -> None:
        self._entries: dict[Path, Entry] = {}

    def update(self, changes: Changes) -> None:
        """Record the changes of a request."""
        for path in changes.deleted:
            self._entries = {other: entry for other, entry in self._entries.items() if not is_below(other, path)}
        for path, change in changes.entries.items():
            entry = self._entries.setdefault(path, Entry())
            if change.geometries is not None:
                entry.geometries = change.geometries
            if change.transform is not None:
                entry.transform = change.transform

    def missing(self, paths: list[Path]) -> Changes:
        """Return the changes to publish again to a viewer without geometry at ``paths``.

        They are the entries at and below the paths, and the transforms of their parents; none if no geometry was
        published there.
        """
        changes = Changes()
        for path, entry in self._entries.items():
            if any(is_below(path, top) for top in paths):
                changes.entries[path] = entry
            elif entry.transform is not None and any(is_below(top, path) for top in paths):
                changes.entries[path] = Entry(None, entry.transform)
        if all(entry.geometries is None for entry in changes.entries.values()):
            changes.entries.clear()
        return changes

    def all(self) -> Changes:
        """Return everything, for a viewer that has just started."""
        changes = Changes()
        changes.entries = dict(self._entries)
        return changes
