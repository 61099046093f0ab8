#!/usr/bin/env bash
# Package: trimesh 5.2.0.
# Wrong belief: a glTF file without extensions is read as it is, or refused.
# Behaviour: the values of sparse accessors, which glTF 2.0 has without an extension, are passed over without a word: vertices keep the
#   place that they replace. An accessor without a buffer view, whose values are all sparse, is zero.
# Why it matters: glTF-Transform's sparse() writes them, and Khronos' sample SimpleSparseAccessor has one. The mesh has other bounds, volume
#   and contacts, or is a point, and nothing says why.
# Seen 2026-11-30: extents of a triangle of 2 m x 1 m: with one sparse vertex 1 x 1, with all of them sparse 0 x 0.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 trimesh==5.2.0

venv/bin/python - <<'PYTHON'
import base64
import io
import json
from typing import Any

import numpy as np
import trimesh

CORNERS = np.array([(0, 0, 0), (2, 0, 0), (0, 1, 0)], np.float32)
BASE = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], np.float32)


def extents(positions: dict[str, Any]) -> list[float]:
    """Return the extents of a triangle whose corners are an accessor with these properties."""
    data = BASE.tobytes() + CORNERS.tobytes() + np.arange(3, dtype=np.uint16).tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    accessor = {"componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [2, 1, 0]}
    document = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(data), "uri": uri}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 36},
            {"buffer": 0, "byteOffset": 72, "byteLength": 6},
        ],
        "accessors": [accessor | positions],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    scene = trimesh.load_scene(io.BytesIO(json.dumps(document).encode()), file_type="gltf")
    (mesh,) = scene.geometry.values()
    return np.ptp(mesh.vertices, axis=0)[:2].tolist()


def sparse(first: int, count: int) -> dict[str, Any]:
    """Return the sparse values of some corners."""
    indices = {"bufferView": 2, "byteOffset": 2 * first, "componentType": 5123}
    return {"count": count, "indices": indices, "values": {"bufferView": 1, "byteOffset": 12 * first}}


plain = extents({"bufferView": 1})
changed = extents({"bufferView": 0, "sparse": sparse(1, 1)})
alone = extents({"sparse": sparse(0, 3)})
print(plain, changed, alone)
assert plain == [2.0, 1.0]
assert changed == [1.0, 1.0]
assert alone == [0.0, 0.0]
PYTHON
