#!/usr/bin/env bash
# Package: vtk 9.7.2, through pyvista 0.49.1.
# Wrong belief: an actor with an opacity of 0.3 is half transparent in the glTF file, as it is in the window.
# Behaviour: baseColorFactor has the alpha of 0.3, but there is no alphaMode. Its default is OPAQUE, for which glTF 2.0,
#   3.9.4, says that alpha is ignored.
# Why it matters: what is seen through in ParaView and PyVista is opaque in every viewer that follows the specification.
# Seen 2026-11-29: baseColorFactor [1.0, 0.0, 0.0, 0.3], no alphaMode.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check pyvista==0.49.1 vtk==9.7.2

venv/bin/python - <<'PYTHON'
import json

import pyvista

plotter = pyvista.Plotter(off_screen=True)
plotter.add_mesh(pyvista.Cube(), color="red", opacity=0.3)
plotter.export_gltf("box.gltf")
(material,) = json.load(open("box.gltf"))["materials"]
print(material)
assert abs(material["pbrMetallicRoughness"]["baseColorFactor"][3] - 0.3) < 1e-6
assert "alphaMode" not in material
PYTHON
