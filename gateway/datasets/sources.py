"""The scene files of a command: those that it names, and those below the folders that it names."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Final

from gateway.assets.mesh_formats import FORMATS


class Kind(Enum):
    GLTF = "glTF"
    MESH = "mesh file"
    TREE = "request of a tree viewer client"
    """A request of Director's remote tree viewer protocol, as JSON."""
    REQUEST = "recorded render request"


_MESH_FORMATS: Final = FORMATS - {"gltf", "glb"}
TREE_SUFFIX: Final = ".tree.json"
"""Suffix of tree viewer requests in folders. A file that the command names may also end in .json."""
REQUEST_SUFFIX: Final = ".multipart"
"""Suffix of recorded render requests (``--keep-failures``): the unchanged body of a POST."""
MAX_NAME: Final = 200
"""Maximum length of a scene's name, which becomes a file name; file systems allow 255 bytes."""


class SourceError(ValueError):
    """The command's scenes cannot be used; the message is one sentence."""


@dataclass(frozen=True, slots=True)
class Source:
    """A scene file."""

    name: str
    """Unique name in the dataset: the path below the named folder, or the file's name."""
    path: str
    """Absolute path."""
    kind: Kind
    problem: str = ""
    """Reason why the name cannot be used in a dataset; empty if it can."""

    @property
    def printable_name(self) -> str:
        """The name without control characters."""
        return self.name if self.name.isprintable() else repr(self.name)[1:-1]


def find_sources(inputs: Iterable[Path]) -> tuple[Source, ...]:
    """Return the scenes of the inputs, ordered by name.

    Raises:
        SourceError: an input holds no scene, or two scenes would have the same name.
    """
    by_name: dict[str, Source] = {}
    for path in inputs:
        sources = list(_sources_below(path)) if path.is_dir() else [_named_source(path)]
        if not sources:
            raise SourceError(f"{path} holds no scene: no .gltf, .glb, {', '.join(_suffixes())}")
        for source in sources:
            first = by_name.setdefault(source.name, source)
            if first.path != source.path:
                raise SourceError(
                    f"{first.path} and {source.path} would both be called {source.name}; pass the folder above them"
                )
    return tuple(by_name[name] for name in sorted(by_name))


def _suffixes() -> list[str]:
    return [*sorted(f".{name}" for name in _MESH_FORMATS), TREE_SUFFIX, REQUEST_SUFFIX]


def _sources_below(folder: Path) -> Iterable[Source]:
    for path in sorted(folder.rglob("*")):
        kind = kind_of(path)
        if kind is None or not path.is_file():
            continue
        if any(part.startswith(".") for part in path.relative_to(folder).parts):
            continue
        yield _source(path.relative_to(folder).as_posix(), path, kind)


def _named_source(path: Path) -> Source:
    kind = kind_of(path) or (Kind.TREE if path.suffix.lower() == ".json" else None)
    if kind is None:
        raise SourceError(f"{path} is no scene: not .gltf, .glb, .json, {', '.join(_suffixes())}")
    return _source(path.name, path, kind)


def _source(name: str, path: Path, kind: Kind) -> Source:
    problem = ""
    if len(name) > MAX_NAME:
        problem = f"a name of {len(name)} characters; {MAX_NAME} are the most: rename the file"
    elif bad := next((character for character in name if character == "\\" or not character.isprintable()), None):
        problem = f"a name with the character {bad!r}, which not every system can write: rename the file"
    return Source(name, str(path.resolve()), kind, problem)


def kind_of(path: Path) -> Kind | None:
    """Return the kind of a file by its name, or None if it is no scene."""
    name = path.name.lower()
    if name.endswith((".gltf", ".glb")):
        return Kind.GLTF
    if name.endswith(TREE_SUFFIX):
        return Kind.TREE
    if name.endswith(REQUEST_SUFFIX):
        return Kind.REQUEST
    return Kind.MESH if name.rpartition(".")[2] in _MESH_FORMATS and "." in name else None
