#!/usr/bin/env bash
# Package: vtk 9.7.2, through pyvista 0.49.1.
# Wrong belief: a red box that is exported to OBJ is as opaque in other programs as in the window.
# Behaviour: the MTL file says `Tr 1` for an opaque material. Tr is the transparency, 1 - d: 1 is invisible.
# Why it matters: readers that follow Tr draw nothing at all; those that ignore it hide the slip.
# Seen 2026-11-29: opacity 1.0 is written as Tr 1, opacity 0.25 as Tr 0.25, never a d.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check pyvista==0.49.1 vtk==9.7.2

venv/bin/python - <<'PYTHON'
import pyvista

for opacity in (1.0, 0.25):
    plotter = pyvista.Plotter(off_screen=True)
    plotter.add_mesh(pyvista.Cube(), color="red", opacity=opacity)
    plotter.export_obj("box.obj")
    statements = [line.split() for line in open("box.mtl") if line.strip()]
    (transparency,) = [float(words[1]) for words in statements if words[0] == "Tr"]
    print(f"opacity {opacity} is written as Tr {transparency:g}")
    assert transparency == opacity
    assert not [words for words in statements if words[0] == "d"]
PYTHON
