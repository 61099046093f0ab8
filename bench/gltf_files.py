"""Documents as modelling tools write them, for ``bench.gltf``: one buffer, a view for each kind of attribute, normals
and texture coordinates, a picture or two, as ``.glb`` and as ``.gltf`` with data URIs.

Made up here, after what known files have (vertices, triangles, meshes, nodes, bytes of pictures): their own bytes would
have to be fetched. The shapes are meaningless; no reader looks at them.
"""

import base64
import json
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

FLOATS: Final = 5126
SHORTS: Final = 5123
WORDS: Final = 5125


@dataclass(frozen=True, slots=True)
class Model:
    """Size of a generated glTF file."""

    name: str
    meshes: int
    vertices: int
    """Vertices of all meshes together."""
    triangles: int
    nodes: int
    depth: int = 1
    """Levels of nodes below which the meshes are; the nodes are spread over them."""
    textured: bool = True
    """Texture coordinates, and pictures."""
    pictures: tuple[int, ...] = ()
    """Bytes of each; what they show is noise."""


MODELS: Final = (
    Model("duck", 1, 2_399, 4_212, 3, 2, pictures=(16_302,)),
    Model("milk truck", 4, 3_624, 3_624, 6, 3, pictures=(447_000,)),
    Model("engine of two cylinders", 34, 55_843, 121_496, 82, 6, textured=False),
    Model("damaged helmet", 1, 14_556, 15_452, 1, pictures=(936_000, 1_300_000, 361_000, 98_000, 517_000)),
    Model("101 objects", 101, 25_700, 49_612, 102, 2, textured=False),
    Model("a million triangles", 1, 501_126, 1_002_252, 1),
)
"""The first four after glTF's sample models Duck, CesiumMilkTruck, 2CylinderEngine and DamagedHelmet."""


def _picture(count: int) -> bytes:
    """A PNG of 256 by 256 pixels, as far as its chunks go: what Pillow does not take for a picture would cost trimesh a
    try of every format there is. What is in it is noise."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    head = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 256, 256, 8, 2, 0, 0, 0))
    end = chunk(b"IEND", b"")
    return head + chunk(b"IDAT", np.random.default_rng(count).bytes(count - len(head) - len(end) - 12)) + end


def _parts(model: Model) -> tuple[dict[str, Any], bytes]:
    """The document without its buffer, and the buffer."""
    rng = np.random.default_rng(7)
    wide = model.vertices // model.meshes >= 1 << 16
    vertices = np.full(model.meshes, model.vertices // model.meshes)
    triangles = np.full(model.meshes, model.triangles // model.meshes)
    vertices[0] += model.vertices - vertices.sum()
    triangles[0] += model.triangles - triangles.sum()
    normals = rng.normal(size=(model.vertices, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    indices = np.concatenate([rng.integers(0, n, (m, 3)) for n, m in zip(vertices, triangles, strict=True)])
    blocks = [
        indices.astype(np.uint32 if wide else np.uint16).tobytes(),
        rng.random((model.vertices, 3), np.float32).tobytes(),
        normals.astype(np.float32).tobytes(),
    ]
    kinds = [("indices", WORDS if wide else SHORTS, "SCALAR"), ("POSITION", FLOATS, "VEC3"), ("NORMAL", FLOATS, "VEC3")]
    if model.textured:
        blocks.append(rng.random((model.vertices, 2), np.float32).tobytes())
        kinds.append(("TEXCOORD_0", FLOATS, "VEC2"))
    blocks += [_picture(count) for count in model.pictures]
    views: list[dict[str, Any]] = []
    offset = 0
    for number, block in enumerate(blocks):
        blocks[number] = block + bytes(-len(block) % 4)
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": len(block)})
        if 0 < number < len(kinds):
            views[-1] |= {"byteStride": 8 if number == 3 else 12, "target": 34962}
        offset += len(blocks[number])
    accessors: list[dict[str, Any]] = []
    meshes = []
    places = [0] * len(kinds)
    for mesh, (n, m) in enumerate(zip(vertices.tolist(), triangles.tolist(), strict=True)):
        primitive: dict[str, Any] = {"attributes": {}, "material": 0, "mode": 4}
        for view, (name, component, kind) in enumerate(kinds):
            count = n if view else 3 * m
            size = (8 if view == 3 else 12) if view else (4 if wide else 2)
            accessor = {"bufferView": view, "byteOffset": places[view], "componentType": component, "count": count}
            accessors.append(accessor | {"type": kind})
            if name == "POSITION":
                accessors[-1] |= {"min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 1.0]}
            places[view] += count * size
            target = primitive["attributes"] if view else primitive
            target[name] = len(accessors) - 1
        meshes.append({"name": f"part {mesh}", "primitives": [primitive]})
    material: dict[str, Any] = {"name": "skin", "pbrMetallicRoughness": {"metallicFactor": 0.0}}
    if model.pictures:
        material["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
    for member, index in zip(("normalTexture", "emissiveTexture", "occlusionTexture"), (1, 2, 3), strict=True):
        if index < len(model.pictures):
            material[member] = {"index": index}
    if len(model.pictures) > 4:
        material["pbrMetallicRoughness"]["metallicRoughnessTexture"] = {"index": 4}
    document = {
        "asset": {"version": "2.0", "generator": "bench"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": _nodes(model),
        "meshes": meshes,
        "accessors": accessors,
        "bufferViews": views,
        "materials": [material],
    }
    if model.pictures:
        document["samplers"] = [{"magFilter": 9729, "minFilter": 9986, "wrapS": 10497, "wrapT": 10497}]
        document["textures"] = [{"sampler": 0, "source": index} for index in range(len(model.pictures))]
        document["images"] = [
            {"bufferView": len(kinds) + index, "mimeType": "image/png"} for index in range(len(model.pictures))
        ]
    return document, b"".join(blocks)


def _nodes(model: Model) -> list[dict[str, Any]]:
    """A tree of the model's depth; the last nodes carry the meshes."""
    nodes: list[dict[str, Any]] = [{"name": f"node {index}"} for index in range(model.nodes)]
    for index, node in enumerate(nodes):
        if index % 3 == 1:
            node["matrix"] = [1.0, 0.0, 0.0, 0.0, 0.0, 0.6, 0.8, 0.0, 0.0, -0.8, 0.6, 0.0, 0.1 * index, 0.0, 0.0, 1.0]
        elif index % 3 == 2:
            node |= {"translation": [0.0, 0.1 * index, 0.0], "rotation": [0.0, 0.0, 0.6, 0.8]}
        if index:
            parent = index - 1 if index < model.depth else (index - model.depth) % model.depth
            nodes[parent].setdefault("children", []).append(index)
    for mesh in range(model.meshes):
        nodes[len(nodes) - model.meshes + mesh]["mesh"] = mesh
    return nodes


def files() -> Iterator[tuple[str, str, bytes]]:
    """Name, type for trimesh, and the file, of every model as ``.glb`` and as ``.gltf``."""
    for model in MODELS:
        document, data = _parts(model)
        text = json.dumps(document | {"buffers": [{"byteLength": len(data)}]}, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
        yield f"{model.name}, glb", "glb", struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
        uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
        buffers = [{"byteLength": len(data), "uri": uri}]
        yield f"{model.name}, gltf", "gltf", json.dumps(document | {"buffers": buffers}, indent=2).encode()
