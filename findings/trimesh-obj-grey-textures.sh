#!/usr/bin/env bash
# Package: trimesh 5.2.0; read with vtk 9.7.2.
# Wrong belief: a mesh with an image has the image's colours in the OBJ file that it is exported to.
# Behaviour: beside `map_Kd` the MTL file has trimesh's grey default as `Kd 0.4`. Readers multiply both, as VTK, Drake and three.js;
#   trimesh itself shows the image alone, so a round trip hides it.
# Why it matters: textured robots and scans get 40 % of their brightness in simulators, from a file that looks right in trimesh.
# Seen 2026-11-29: Kd 0.4 0.4 0.4; VTK's actor has a texture and the diffuse colour 0.4.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 pillow==13.0.0 trimesh==5.2.0 vtk==9.7.2

venv/bin/python - <<'PYTHON'
from pathlib import Path

import numpy as np
import trimesh
import vtk
from PIL import Image

box = trimesh.creation.box()
box.visual = trimesh.visual.TextureVisuals(uv=np.full((8, 2), 0.5), image=Image.new("RGB", (4, 4), (200, 40, 40)))
box.export("box.obj")
(kd,) = [line.split() for line in Path("material.mtl").read_text().splitlines() if line.startswith("Kd")]
window, importer = vtk.vtkRenderWindow(), vtk.vtkOBJImporter()
window.SetOffScreenRendering(True)
importer.SetFileName("box.obj")
importer.SetFileNameMTL("material.mtl")
importer.SetTexturePath(".")
importer.SetRenderWindow(window)
importer.Update()
actor = window.GetRenderers().GetFirstRenderer().GetActors().GetLastActor()
diffuse = [round(value, 3) for value in actor.GetProperty().GetDiffuseColor()]
print(kd, diffuse, actor.GetTexture() is not None)
assert [float(value) for value in kd[1:]] == diffuse == [0.4, 0.4, 0.4]
assert actor.GetTexture() is not None
PYTHON
