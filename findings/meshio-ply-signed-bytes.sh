#!/usr/bin/env bash
# Package: meshio 5.3.5; a file of trimesh 5.2.0.
# Wrong belief: a uchar of a PLY file is a number from 0 to 255, in both forms of the format.
# Behaviour: in binary files it is read as signed: 255 becomes -1, 128 becomes -128. In text files, and as uint8, which meshio itself
#   writes, it is right, so that a round trip hides it.
# Why it matters: MeshLab, VTK, Open3D and trimesh write uchar: bright colours become negative, without an error.
# Seen 2026-11-30: [255, 128, 100] is read as [-1, -128, 100] from the binary file, as it is from the text file.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check meshio==5.3.5 trimesh==5.2.0
venv/bin/python - <<'PYTHON'
import meshio
import trimesh

color = [255, 128, 100]
corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
mesh = trimesh.Trimesh(corners, [[0, 1, 2]], vertex_colors=[[*color, 255]] * 3, process=False)
found = []
for encoding in ("binary", "ascii"):
    with open(f"{encoding}.ply", "wb") as file:
        file.write(trimesh.exchange.ply.export_ply(mesh, encoding=encoding))
    data = meshio.read(f"{encoding}.ply").point_data
    found.append([int(data[channel][0]) for channel in ("red", "green", "blue")])
print("binary", found[0], "text", found[1])
assert found == [[-1, -128, 100], color]
PYTHON
