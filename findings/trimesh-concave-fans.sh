#!/usr/bin/env bash
# Package: trimesh 5.2.0.
# Wrong belief: a polygon of an OBJ or PLY file covers what it covers in the program that wrote it.
# Behaviour: polygons are triangulated as fans, also concave ones, so triangles lie outside and over each other.
# Why it matters: Blender, MeshLab and CAD programs write polygons as they are; areas, samples and images of the mesh are wrong.
# Seen 2026-11-29: an area of 4.0 for an L of three unit squares, from both formats; 3.0 if its first corner is the inner one.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 trimesh==5.2.0

venv/bin/python - <<'PYTHON'
import io

import trimesh

CORNERS = [(2, 1), (1, 1), (1, 2), (0, 2), (0, 0), (2, 0)]


def area(extension: str, corners: list[tuple[int, int]]) -> float:
    count, rows = len(corners), [f"{x} {y} 0" for x, y in corners]
    if extension == "obj":
        lines = [*(f"v {row}" for row in rows), "f " + " ".join(str(number + 1) for number in range(count))]
    else:
        header = ["ply", "format ascii 1.0", f"element vertex {count}", *(f"property float {axis}" for axis in "xyz")]
        header += ["element face 1", "property list uchar int vertex_indices", "end_header"]
        lines = [*header, *rows, " ".join(map(str, [count, *range(count)]))]
    file = io.BytesIO("\n".join([*lines, ""]).encode())
    return float(trimesh.load(file, file_type=extension, force="mesh", process=False).area)


for extension in ("obj", "ply"):
    areas = area(extension, CORNERS), area(extension, [*CORNERS[1:], CORNERS[0]])
    print(extension, areas)
    assert areas == (4.0, 3.0)
PYTHON
