"""Requests of Drake's client for the benches: recorded ones with other poses and sizes, and scenes made up here."""

from __future__ import annotations

import base64
import copy
import hashlib
import json
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

BOUNDARY = "------------------------bEnChBoUnDaRy012345678"
CONTENT_TYPE = f"multipart/form-data; boundary={BOUNDARY}"
KINDS = ("color", "depth", "label")
Array = np.ndarray[Any, Any]


def corpus() -> Path | None:
    """The folder of recorded requests that the environment names."""
    named = os.environ.get("SCENEGATE_CORPUS")
    return Path(named) if named and (Path(named) / "drake").is_dir() else None


def scene_of(body: bytes) -> bytes:
    """The glTF part of a recorded request, which is the last one."""
    start = body.index(b"\r\n\r\n", body.rindex(b'name="scene";')) + 4
    return body[start : body.rindex(b"\r\n--")]


@dataclass
class Posted:
    """A scene whose pictures are asked for, each with other poses than the one before."""

    name: str
    fields: dict[str, str]
    """Form fields of the recorded request."""
    nodes: list[dict[str, Any]]
    before: bytes
    """The document's text before its nodes ..."""
    after: bytes
    """... and after them."""
    _numbers: Iterator[int] = field(default_factory=lambda: iter(range(1, 1 << 30)))

    @classmethod
    def of_document(cls, name: str, fields: dict[str, str], document: dict[str, Any]) -> Posted:
        nodes = document["nodes"]
        text = json.dumps({**document, "nodes": "HERE"}, separators=(",", ":")).encode()
        before, _, after = text.partition(b'"HERE"')
        return cls(name, fields, nodes, before, after)

    def scene(self, number: int) -> bytes:
        """The document; everything stands a little elsewhere with every number."""
        nodes = copy.deepcopy(self.nodes)
        for index, node in enumerate(nodes):
            if "mesh" in node or "camera" in node:
                matrix = node.setdefault("matrix", [float(i % 5 == 0) for i in range(16)])
                for axis in range(3):
                    matrix[12 + axis] += 0.002 * math.sin(number + index + axis)
        return self.before + json.dumps(nodes, separators=(",", ":")).encode() + self.after

    def moved(self, width: int, height: int) -> bytes:
        """The body of a request whose poses were never sent before."""
        return body(self.scene(next(self._numbers)), self.fields, width, height)


def body(scene: bytes, fields: Mapping[str, str], width: int, height: int) -> bytes:
    """A request for a picture of this size, of the view that the fields describe."""
    fields = dict(fields)
    across, down = width / int(fields["width"]), height / int(fields["height"])
    scale = max(across, down)
    fields |= {"width": str(width), "height": str(height)}
    fields |= {name: f"{float(fields[name]) * scale:.6f}" for name in ("focal_x", "focal_y")}
    fields |= {"center_x": f"{width / 2 - 0.5:.6f}", "center_y": f"{height / 2 - 0.5:.6f}"}
    fields["scene_sha256"] = hashlib.sha256(scene).hexdigest()
    head = b"".join(
        f'--{BOUNDARY}\r\nContent-Disposition: form-data; name="{name}"\r\n\r\n{value}\r\n'.encode()
        for name, value in fields.items()
    )
    part = f'--{BOUNDARY}\r\nContent-Disposition: form-data; name="scene"; filename="0000000000000000001.gltf"\r\n'
    part += "Content-Type: model/gltf+json\r\n\r\n"
    return b"".join((head, part.encode(), scene, f"\r\n--{BOUNDARY}--\r\n".encode()))


def recorded(folder: Path, number: str, kind: str) -> Posted:
    """The recorded request of a scene by the number that its folder's name begins with."""
    where = next(folder.glob(f"drake/scenes/{number}_*")) / kind
    fields = json.loads((where / "fields.json").read_text())["fields"]
    document = json.loads(scene_of((where / "request.multipart").read_bytes()))
    return Posted.of_document(where.parent.name, fields, document)


def fields_for(kind: str, near: float = 0.01, far: float = 10.0) -> dict[str, str]:
    """A form for a picture of 640 x 480."""
    numbers = {"far": far, "focal_x": 579.411255, "focal_y": 579.411255, "near": near}
    numbers |= {"max_depth": far, "min_depth": near} if kind == "depth" else {}
    texts = {name: f"{value:.6f}" for name, value in numbers.items()}
    return {**texts, "image_type": kind, "width": "640", "height": "480", "center_x": "319.5", "center_y": "239.5"}


