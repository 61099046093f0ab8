"""Changes of one request, and the record of everything published, from which ``viewer`` publishes it again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

Path = tuple[str | int, ...]
"""Names from the root down; () is the root."""


def path_of(value: str | int | tuple[str | int, ...]) -> Path:
    """Return the path for an index of a node: one element, a tuple of elements, or a string ``a/b``."""
    if isinstance(value, str):
        return tuple(name for name in value.split("/") if name)
    return tuple(value) if isinstance(value, tuple) else (value,)


def is_at_or_below(path: Path, top: Path) -> bool:
    """Return True if ``path`` is ``top`` or a path below it."""
    return path[: len(top)] == top


@dataclass(slots=True)
class Entry:
    """Geometries and transform of one path, as the protocol's objects."""

    geometries: list[dict[str, Any]] | None = None
    """None: not set."""
    transform: dict[str, Any] | None = None
    """None: not set."""


class Changes:
    """Changes of one request.

    A viewer executes the deletions of a request before all else. Changes made before a deletion are therefore dropped.
    """

    def __init__(self) -> None:
        self.deleted: dict[Path, None] = {}
        """Paths to delete, in order and without duplicates."""
        self.entries: dict[Path, Entry] = {}

    def set(self, path: Path, geometries: list[dict[str, Any]]) -> None:
        """Replace the geometries at a path."""
        self.entries.setdefault(path, Entry()).geometries = geometries

    def transform(self, path: Path, transform: dict[str, Any]) -> None:
        """Replace the transform at a path."""
        self.entries.setdefault(path, Entry()).transform = transform

    def delete(self, path: Path) -> None:
        """Delete a path and everything below it."""
        self.entries = {other: entry for other, entry in self.entries.items() if not is_at_or_below(other, path)}
        self.deleted[path] = None

    def body(self) -> dict[str, Any]:
        """Return the request as the protocol's JSON object, without its timestamp."""
        entries = self.entries.items()
        return {
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
    """Geometries and transforms that a viewer has if it executed all requests."""

    def __init__(self) -> None:
        self._entries: dict[Path, Entry] = {}

    def update(self, changes: Changes) -> None:
        """Record the changes of a request."""
        for path in changes.deleted:
            self._entries = {other: entry for other, entry in self._entries.items() if not is_at_or_below(other, path)}
        for path, change in changes.entries.items():
            entry = self._entries.setdefault(path, Entry())
            if change.geometries is not None:
                entry.geometries = change.geometries
            if change.transform is not None:
                entry.transform = change.transform

    def missing(self, paths: list[Path]) -> Changes:
        """Return changes that restore ``paths`` in a viewer that has no geometry there.

        These are the entries at and below the paths, and the transforms above them. There are no changes if no
        geometry was published at or below the paths.
        """
        changes = Changes()
        for path, entry in self._entries.items():
            if any(is_at_or_below(path, top) for top in paths):
                changes.entries[path] = entry
            elif entry.transform is not None and any(is_at_or_below(top, path) for top in paths):
                changes.entries[path] = Entry(None, entry.transform)
        if all(entry.geometries is None for entry in changes.entries.values()):
            changes.entries.clear()
        return changes

    def all(self) -> Changes:
        """Return changes that restore everything in a viewer that has just started."""
        changes = Changes()
        changes.entries = dict(self._entries)
        return changes
