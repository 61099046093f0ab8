#!/usr/bin/env bash
# Package: trimesh 5.2.0.
# Wrong belief: a PLY file's red, green and blue are the colours of the mesh, whatever other properties there are.
# Behaviour: with texture coordinates (s t, u v, texture_u texture_v) the mesh has a grey texture material; there is no
#   texture in the file, and the colours are gone from mesh.visual (its vertex_attributes still have them).
# Why it matters: Blender 5 writes s and t beside colours by default, so its painted meshes load grey.
# Seen 2026-11-29: without s t vertex [220 40 10 255]; with them texture [102 102 102 255].
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 pillow==13.0.0 scipy==1.17.0 trimesh==5.2.0

venv/bin/python - <<'PYTHON'
import io

import trimesh


def load(coordinates: bool) -> trimesh.Trimesh:
    names = "xyzst" if coordinates else "xyz"
    header = ["ply", "format ascii 1.0", "element vertex 3", *(f"property float {name}" for name in names)]
    header += [f"property uchar {name}" for name in ("red", "green", "blue")]
    header += ["element face 1", "property list uchar int vertex_indices", "end_header"]
    rows = [f"{place}{' 0 0' * coordinates} 220 40 10" for place in ("0 0 0", "1 0 0", "0 1 0")]
    text = "\n".join([*header, *rows, "3 0 1 2", ""])
    return trimesh.load(io.BytesIO(text.encode()), file_type="ply", process=False)


plain, with_coordinates = load(False).visual, load(True).visual
print(plain.kind, plain.vertex_colors[0], with_coordinates.kind, with_coordinates.material.main_color)
assert plain.vertex_colors[0, :3].tolist() == [220, 40, 10]
assert with_coordinates.kind == "texture"
assert with_coordinates.material.main_color[:3].tolist() == [102, 102, 102]
PYTHON