def accessor(document: dict[str, Any], values: Array, component: int, kind: str) -> int:
    """Adds an array to a document as Drake's client does: a buffer for each."""
    data = values.tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    index = len(document["buffers"])
    document["buffers"].append({"byteLength": len(data), "uri": uri})
    document["bufferViews"].append({"buffer": index, "byteLength": len(data)})
    document["accessors"].append({"bufferView": index, "componentType": component, "count": len(values), "type": kind})
    return index


def sphere(columns: int, rows: int) -> tuple[Array, Array, Array, Array]:
    """Positions, normals and texture coordinates (float32) and triangles (uint32) of a sphere of diameter one."""
    u, v = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    a, b = 2 * np.pi * u, np.pi * v
    normals = np.stack((np.cos(a) * np.sin(b), np.sin(a) * np.sin(b), np.cos(b)), axis=-1).reshape(-1, 3)
    first = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    below = first + columns + 1
    triangles = np.concatenate((np.stack((first, below, first + 1), 1), np.stack((first + 1, below, below + 1), 1)))
    uv = np.stack((u, v), -1).reshape(-1, 2)
    narrow = np.float32
    return (0.5 * normals).astype(narrow), normals.astype(narrow), uv.astype(narrow), triangles.astype(np.uint32)


def textured(kind: str, copies: int = 10, unique: int = 3, side: int = 4096) -> Posted:
    """A scene of 25 MB: ``copies`` spheres of 20,000 triangles, each with a texture of its own in the file, but only
    ``unique`` of them different, as Drake's client sends a mesh that stands in several places."""
    rng = np.random.default_rng(7)
    names = ("accessors", "bufferViews", "buffers", "images", "materials", "meshes", "nodes", "textures")
    document: dict[str, Any] = {"asset": {"version": "2.0", "generator": "Drake glTF merger"}}
    document |= {name: [] for name in names}
    # Drake's client sorts the members by name.
    document = dict(sorted((document | {"scene": 0, "scenes": [], "cameras": [], "samplers": [{}]}).items()))
    document["cameras"].append(
        {"perspective": {"aspectRatio": 4 / 3, "yfov": 0.8, "zfar": 10.0, "znear": 0.01}, "type": "perspective"}
    )
    pictures = []
    for _ in range(unique):
        noise = rng.integers(0, 256, (side // 32, side // 32, 3), dtype=np.uint8)
        picture = cv2.resize(noise, (side, side), interpolation=cv2.INTER_CUBIC)
        encoded = cv2.imencode(".jpg", picture, (cv2.IMWRITE_JPEG_QUALITY, 64))[1]
        pictures.append("data:image/jpeg;base64," + base64.b64encode(encoded.tobytes()).decode())
    meshes = [sphere(100 + which, 100) for which in range(unique)]
    for number in range(copies):
        positions, normals, uv, triangles = meshes[number % unique]
        attributes = {
            "NORMAL": accessor(document, normals, 5126, "VEC3"),
            "POSITION": accessor(document, positions, 5126, "VEC3"),
            "TEXCOORD_0": accessor(document, uv, 5126, "VEC2"),
        }
        indices = accessor(document, triangles.reshape(-1), 5125, "SCALAR")
        document["images"].append({"mimeType": "image/jpeg", "uri": pictures[number % unique]})
        document["textures"].append({"sampler": 0, "source": number})
        pbr = {"baseColorTexture": {"index": number}, "metallicFactor": 0.0, "roughnessFactor": 0.6}
        document["materials"].append({"pbrMetallicRoughness": pbr})
        primitive = {"attributes": attributes, "indices": indices, "material": number}
        document["meshes"].append({"primitives": [primitive]})
        place = [1.1 * (number % 4) - 1.65, 1.1 * (number // 4) - 1.1, -4.0]
        matrix = [*np.eye(4).ravel()[:12], *place, 1.0]
        document["nodes"].append({"mesh": number, "name": f"ball{number}", "matrix": matrix})
    document["nodes"].append({"camera": 0, "name": "Camera Node", "matrix": [*np.eye(4).ravel()]})
    document["scenes"].append({"nodes": list(range(copies + 1))})
    return Posted.of_document("25 MB", fields_for(kind), document)
