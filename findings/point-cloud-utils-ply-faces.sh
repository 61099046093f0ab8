#!/usr/bin/env bash
# Package: point-cloud-utils 0.34.0; read with plyfile 1.1.5.
# Wrong belief: values of faces are written into PLY files as those of vertices, and are there again when the file is loaded.
# Behaviour: the opacity of faces is written turned around: opaque ones get 0, vertices 255. Normals of faces are named `nx ny z`, and
#   texture coordinates of their corners `texcoords`, for `nz` and MeshLab's `texcoord`: its own reader finds neither.
# Why it matters: meshes with colours of faces are invisible where opacity counts, and lose normals and texture coordinates silently.
# Seen 2026-12-01: alpha 0 of an opaque face, 191 of one of 0.25; normals and wedge_texcoords None after loading.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 scipy==1.17.1 plyfile==1.1.5 point-cloud-utils==0.34.0

venv/bin/python - <<'PYTHON'
import numpy as np
import plyfile
import point_cloud_utils

mesh = point_cloud_utils.TriangleMesh()
mesh.vertex_data.positions = np.array([(0.0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
mesh.vertex_data.colors = np.array([(0.8, 0.2, 0.2, 1.0)] * 4)
mesh.face_data.vertex_ids = np.array([(0, 1, 2), (0, 2, 3)], np.int32)
mesh.face_data.colors = np.array([(0.8, 0.2, 0.2, 1.0), (0.2, 0.2, 0.8, 0.25)])
mesh.face_data.normals = np.array([(0.0, 0, 1)] * 2)
mesh.face_data.wedge_texcoords = np.arange(12.0).reshape(2, 3, 2) / 12
mesh.save("mesh.ply")

file = plyfile.PlyData.read("mesh.ply")
print("vertices:", file["vertex"]["alpha"].tolist(), "faces:", file["face"]["alpha"].tolist())
names = [each.name for each in file["face"].properties]
print("properties of faces:", *names)
assert file["vertex"]["alpha"].tolist() == [255] * 4
assert file["face"]["alpha"].tolist() == [0, 191]
assert names[:4] == ["vertex_indices", "nx", "ny", "z"] and names[-1] == "texcoords"
loaded = point_cloud_utils.load_triangle_mesh("mesh.ply").face_data
print("loaded again:", loaded.normals, loaded.wedge_texcoords)
assert loaded.normals is None and loaded.wedge_texcoords is None
PYTHON
