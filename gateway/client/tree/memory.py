"""What was published, so that a viewer which lost it can be given it again; and what one request will change of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

Path = tuple[str | int, ...]
"""From the root down; () is the root."""


def path_of(value: str | int | tuple[str | int, ...]) -> Path:
    """A path from one element, from a tuple of them, taken as they are, or from ``a/b`` in one string."""
    if isinstance(value, str):
        return tuple(name for name in value.split("/") if name)
    return tuple(value) if isinstance(value, tuple) else (value,)


def below(path: Path, top: Path) -> bool:
    """Whether ``path`` is ``top`` or under it."""
    return path[: len(top)] == top


@dataclass(slots=True)
class Entry:
    """Of one path, as sent."""

    geometries: list[dict[str, Any]] | None = None
    transform: dict[str, Any] | None = None


class Changes:
    """One request: deletes come first, then geometries, then transforms, so a delete forgets what was set before."""

    def __init__(self) -> None:
        self.deleted: dict[Path, None] = {}
        self.entries: dict[Path, Entry] = {}

    def set(self, path: Path, geometries: list[dict[str, Any]]) -> None:
        self.entries.setdefault(path, Entry()).geometries = geometries

    def transform(self, path: Path, transform: dict[str, Any]) -> None:
        self.entries.setdefault(path, Entry()).transform = transform

    def delete(self, path: Path) -> None:
        self.entries = {other: entry for other, entry in self.entries.items() if not below(other, path)}
        self.deleted[path] = None

    def body(self, timestamp: int) -> dict[str, Any]:
        """As the protocol has it."""
        entries = self.entries.items()
        return {
            "timestamp": timestamp,
            "delete": [{"path": path} for path in self.deleted],
            "setgeometry": [{"path": p, "geometries": e.geometries} for p, e in entries if e.geometries is not None],
            "settransform": [{"path": p, "transform": e.transform} for p, e in entries if e.transform is not None],
        }


class Memory:
    """Everything that is published now."""

    def __init__(self) -> None:
        self._entries: dict[Path, Entry] = {}

    def take(self, changes: Changes) -> None:
        """Remembers what a request changes."""
        for path in changes.deleted:
            self._entries = {other: entry for other, entry in self._entries.items() if not below(other, path)}
        for path, change in changes.entries.items():
            entry = self._entries.setdefault(path, Entry())
            if change.geometries is not None:
                entry.geometries = change.geometries
            if change.transform is not None:
                entry.transform = change.transform

    def again(self, paths: list[Path]) -> Changes:
        """What has to be published again for ``paths`` and all below them; empty where no geometry is known there."""
        changes = Changes()
        for path, entry in self._entries.items():
            if any(below(path, top) for top in paths):
                changes.entries[path] = entry
            elif entry.transform is not None and any(below(top, path) for top in paths):
                changes.entries[path] = Entry(None, entry.transform)  # where they hang
        if all(entry.geometries is None for entry in changes.entries.values()):
            changes.entries.clear()
        return changes

    def all(self) -> Changes:
        """What a viewer that knows nothing has to be told."""
        changes = Changes()
        changes.entries = dict(self._entries)
        return changes
