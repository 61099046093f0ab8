"""Classes of objects: the patterns of a ``--classes`` file, or a class for each model.

The file is TOML or JSON. The first entry that matches an object gives its class::

    [[class]]
    name = "mug"
    model = ["mug*", "cup"]          # one of them is the name of the model

    [[class]]
    name = "robot"
    path = "cell/panda"              # path of the node in the scene, joined by "/"
    file = "cells/*.glb"             # and the name of the scene
    whole = true                     # the first node on a path that matches is one object, with all below it
    id = 7                           # default: 1, 2 ... in the order of the names

In a pattern, ``*`` stands for any characters, ``?`` for one, ``[abc]`` for one of these.
"""

import hashlib
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import Annotated, Final

import msgspec

from gateway.datasets.errors import DatasetError
from gateway.scene.tree.nodes import Path as TreePath
from scenegate.regular_files import errors_as, read_regular

MAX_CLASSES: Final = 65_535
"""Maximum number of classes, and the largest number of one: ``class`` images have 16 bits."""
_MAX_FILE_BYTES: Final = 1 << 20
"""Maximum size of the file, which has a line for each pattern."""

_Pattern = Annotated[str, msgspec.Meta(min_length=1, max_length=1000)]


class _Entry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A class in the file. All of ``model``, ``path`` and ``file`` that are given must match."""

    name: Annotated[str, msgspec.Meta(min_length=1, max_length=200)]
    id: Annotated[int, msgspec.Meta(ge=1, le=MAX_CLASSES)] | None = None
    model: _Pattern | tuple[_Pattern, ...] = ()
    path: _Pattern | tuple[_Pattern, ...] = ()
    file: _Pattern | tuple[_Pattern, ...] = ()
    whole: bool = False

    def matches(self, scene: str, path: TreePath, model: str) -> bool:
        pairs = ((self.model, model), (self.path, "/".join(map(str, path))), (self.file, scene))
        return all(
            any(fnmatchcase(text, each) for each in ((patterns,) if isinstance(patterns, str) else patterns))
            for patterns, text in pairs
            if patterns
        )


class _FileContent(msgspec.Struct, forbid_unknown_fields=True):
    entries: Annotated[tuple[_Entry, ...], msgspec.Meta(min_length=1, max_length=MAX_CLASSES)] = msgspec.field(
        name="class"
    )


@dataclass(frozen=True)
class ClassTable:
    """Names of classes, and the entries that give objects a class. Equal over all scenes of a dataset."""

    ids: tuple[tuple[str, int], ...] = ()
    """Name and number of each class."""
    entries: tuple[_Entry, ...] = ()
    """Entries of the file; none: the class of an object is that with the name of its model."""

    @property
    def names(self) -> dict[str, str]:
        """Value of ``DatasetRecord.classes``."""
        return {str(number): name for name, number in sorted(self.ids, key=lambda each: each[1])}

    def is_whole(self, scene: str, path: TreePath) -> bool:
        """Return True if a node of a scene is one object with everything below it."""
        return any(entry.whole and entry.matches(scene, path, "") for entry in self.entries)

    def class_of(self, scene: str, path: TreePath, model: str) -> int:
        """Return the number of the class of an object, given the path of its node and its model; 0: none."""
        if not self.entries:
            return self._ids.get(model, 0)
        return next((self._ids[entry.name] for entry in self.entries if entry.matches(scene, path, model)), 0)

    @cached_property
    def _ids(self) -> dict[str, int]:
        return dict(self.ids)


NO_CLASSES: Final = ClassTable()


def classes_of_models(models: Iterable[str]) -> ClassTable:
    """Return a class for each model, numbered by name. Raises DatasetError if there are more than ``MAX_CLASSES``."""
    names = sorted(set(models))
    if len(names) > MAX_CLASSES:
        raise DatasetError(f"{len(names)} models are more than {MAX_CLASSES} classes; --classes can join some")
    return ClassTable(tuple((name, number) for number, name in enumerate(names, 1)))


def read_classes(path: Path) -> tuple[ClassTable, str]:
    """Return the classes of a file, and its SHA-256. Raises DatasetError, with the entry, if it cannot be used."""
    with errors_as(DatasetError, path, ValueError, RecursionError):  # ValueErrors: those of msgspec, TOML and UTF-8
        data = read_regular(path, _MAX_FILE_BYTES)
        values = msgspec.json.decode(data) if path.suffix.lower() == ".json" else tomllib.loads(data.decode())
        content = msgspec.convert(values, _FileContent)
        return ClassTable(_numbered(content.entries), content.entries), hashlib.sha256(data).hexdigest()


def _numbered(entries: tuple[_Entry, ...]) -> tuple[tuple[str, int], ...]:
    """Return names and numbers of the classes. Entries of one name are one class."""
    given: dict[str, int] = {}
    for index, entry in enumerate(entries):
        if not entry.name.isprintable():
            raise DatasetError(f"class[{index}].name = {entry.name!r}: must be of printable characters")
        if not (entry.model or entry.path or entry.file):
            raise DatasetError(f"class[{index}] ({entry.name}) has none of model, path and file")
        if entry.whole and (entry.model or not entry.path):
            raise DatasetError(f"class[{index}] ({entry.name}).whole needs a path, and no model")
        if entry.id is not None and given.setdefault(entry.name, entry.id) != entry.id:
            raise DatasetError(
                f"class[{index}] ({entry.name}).id = {entry.id}: the class has the id {given[entry.name]}"
            )
    if len(set(given.values())) < len(given):  # of different names
        raise DatasetError("two classes have the same id")
    names = dict.fromkeys(entry.name for entry in entries)
    taken = set(given.values())
    free = (number for number in range(1, MAX_CLASSES + 1) if number not in taken)
    return tuple((name, given[name] if name in given else next(free)) for name in names)
