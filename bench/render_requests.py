"""Render requests as Drake's client sends them: recorded ones with changed poses and sizes, and generated scenes."""

from __future__ import annotations

import base64
import copy
import hashlib
import json
import math
import os
from collections.abc import Iterable, Iterator, Mapping
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
    """Return the folder of recorded requests, SCENEGATE_CORPUS; None if there is none."""
    folder = os.environ.get("SCENEGATE_CORPUS")
    return Path(folder) if folder and (Path(folder) / "drake").is_dir() else None


def scene_of(body: bytes) -> bytes:
    """Return the glTF document of a recorded request: its last part."""
    start = body.index(b"\r\n\r\n", body.rindex(b'name="scene";')) + 4
    return body[start : body.rindex(b"\r\n--")]


@dataclass
class RenderScene:
    """A scene, and requests for images of it, each with different poses."""

    name: str
    fields: dict[str, str]
    """Form fields of the recorded request."""
    nodes: list[dict[str, Any]]
    """Nodes of the glTF document."""
    before: bytes
    """Text of the document before its nodes."""
    after: bytes
    """Text of the document after its nodes."""
    _numbers: Iterator[int] = field(default_factory=lambda: iter(range(1, 1 << 30)))

    @classmethod
    def of_document(cls, name: str, fields: dict[str, str], document: dict[str, Any]) -> RenderScene:
        """Return the scene of a glTF document."""
        nodes = document["nodes"]
        text = json.dumps({**document, "nodes": "HERE"}, separators=(",", ":")).encode()
        before, _, after = text.partition(b'"HERE"')
        return cls(name, fields, nodes, before, after)

    def scene(self, number: int) -> bytes:
        """Return the document with moved nodes: all poses depend on the number."""
        nodes = copy.deepcopy(self.nodes)
        for index, node in enumerate(nodes):
            if "mesh" in node or "camera" in node:
                matrix = node.setdefault("matrix", [float(i % 5 == 0) for i in range(16)])
                for axis in range(3):
                    matrix[12 + axis] += 0.002 * math.sin(number + index + axis)
        return self.before + json.dumps(nodes, separators=(",", ":")).encode() + self.after

    def next_body(self, width: int, height: int) -> bytes:
        """Return the body of a request with poses that no earlier one had."""
        return request_body(self.scene(next(self._numbers)), self.fields, width, height)


def request_body(scene: bytes, fields: Mapping[str, str], width: int, height: int) -> bytes:
    """Return the body of a request for an image of a size.

    Args:
        scene: glTF document.
        fields: form fields. Their intrinsics are scaled to the size.
        width, height: size of the image, pixels.
    """
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


def recorded(folder: Path, number: str, kind: str) -> RenderScene:
    """Return the scene of a recorded request.

    Args:
        folder: folder of recorded requests, see ``corpus``.
        number: start of the name of the scene's folder.
        kind: image type.
    """
    request = next(folder.glob(f"drake/scenes/{number}_*")) / kind
    fields = json.loads((request / "fields.json").read_text())["fields"]
    document = json.loads(scene_of((request / "request.multipart").read_bytes()))
    return RenderScene.of_document(request.parent.name, fields, document)


def scenes(kind: str, numbers: Iterable[str]) -> list[RenderScene]:
    """Return recorded scenes, see ``recorded``; one of ten spheres of 2,000 triangles if there are none."""
    folder = corpus()
    if folder is None:
        return [textured(kind, side=256, rows=32)]
    return [recorded(folder, number, kind) for number in numbers]


def fields_for(kind: str, near: float = 0.01, far: float = 10.0) -> dict[str, str]:
    """Return the form fields of a request for an image of 640 x 480 pixels. The planes are in metres."""
    numbers = {"far": far, "focal_x": 579.411255, "focal_y": 579.411255, "near": near}
    numbers |= {"max_depth": far, "min_depth": near} if kind == "depth" else {}
    texts = {name: f"{value:.6f}" for name, value in numbers.items()}
    return {**texts, "image_type": kind, "width": "640", "height": "480", "center_x": "319.5", "center_y": "239.5"}


