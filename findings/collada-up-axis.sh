#!/usr/bin/env bash
# Packages: pymeshlab 2025.7.post1 (MeshLab), trimesh 5.2.0 with pycollada 0.9.3.
# Wrong belief: the up axis in a COLLADA file is that of its coordinates.
# Behaviour: both write <up_axis>Y_UP</up_axis> beside the coordinates of the mesh as they were, whatever is up in them. Both
#   ignore <up_axis> when they read, so that the slip does not show in them.
# Why it matters: meshes of robots, Z up, lie on their side in programs that follow the file.
# Seen 2026-11-29: the height of 3 along z stays along z in both files, which say Y_UP.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 pymeshlab==2025.7.post1 trimesh==5.2.0 pycollada==0.9.3 scipy==1.17.0

venv/bin/python - <<'PYTHON'
import collada
import numpy as np
import pymeshlab
import trimesh

box = trimesh.creation.box(extents=(1, 2, 3))
meshes = pymeshlab.MeshSet()
meshes.add_mesh(pymeshlab.Mesh(box.vertices, box.faces))
meshes.save_current_mesh("meshlab.dae")
open("trimesh.dae", "wb").write(trimesh.exchange.dae.export_collada(box))
for name in ("meshlab.dae", "trimesh.dae"):
    document = collada.Collada(name)
    geometries = document.scene.objects("geometry")
    vertices = np.concatenate([each.vertex for geometry in geometries for each in geometry.primitives()])
    print(name, document.assetInfo.upaxis, "extents", np.ptp(vertices, axis=0).tolist())
    assert document.assetInfo.upaxis == "Y_UP"
    assert np.allclose(np.ptp(vertices, axis=0), (1, 2, 3))
    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(name)
    for read in (meshes.current_mesh().vertex_matrix(), trimesh.load_scene(name).to_mesh().vertices):
        assert np.allclose(np.ptp(read, axis=0), (1, 2, 3))
PYTHON
