"""Builds small glTF documents for the tests."""

import base64
import json
import struct
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gateway.files.gltf import GltfScene, read_gltf
from gateway.scene.tree.geometry import Part, Surface
from gateway.scene.tree.nodes import Path
from renderers.drawlist import Light, Mesh

COMPONENT = {"b": 5120, "B": 5121, "h": 5122, "H": 5123, "i": 5124, "I": 5125, "f": 5126, "d": 5130}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
TRIANGLE = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], np.float32)


def data_uri(data: bytes, mime: str = "application/octet-stream") -> str:
    return f"data:{mime};base64,{base64.b64encode(data).decode()}"


class Builder:
    """A document under construction; every array gets a buffer of its own, as VTK writes it."""

    def __init__(self, generator: str = "test") -> None:
        self.json: dict[str, Any] = {"asset": {"version": "2.0", "generator": generator}}

    def add(self, array: str, value: Any) -> int:
        items = self.json.setdefault(array, [])
        items.append(value)
        return len(items) - 1

    def buffer(self, data: bytes) -> int:
        return self.add("buffers", {"byteLength": len(data), "uri": data_uri(data)})

    def view(self, data: bytes, **more: Any) -> int:
        return self.add("bufferViews", {"buffer": self.buffer(data), "byteLength": len(data), **more})

    def accessor(self, values: ArrayLike, dtype: str = "f", **more: Any) -> int:
        array = np.asarray(values, dtype)
        components = 1 if array.ndim == 1 else array.shape[1]
        return self.add(
            "accessors",
            {
                "bufferView": self.view(array.tobytes()),
                "componentType": COMPONENT[dtype],
                "count": len(array),
                "type": TYPES[components],
                **more,
            },
        )

    def points(self, view: int | None, count: int = 3, **more: Any) -> int:
        """An accessor of positions in a view, or of zeros."""
        place = {} if view is None else {"bufferView": view}
        return self.add("accessors", {"componentType": 5126, "count": count, "type": "VEC3", **place, **more})

    def mesh(self, *primitives: dict[str, Any]) -> int:
        return self.add("meshes", {"primitives": list(primitives)})

    def triangle(self, **more: Any) -> int:
        """A mesh of one triangle without indices."""
        return self.mesh({"attributes": {"POSITION": self.accessor(TRIANGLE)}, **more})

    def draw(self, positions: ArrayLike | int = TRIANGLE, indices: ArrayLike | None = None, **more: Any) -> "Builder":
        """Add a node that draws a primitive, whose attributes are upper-case: values, or numbers of accessors."""
        given = {"POSITION": positions} | {name: more.pop(name) for name in [*more] if name.isupper()}
        attributes = {name: v if isinstance(v, int) else self.accessor(v) for name, v in given.items()}
        if indices is not None:
            more["indices"] = self.accessor(indices, "I" if np.max(indices) > 255 else "B")
        self.node(mesh=self.mesh({"attributes": attributes, **more}))
        return self

    def node(self, **values: Any) -> int:
        return self.add("nodes", values)

    def text(self) -> bytes:
        return json.dumps(self.json).encode()

    def read(self, **options: Any) -> GltfScene:
        """Read the document as a posted scene."""
        return read_gltf(self.text(), **{"posted": True, **options})


def glb(document: dict[str, Any] | bytes, binary: bytes | None = None) -> bytes:
    text = document if isinstance(document, bytes) else json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    if binary is not None:
        binary += b"\0" * (-len(binary) % 4)
        chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def parts(scene: GltfScene) -> list[tuple[Path, Part]]:
    """All parts but lights, with the paths of their nodes."""
    return [
        (path, part)
        for path, node in scene.root.walk()
        for part in node.parts or ()
        if not isinstance(part.shape, Light)
    ]


def meshes(scene: GltfScene) -> list[Mesh]:
    return [mesh_of(part) for _, part in parts(scene)]


def mesh_of(part: Part) -> Mesh:
    assert isinstance(part.shape, Surface)
    return part.shape.mesh


def only_mesh(scene: GltfScene) -> Mesh:
    (mesh,) = meshes(scene)
    return mesh


def drawn(positions: ArrayLike = TRIANGLE, indices: ArrayLike | None = None, **more: Any) -> Mesh:
    """The mesh of a document that draws it once."""
    return only_mesh(Builder().draw(positions, indices, **more).read())


def corners(mesh: Mesh) -> NDArray[np.float32]:
    """(M, 3, 3) positions of the triangles."""
    return mesh.positions[mesh.elements]


def world_triangles(scene: GltfScene) -> list[NDArray[np.float64]]:
    """(M, 3, 3) positions of the triangles in the document's world frame, for each primitive of each node."""
    return [
        corners(mesh_of(part)) @ X[:3, :3].T + X[:3, 3]
        for X, node_parts in zip(scene.nodes.X_world_node, scene.parts, strict=True)
        for part in node_parts or ()
    ]


def read_file(name: str, **options: Any) -> GltfScene:
    """Read a file that files/make.mjs wrote with glTF-Transform: a column, compressed, posed or instanced."""
    return read_gltf((FilePath(__file__).parent / "files" / f"{name}.glb").read_bytes(), **options)