def accessor(document: dict[str, Any], values: Array, component: int, kind: str) -> int:
    """Add an array to a glTF document, with a buffer of its own as Drake's client does. Return the accessor's index."""
    data = values.tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    index = len(document["buffers"])
    document["buffers"].append({"byteLength": len(data), "uri": uri})
    document["bufferViews"].append({"buffer": index, "byteLength": len(data)})
    document["accessors"].append({"bufferView": index, "componentType": component, "count": len(values), "type": kind})
    return index


def sphere(columns: int, rows: int) -> tuple[Array, Array, Array, Array]:
    """Return positions, normals, texture coordinates (float32) and triangles (uint32) of a sphere of diameter 1."""
    u, v = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    a, b = 2 * np.pi * u, np.pi * v
    normals = np.stack((np.cos(a) * np.sin(b), np.sin(a) * np.sin(b), np.cos(b)), axis=-1).reshape(-1, 3)
    first = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    below = first + columns + 1
    triangles = np.concatenate((np.stack((first, below, first + 1), 1), np.stack((first + 1, below, below + 1), 1)))
    uv = np.stack((u, v), -1).reshape(-1, 2)
    f32 = np.float32
    return (0.5 * normals).astype(f32), normals.astype(f32), uv.astype(f32), triangles.astype(np.uint32)


def textured(kind: str, copies: int = 10, unique: int = 3, side: int = 4096, rows: int = 100) -> RenderScene:
    """Return a scene of spheres with a texture and twice ``rows`` squared triangles each; 25 MB by default.

    Args:
        kind: image type.
        copies: number of spheres. Each has its own mesh and texture in the document, as Drake's client sends them.
        unique: number of different meshes and textures.
        side: width and height of the textures, pixels.
        rows: rows and columns of quads of each sphere.
    """
    rng = np.random.default_rng(7)
    names = ("accessors", "bufferViews", "buffers", "images", "materials", "meshes", "nodes", "textures")
    document: dict[str, Any] = {"asset": {"version": "2.0", "generator": "Drake glTF merger"}}
    document |= {name: [] for name in names}
    # Drake's client sorts the members by name.
    document = dict(sorted((document | {"scene": 0, "scenes": [], "cameras": [], "samplers": [{}]}).items()))
    document["cameras"].append(
        {"perspective": {"aspectRatio": 4 / 3, "yfov": 0.8, "zfar": 10.0, "znear": 0.01}, "type": "perspective"}
    )
    textures = []
    for _ in range(unique):
        noise = rng.integers(0, 256, (side // 32, side // 32, 3), dtype=np.uint8)
        texture = cv2.resize(noise, (side, side), interpolation=cv2.INTER_CUBIC)
        encoded = cv2.imencode(".jpg", texture, (cv2.IMWRITE_JPEG_QUALITY, 64))[1]
        textures.append("data:image/jpeg;base64," + base64.b64encode(encoded.tobytes()).decode())
    meshes = [sphere(rows + index, rows) for index in range(unique)]
    for number in range(copies):
        positions, normals, uv, triangles = meshes[number % unique]
        attributes = {
            "NORMAL": accessor(document, normals, 5126, "VEC3"),
            "POSITION": accessor(document, positions, 5126, "VEC3"),
            "TEXCOORD_0": accessor(document, uv, 5126, "VEC2"),
        }
        indices = accessor(document, triangles.reshape(-1), 5125, "SCALAR")
        document["images"].append({"mimeType": "image/jpeg", "uri": textures[number % unique]})
        document["textures"].append({"sampler": 0, "source": number})
        pbr = {"baseColorTexture": {"index": number}, "metallicFactor": 0.0, "roughnessFactor": 0.6}
        document["materials"].append({"pbrMetallicRoughness": pbr})
        primitive = {"attributes": attributes, "indices": indices, "material": number}
        document["meshes"].append({"primitives": [primitive]})
        position = [1.1 * (number % 4) - 1.65, 1.1 * (number // 4) - 1.1, -4.0]
        matrix = [*np.eye(4).ravel()[:12], *position, 1.0]
        document["nodes"].append({"mesh": number, "name": f"ball{number}", "matrix": matrix})
    document["nodes"].append({"camera": 0, "name": "Camera Node", "matrix": [*np.eye(4).ravel()]})
    document["scenes"].append({"nodes": list(range(copies + 1))})
    return RenderScene.of_document("25 MB" if rows == 100 else f"{copies} textured spheres", fields_for(kind), document)
