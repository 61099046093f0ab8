"""A Python model of the page's scene, updated by frames as the page is."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.viewer.browser import Browser
from gateway.adapters.viewer.encoder import Encoder
from gateway.adapters.viewer.frames import ControlFrames
from gateway.adapters.viewer.hub import ViewHub
from gateway.adapters.viewer.resources import Resources
from gateway.scene.page.control_store import ControlStore
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.nodes import Node, Path
from renderers.drawlist import Material
from scenegate.messages.geometry import Box
from tests.support.view_frames import parse_frame

IDENTITY = tuple(np.eye(4).ravel().tolist())


def body_array(body: memoryview, span: list[int], dtype: str) -> NDArray[Any]:
    return np.frombuffer(body, dtype, span[1], span[0])


def browser_of(encoder: Encoder, resources: Resources) -> Browser:
    """Return a connection to a page without controls."""
    return Browser(encoder, resources, ControlFrames(ControlStore(), LiveTree()), lambda browser: None)


@asynccontextmanager
async def running(hub: ViewHub) -> AsyncIterator[ViewHub]:
    """Run a hub."""
    task = asyncio.create_task(hub.run())
    yield hub
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


def box_tree(name: str = "box") -> LiveTree:
    """Return a tree with one box."""
    tree = LiveTree()
    add_box(tree, name)
    return tree


def add_box(tree: LiveTree, name: str) -> None:
    with tree.edit() as edit:
        edit.set_parts((name,), (Part(Box((1, 1, 1)), Material()),))


@dataclass
class PageNode:
    name: str | int
    parent: int | None
    parts: list[dict[str, Any]] | None = None
    visible: bool = True
    opacity: float = 1.0
    pose: tuple[float, ...] = IDENTITY
    """7 numbers of a pose or 16 of a column-major matrix."""
    children: set[int] = field(default_factory=set)


class Model:
    """Nodes and meshes by id. Raises AssertionError if a frame refers to nodes or meshes that it does not have."""

    def __init__(self) -> None:
        self.nodes: dict[int, PageNode] = {0: PageNode("", None)}
        self.meshes: set[int] = set()
        self.revision = 0

    def receive(self, frame: bytes) -> None:
        """Apply a frame."""
        header, body = parse_frame(frame)
        {"update": self._update, "mesh": self._mesh, "forget": self._forget}[header["kind"]](header, body)

    def _mesh(self, header: dict[str, Any], body: memoryview) -> None:
        assert np.isfinite(body_array(body, header["position"], "<f4")).all()
        self.meshes.add(header["id"])

    def _forget(self, header: dict[str, Any], _: memoryview) -> None:
        self.meshes -= set(header["meshes"])

    def _update(self, header: dict[str, Any], body: memoryview) -> None:
        if header["from"] == 0:
            self.nodes = {0: PageNode("", None)}
        else:
            assert header["from"] == self.revision, "the update starts from another revision"
        for number in header.get("removed", ()):
            self._remove(number)
        for entry in header.get("nodes", ()):
            self._set_entry(entry)
        for name, width, dtype in (("poses", 7, "<f4"), ("matrices", 16, "<f8")):
            if name in header:
                ids = body_array(body, header[name]["ids"], "<u4")
                values = body_array(body, header[name]["values"], dtype).reshape(-1, width)
                for number, row in zip(ids.tolist(), values.tolist(), strict=True):
                    self.nodes[number].pose = tuple(row)
        used = {draw["mesh"] for node in self.nodes.values() for part in node.parts or () for draw in part["draws"]}
        assert used <= self.meshes, "the page lacks a mesh that it shows"
        self.revision = header["revision"]

    def _remove(self, number: int) -> None:
        node = self.nodes.pop(number)
        assert node.parent is not None
        if node.parent in self.nodes:
            self.nodes[node.parent].children.discard(number)
        for child in tuple(node.children):
            self._remove(child)

    def _set_entry(self, entry: dict[str, Any]) -> None:
        number = entry["id"]
        if number not in self.nodes:
            self.nodes[number] = PageNode(entry["name"], entry["parent"])
            self.nodes[entry["parent"]].children.add(number)
        node = self.nodes[number]
        for name in ("visible", "opacity", "parts"):
            setattr(node, name, entry.get(name, getattr(node, name)))

    def tree(self) -> dict[Path, tuple[Any, ...]]:
        """Return (kinds of parts, visible, pose) by path. Names keep their types."""
        return {self._path(number): described(node) for number, node in self.nodes.items()}

    def _path(self, number: int) -> Path:
        path: list[str | int] = []
        node = self.nodes[number]
        while node.parent is not None:
            path.insert(0, node.name)
            node = self.nodes[node.parent]
        return tuple(path)


def described(node: PageNode) -> tuple[Any, ...]:
    parts = None if node.parts is None else [part["kind"] for part in node.parts]
    return parts, (node.visible, node.opacity), node.pose


def tree_of(root: Node) -> dict[Path, tuple[Any, ...]]:
    """Return the same for a tree of the gateway."""
    found: dict[Path, tuple[Any, ...]] = {}
    for path, node in root.walk():
        parts = None if node.parts is None else [part.kind or type(part.shape).__name__.lower() for part in node.parts]
        pose = tuple(node.matrix.T.ravel().tolist() if node.pose is None else np.array(node.pose, np.float32).tolist())
        found[path] = (parts, (node.visible, node.opacity), pose)
    return found
