"""Which scenes a command means: files, and what is found below folders."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Final

from gateway.scene.meshformats import FORMATS


class Kind(Enum):
    GLTF = "glTF"
    MESH = "mesh file"
    TREE = "request of a tree viewer client"
    REQUEST = "recorded render request"


_MESHES: Final = FORMATS - {"gltf", "glb"}
TREE_SUFFIX: Final = ".tree.json"
"""In folders; a file that is named may end with any .json."""
REQUEST_SUFFIX: Final = ".multipart"
"""What ``--keep-failures`` writes: the body of a POST as it came."""
MAX_NAME: Final = 200
"""Characters of a scene's name: it becomes a path below the dataset, and systems have limits."""


class SourceError(ValueError):
    """The command's scenes cannot be used; a sentence."""


@dataclass(frozen=True, slots=True)
class Source:
    """A scene that is still a file."""

    name: str
    """Unique in the dataset: the path below the folder that was named, or the file's name."""
    path: str
    """Absolute."""
    kind: Kind


def find_sources(inputs: Iterable[Path]) -> tuple[Source, ...]:
    """The scenes of the inputs, ordered by name.

    Raises:
        SourceError: an input holds no scene, or two scenes would have the same name.
    """
    found: dict[str, Source] = {}
    for given in inputs:
        sources = list(_below(given)) if given.is_dir() else [_named(given)]
        if not sources:
            raise SourceError(f"{given} holds no scene: no .gltf, .glb, {', '.join(_suffixes())}")
        for source in sources:
            known = found.setdefault(source.name, source)
            if known.path != source.path:
                raise SourceError(
                    f"{known.path} and {source.path} would both be called {source.name}; name the folder above both"
                )
    return tuple(found[name] for name in sorted(found))


def _suffixes() -> list[str]:
    return [*sorted(f".{name}" for name in _MESHES), TREE_SUFFIX, REQUEST_SUFFIX]


def _below(folder: Path) -> Iterable[Source]:
    for path in sorted(folder.rglob("*")):
        kind = kind_of(path)
        if kind is None or not path.is_file():
            continue
        if any(part.startswith(".") for part in path.relative_to(folder).parts):
            continue
        yield _source(path.relative_to(folder).as_posix(), path, kind)


def _named(path: Path) -> Source:
    kind = kind_of(path) or (Kind.TREE if path.suffix.lower() == ".json" else None)
    if kind is None:
        raise SourceError(f"{path} is no scene: not .gltf, .glb, .json, {', '.join(_suffixes())}")
    return _source(path.name, path, kind)


def _source(name: str, path: Path, kind: Kind) -> Source:
    if len(name) > MAX_NAME or not name.isprintable() or "\\" in name:
        raise SourceError(f"{name[:80]!r} cannot be a scene's name: too long, or characters that are not printable")
    return Source(name, str(path.resolve()), kind)


def kind_of(path: Path) -> Kind | None:
    """By the file's name, as far as it tells."""
    name = path.name.lower()
    if name.endswith((".gltf", ".glb")):
        return Kind.GLTF
    if name.endswith(TREE_SUFFIX):
        return Kind.TREE
    if name.endswith(REQUEST_SUFFIX):
        return Kind.REQUEST
    return Kind.MESH if name.rpartition(".")[2] in _MESHES and "." in name else None
