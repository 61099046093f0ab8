"""Changes of one request, or of all requests of a client, from which ``viewer`` publishes them again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from operator import index
from typing import Any, Final

from scenegate.messages.arguments import describe

ENTRY_BYTES: Final = 1000
"""Size of an entry besides its arrays and files in ``parts``."""
Path = tuple[str | int, ...]
"""Names from the root down; () is the root."""
Key = str | int | Path
"""Index of a node: one name, a tuple of names, or a string ``a/b``."""


def path_of(value: Key) -> Path:
    """Return the path for an index of a node. Raises ValueError for a list, a float and others."""
    if isinstance(value, str):
        return tuple(name for name in value.split("/") if name)
    if isinstance(value, tuple):
        return value
    try:
        return (index(value),)  # of NumPy's integers, too
    except TypeError:
        raise ValueError(f"a path must be a text, an integer or a tuple of them, not {describe(value)}") from None


def is_at_or_below(path: Path, top: Path) -> bool:
    """Return True if ``path`` is ``top`` or a path below it."""
    return path[: len(top)] == top


@dataclass(slots=True)
class Entry:
    """Geometries, transform, visibility and opacity of one path, as the protocol's objects. None: not set."""

    geometries: list[dict[str, Any]] | None = None
    transform: dict[str, Any] | None = None
    visible: bool | None = None
    opacity: float | None = None

    def update(self, other: Entry) -> None:
        """Replace what is set in another entry."""
        for name in ("geometries", "transform", "visible", "opacity"):
            if (value := getattr(other, name)) is not None:
                setattr(self, name, value)

    @property
    def properties(self) -> dict[str, Any]:
        """Visibility and opacity, as fields of a ``setproperty`` command; empty if neither is set."""
        values = {"visible": self.visible, "opacity": self.opacity}
        return {name: value for name, value in values.items() if value is not None}


@dataclass(slots=True)
class Changes:
    """Changes of one request, or of several.

    A viewer executes the deletions of a request before all else. Changes made before a deletion are therefore dropped.
    """

    deleted: dict[Path, None] = field(default_factory=dict)
    """Paths to delete, in order and without duplicates."""
    entries: dict[Path, Entry] = field(default_factory=dict)
    view: dict[str, Any] = field(default_factory=dict)
    """Fields of a ``setview`` command."""
    click_paths: list[Path] | None = None
    """Paths of a ``setclicks`` command; None: no command."""
    controls: list[Any] | None = None
    """Controls of a ``setcontrols`` command; None: no command."""
    control_values: list[dict[str, Any]] = field(default_factory=list)
    """Commands of ``setvalues``."""

    def set_entry(self, path: Path, entry: Entry) -> Changes:
        """Replace what is set in an entry at a path; return these changes."""
        self.entries.setdefault(path, Entry()).update(entry)
        return self

    def add(self, other: Changes) -> None:
        """Add deletions, entries and view of changes that are made after these; not clicks and controls."""
        for path in other.deleted:
            self.delete(path)
        for path, entry in other.entries.items():
            self.set_entry(path, entry)
        self.view.update(other.view)

    def delete(self, path: Path) -> Changes:
        """Delete a path and everything below it; return these changes."""
        self.entries = {other: entry for other, entry in self.entries.items() if not is_at_or_below(other, path)}
        self.deleted[path] = None
        return self

    def missing(self, paths: list[Path]) -> Changes:
        """Return those of these changes that restore ``paths`` in a viewer that has no geometry there.

        They are the entries at and below the paths, and all but the geometries above them. There are none if there is
        no geometry at or below the paths. The result shares entries: it must be encoded before the next change.
        """
        changes = Changes()
        for path, entry in self.entries.items():
            if any(is_at_or_below(path, top) for top in paths):
                changes.entries[path] = entry
            elif any(is_at_or_below(top, path) for top in paths):
                changes.entries[path] = replace(entry, geometries=None)
        # Geometries first: in the part before its geometry, a transform would have a missing path.
        entries = sorted(changes.entries.items(), key=lambda item: item[1].geometries is None)
        changes.entries = dict(entries) if entries and entries[0][1].geometries is not None else {}
        return changes

    def parts(self, max_bytes: int) -> Iterator[Changes]:
        """Yield the entries in groups of at most ``max_bytes``, or of a single one. They are shared."""
        part, size = Changes(), 0
        for path, entry in self.entries.items():
            entry_size = ENTRY_BYTES + sum(map(geometry_bytes, entry.geometries or ()))
            if part.entries and size + entry_size > max_bytes:
                yield part
                part, size = Changes(), 0
            part.entries[path] = entry
            size += entry_size
        if part.entries:
            yield part

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
            **self.newer_commands(),
        }

    def newer_commands(self) -> dict[str, Any]:
        """Return the commands that older viewers ignore, by name."""
        commands: dict[str, Any] = {}
        properties = [{"path": path, **entry.properties} for path, entry in self.entries.items() if entry.properties]
        if properties:
            commands["setproperty"] = properties
        if self.view:
            commands["setview"] = self.view
        if self.click_paths is not None:
            commands["setclicks"] = [{"path": path} for path in self.click_paths]
        if self.controls is not None:
            commands["setcontrols"] = self.controls
        if self.control_values:
            commands["setvalues"] = self.control_values
        return commands


def geometry_bytes(value: Any) -> int:
    """Return the number of bytes of arrays and files in a geometry."""
    if isinstance(value, dict):
        return sum(map(geometry_bytes, value.values()))
    return len(value) if isinstance(value, bytes) else getattr(value, "nbytes", 0)
