"""Director's rule for missing paths: a model of its folders."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass
class _Folder:
    children: dict[Any, _Folder] = field(default_factory=dict)
    geometry: bool = False


class DirectorModel:
    """Applies plain requests.

    By Director's rule, a path is missing if its folder is empty; empty folders made by other commands hide missing
    geometry. By the document's rule, it is missing if there is no geometry at or below it.
    """

    def __init__(self) -> None:
        self._root = _Folder()

    def apply(self, request: dict[str, Any]) -> tuple[set[tuple[Any, ...]], set[tuple[Any, ...]]]:
        for command in request["delete"]:
            path = command["path"]
            if path:
                self._folder(path)  # Director creates a folder before it removes it, and keeps its parents
                del self._folder(path[:-1]).children[path[-1]]
            else:
                self._root = _Folder()
        for command in request["setgeometry"]:
            self._folder(command["path"]).geometry = True
        director, document = set(), set()
        for command in request["settransform"]:
            folder = self._folder(command["path"])
            if not folder.children and not folder.geometry:
                director.add(tuple(command["path"]))
            if not _drawn(folder):
                document.add(tuple(command["path"]))
        return director, document

    def _folder(self, path: list[Any]) -> _Folder:
        folder = self._root
        for name in path:
            folder = folder.children.setdefault(name, _Folder())
        return folder


def _drawn(folder: _Folder) -> bool:
    return folder.geometry or any(_drawn(child) for child in folder.children.values())
