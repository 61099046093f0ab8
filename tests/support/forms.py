"""Render requests as forms, for tests: Drake's fields with changes, encoded as its client encodes them."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from typing import Any

BOUNDARY = "------------------------tEsTbOuNdArY0123456789"
CONTENT_TYPE = f"multipart/form-data; boundary={BOUNDARY}"

TRIANGLE_URI = "data:application/octet-stream;base64,AAAAvwAAAL8AAIC/AAAAPwAAAL8AAIC/AAAAAAAAAD8AAIC/"
"""Three float32 vertices, one metre before the camera at the origin: (-.5, -.5, -1), (.5, -.5, -1), (0, .5, -1)."""


def part(name: str, value: bytes, headers: Iterable[str] = (), *, filename: str | None = None) -> bytes:
    """One part with its opening boundary."""
    disposition = f'Content-Disposition: form-data; name="{name}"'
    if filename is not None:
        disposition += f'; filename="{filename}"'
    head = "\r\n".join((f"--{BOUNDARY}", disposition, *headers))
    return head.encode() + b"\r\n\r\n" + value + b"\r\n"


def closed(*parts: bytes) -> bytes:
    """The body of these parts."""
    return b"".join(parts) + f"--{BOUNDARY}--\r\n".encode()


def drake_fields(image_type: str = "color", **changes: str | None) -> dict[str, str]:
    """The text fields of Drake's client for a 64x48 picture, in its order; None removes one."""
    fields: dict[str, str | None] = {
        "center_x": "31.500000",
        "center_y": "23.500000",
        "far": "10.000000",
        "focal_x": "57.941125",
        "focal_y": "57.941125",
        "fov_x": "1.009191",
        "fov_y": "0.785398",
        "height": "48",
        "image_type": image_type,
        **({"max_depth": "5.000000", "min_depth": "0.100000"} if image_type == "depth" else {}),
        "near": "0.010000",
        "submit": "Render",
        "width": "64",
    }
    fields.update(changes)
    return {name: value for name, value in fields.items() if value is not None}


def body(
    scene: bytes | Mapping[str, Any] | None,
    fields: Mapping[str, str] | None = None,
    *,
    scene_headers: Iterable[str] = ("Content-Type: model/gltf+json",),
    filename: str | None = "0000000000000000001-color.gltf",
) -> bytes:
    """A whole request body; the scene's hash is added unless the fields say something about it."""
    data = json.dumps(scene).encode() if isinstance(scene, Mapping) else scene
    texts = dict(drake_fields() if fields is None else fields)
    if data is not None:
        texts.setdefault("scene_sha256", hashlib.sha256(data).hexdigest())
    parts = [part(name, value.encode()) for name, value in texts.items()]
    if data is not None:
        parts.append(part("scene", data, scene_headers, filename=filename))
    return closed(*parts)


def gltf(*, generator: str = "VTK", color: tuple[float, ...] = (1.0, 0.0, 0.0, 1.0), **changes: Any) -> dict[str, Any]:
    """A triangle before a camera at the origin, as VTK would export it; ``changes`` replace top-level properties."""
    document: dict[str, Any] = {
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "asset": {"generator": generator, "version": "2.0"},
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": TRIANGLE_URI}],
        "cameras": [
            {
                "perspective": {"aspectRatio": 1.333, "yfov": 0.785398, "zfar": 10.0, "znear": 0.01},
                "type": "perspective",
            }
        ],
        "materials": [
            {
                "pbrMetallicRoughness": {"baseColorFactor": list(color), "metallicFactor": 0, "roughnessFactor": 1},
                "doubleSided": True,
            }
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0, "mode": 4}]}],
        "nodes": [{"children": [1, 2], "name": "Renderer Node"}, {"mesh": 0}, {"camera": 0, "name": "Camera Node"}],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
    }
    document.update(changes)
    return {name: value for name, value in document.items() if value is not ...}
