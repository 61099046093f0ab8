"""Helpers that send requests to the protocol without a transport."""

import json
from typing import Any

import msgspec

from gateway.adapters.treeviewer.config import Limits
from gateway.adapters.treeviewer.context import MeshLoader
from gateway.adapters.treeviewer.protocol import TreeViewerProtocol
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.nodes import Node, Path
from scenegate.messages import wire

BOX = {"type": "box", "lengths": [1, 2, 3]}
CLOUD = {"type": "pointcloud", "points": [[0, 0, 0], [1, 0, 0], [0, 1, 0]]}
TRIANGLE = {"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]]}
"""Fields of a mesh_data."""


def message(request: Any, utime: int = 7) -> bytes:
    """Return a request as Python clients write it (with bare NaN); text is used as it is."""
    text = request if isinstance(request, str) else json.dumps(request)
    return wire.encode(text.encode("utf-8", "surrogatepass"), utime)


ONE_BOX = message({"setgeometry": [{"path": ["a"], "geometry": BOX}]})


def decoded(data: bytes) -> dict[str, Any]:
    comms = wire.decode(data)
    assert (comms.format, comms.major, comms.minor, comms.fault) == ("treeviewer_json", 1, 0, "")
    answer: dict[str, Any] = json.loads(comms.data.tobytes())
    return answer


class Viewer:
    """A live tree and the protocol that edits it."""

    def __init__(self, limits: Limits | None = None, meshes: MeshLoader | None = None, *, strict: bool = False) -> None:
        self.live = LiveTree()
        self.protocol = TreeViewerProtocol(self.live, limits, meshes, strict=strict)

    def tell(self, request: Any, utime: int = 7) -> dict[str, Any]:
        answer: dict[str, Any] = json.loads(msgspec.json.encode(self.protocol.handle(message(request, utime))))
        return answer

    def publish(self, *geometries: Any, path: Any = ("it",), **more: Any) -> dict[str, Any]:
        return self.tell({"setgeometry": [{"path": list(path), "geometries": list(geometries), **more}]})

    def node(self, *path: Any) -> Node:
        node = self.live.snapshot.root.find(path)
        assert node is not None
        return node

    def parts(self, *path: Any) -> tuple[Part, ...]:
        parts = self.node(*(path or ("it",))).parts
        assert parts is not None
        return parts

    def paths(self) -> set[Path]:
        return {path for path, node in self.live.snapshot.root.walk() if node.parts is not None}
