"""A browser's model of the scene in Python: takes frames in as the page does."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gateway.scene.tree import Node, Path
from gateway.viewer.frames import parse

IDENTITY = tuple(np.eye(4).ravel().tolist())


def array(body: memoryview, span: list[int], dtype: str) -> NDArray[Any]:
    return np.frombuffer(body, dtype, span[1], span[0])


@dataclass
class Known:
    name: str | int
    parent: int | None
    parts: list[dict[str, Any]] | None = None
    visible: bool = True
    pose: tuple[float, ...] = IDENTITY
    """7 numbers of a pose or 16 of a matrix, column-major, as it came."""
    children: set[int] = field(default_factory=set)


class Model:
    """Raises when a frame does not fit what it has."""

    def __init__(self) -> None:
        self.nodes: dict[int, Known] = {0: Known("", None)}
        self.meshes: set[int] = set()
        self.revision = 0

    def take(self, frame: bytes) -> None:
        header, body = parse(frame)
        {"update": self._update, "mesh": self._mesh, "forget": self._forget}[header["kind"]](header, body)

    def _mesh(self, header: dict[str, Any], body: memoryview) -> None:
        assert np.isfinite(array(body, header["position"], "<f4")).all()
        self.meshes.add(header["id"])

    def _forget(self, header: dict[str, Any], _: memoryview) -> None:
        self.meshes -= set(header["meshes"])

    def _update(self, header: dict[str, Any], body: memoryview) -> None:
        if header["from"] == 0:
            self.nodes = {0: Known("", None)}
        else:
            assert header["from"] == self.revision, "the frame starts from another revision"
        for number in header.get("removed", ()):
            self._remove(number)
        for entry in header.get("nodes", ()):
            self._enter(entry)
        for name, width in (("poses", 7), ("matrices", 16)):
            if name in header:
                ids = array(body, header[name]["ids"], "<u4")
                values = array(body, header[name]["values"], "<f4").reshape(-1, width)
                for number, row in zip(ids.tolist(), values.tolist(), strict=True):
                    self.nodes[number].pose = tuple(row)
        self.revision = header["revision"]

    def _remove(self, number: int) -> None:
        gone = self.nodes.pop(number)
        assert gone.parent is not None
        if gone.parent in self.nodes:
            self.nodes[gone.parent].children.discard(number)
        for child in tuple(gone.children):
            self._remove(child)

    def _enter(self, entry: dict[str, Any]) -> None:
        number = entry["id"]
        if number not in self.nodes:
            self.nodes[number] = Known(entry["name"], entry["parent"])
            self.nodes[entry["parent"]].children.add(number)
        node = self.nodes[number]
        if "visible" in entry:
            node.visible = entry["visible"]
        if "parts" in entry:
            node.parts = entry["parts"]
            for part in node.parts or ():
                assert {draw["mesh"] for draw in part["draws"]} <= self.meshes, "a mesh comes before who uses it"

    def tree(self) -> dict[Path, tuple[Any, ...]]:
        """Path to (number of parts, visible, pose); names of elements keep their type."""
        return {self._path(number): described(node) for number, node in self.nodes.items()}

    def _path(self, number: int) -> Path:
        path: list[str | int] = []
        node = self.nodes[number]
        while node.parent is not None:
            path.insert(0, node.name)
            node = self.nodes[node.parent]
        return tuple(path)


def described(node: Known) -> tuple[Any, ...]:
    parts = None if node.parts is None else [part["kind"] for part in node.parts]
    return parts, node.visible, node.pose


def tree_of(root: Node) -> dict[Path, tuple[Any, ...]]:
    """The same of a tree of the gateway."""
    found: dict[Path, tuple[Any, ...]] = {}
    for path, node in root.walk():
        parts = None if node.parts is None else [part.kind or type(part.shape).__name__.lower() for part in node.parts]
        pose = node.matrix.T.ravel() if node.pose is None else node.pose
        found[path] = (parts, node.visible, tuple(np.array(pose, np.float32).tolist()))
    return found
