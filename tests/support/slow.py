"""Scenes that take minutes to draw, in half a megabyte."""

import base64
import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.support import forms


def covering(triangles: int) -> NDArray[np.float32]:
    """Return the corners of triangles that each fill the view of a camera at the origin along -Z.

    Each is in front of the previous one. (3 * triangles, 3) float32.
    """
    corners = np.array([(-8, -8, -1), (24, -8, -1), (-8, 24, -1)], np.float32)
    return (corners * np.linspace(2.0, 1.0, triangles, dtype=np.float32)[:, None, None]).reshape(-1, 3)


def slow_gltf(triangles: int = 10_000, instances: int = 100, **material: Any) -> bytes:
    """Return a document of about 50 bytes per triangle."""
    raw = covering(triangles).tobytes()
    nodes: list[dict[str, Any]] = [{"mesh": 0, "translation": [0, 0, -1e-4 * number]} for number in range(instances)]
    document = forms.gltf(
        accessors=[{"bufferView": 0, "componentType": 5126, "count": 3 * triangles, "type": "VEC3"}],
        bufferViews=[{"buffer": 0, "byteLength": len(raw)}],
        buffers=[{"byteLength": len(raw), "uri": f"data:application/octet-stream;base64,{_text(raw)}"}],
        nodes=[*nodes, {"camera": 0}],
        scenes=[{"nodes": list(range(instances + 1))}],
        materials=[{"doubleSided": True, **material}],
    )
    return json.dumps(document).encode()


def slow_body(size: int = 1024, image_type: str = "color", **scene: Any) -> bytes:
    """Return a render request for such a scene, ``size`` pixels square."""
    return forms.body(slow_gltf(**scene), _square(size, image_type))


def one_pixel_body() -> bytes:
    """Return a render request that takes a millisecond."""
    return forms.body(forms.gltf(), _square(1, "color"))


def _square(size: int, image_type: str) -> dict[str, str]:
    side = str(size)
    return forms.drake_fields(
        image_type, width=side, height=side, center_x=str(size / 2), center_y=str(size / 2), focal_x=side, focal_y=side
    )


def _text(raw: bytes) -> str:
    return base64.b64encode(raw).decode()
