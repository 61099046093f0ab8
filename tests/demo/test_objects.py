"""The demo scene, object by object: sizes, materials, textures and motion are those of ``objects.json``.

After a change on purpose, write the file again: ``python -m tests.demo.test_objects``.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway import demo
from gateway.scene.draw.flatten import flatten
from gateway.scene.draw.meshing import meshes_of
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.nodes import Node
from renderers.drawlist import Material, Mesh, Texture
from tests.support.bounds import scene_bounds

FILE = Path(__file__).with_name("objects.json")
TIMES = (0.0, 1.3, 4.1)


def rounded(values: Any, digits: int = 4) -> Any:
    return (np.round(np.asarray(values, np.float64), digits) + 0.0).tolist()


def texture(value: Texture | None) -> Any:
    if value is None:
        return None
    pixels = value.image.decode()
    height, width = pixels.shape[0] // 4, pixels.shape[1] // 4
    blocks = pixels[: 4 * height, : 4 * width].reshape(4, height, 4, width, -1)
    return {"shape": list(pixels.shape), "means": rounded(blocks.mean(axis=(1, 3)), 1)}


def material(value: Material) -> dict[str, Any]:
    return {
        "color": rounded(value.base_color),
        "metallic": value.metallic,
        "roughness": value.roughness,
        "emissive": rounded(value.emissive),
        "double_sided": value.double_sided,
        "alpha_mode": value.alpha_mode.value,
        "texture": texture(value.base_color_texture),
    }


def weighted_sum(rows: Any) -> Any:
    """Return a sum that depends on the order of the rows."""
    return (1 + np.arange(len(rows)) % 13) @ rows.astype(np.float64)


def mesh(value: Mesh) -> dict[str, Any]:
    arrays = {"positions": value.positions, "normals": value.normals, "uv": value.uv0, "colors": value.colors}
    sums = {name: rounded(weighted_sum(array), 2) for name, array in arrays.items() if array is not None}
    elements = rounded(weighted_sum(value.elements), 0)
    return {"vertices": len(value.positions), "count": len(value.elements), "elements": elements, **sums}


def part(value: Part) -> dict[str, Any]:
    box = scene_bounds(flatten(Node((value,))))
    return {
        "shape": type(value.shape).__name__,
        "box": None if box is None else rounded(box),
        "material": material(value.material),
        "meshes": [mesh(each) for each, _, _ in meshes_of(value.shape, value.material)],
    }


def described() -> dict[str, Any]:
    parts = {"/".join(map(str, path)): [part(each) for each in parts] for path, parts in demo.scene_parts().items()}
    poses = {
        str(time): {"/".join(map(str, path)): rounded(pose, 6) for path, pose in demo.poses(time).items()}
        for time in TIMES
    }
    return {"parts": parts, "poses": poses}


def read() -> dict[str, Any]:
    result: dict[str, Any] = {"parts": {}, "poses": {}}
    for kind, key, row in json.loads(FILE.read_text()) if FILE.exists() else ():
        if kind == "parts":
            result[kind].setdefault(key, []).append(row)
        else:
            result[kind].setdefault(key, {})[row[0]] = row[1]
    return result


EXPECTED = read()


@pytest.fixture(scope="module")
def scene() -> dict[str, Any]:
    described_as_json: dict[str, Any] = json.loads(json.dumps(described()))
    return described_as_json


def test_the_same_objects(scene: dict[str, Any]) -> None:
    assert list(scene["parts"]) == list(EXPECTED["parts"])


@pytest.mark.parametrize("path", EXPECTED["parts"])
def test_parts(scene: dict[str, Any], path: str) -> None:
    assert scene["parts"][path] == EXPECTED["parts"][path]


@pytest.mark.parametrize("time", EXPECTED["poses"])
def test_motion(scene: dict[str, Any], time: str) -> None:
    assert scene["poses"][time] == EXPECTED["poses"][time]


def write() -> None:
    """Write the file with a part or pose a line."""
    lines = []
    for kind, entries in described().items():
        for key, values in entries.items():
            rows = values if isinstance(values, list) else values.items()
            lines += [json.dumps([kind, key, row]) for row in rows]
    FILE.write_text("[\n" + ",\n".join(lines) + "\n]\n")


if __name__ == "__main__":
    write()
