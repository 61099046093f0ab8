#!/usr/bin/env bash
# Package: gmsh 4.15.2; it needs the system's libGLU.
# Wrong belief: STL has triangles only, so that Gmsh cuts the quadrangles of a mesh into two, whatever their order.
# Behaviour: it cuts those of order 1 into two. Of those of order 2 and higher, complete or incomplete, it writes one
#   triangle, which is half of each. OBJ files get the nodes of order 2 as corners in Gmsh's own order: first the corners, then
#   the middles of the edges; the outline crosses itself.
# Why it matters: orders above 1 are usual for finite elements; a surface that is checked in Gmsh reaches CAD programs,
#   simulators and printers with every second triangle missing, without a message.
# Seen 2026-11-30: a unit square of 78 quadrangles has an area of 1 in the STL file of order 1, of 0.50 in that of order 2;
#   triangles of order 2 keep the whole area.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check gmsh==4.15.2 numpy==2.4.6
venv/bin/python - <<'PYTHON'
import gmsh
import numpy as np

gmsh.initialize()
gmsh.option.setNumber("General.Terminal", 0)


def stl_area(order: int) -> float:
    gmsh.model.mesh.setOrder(order)
    gmsh.write("surface.stl")
    with open("surface.stl") as file:
        words = [line.split()[1:] for line in file if line.split()[0] == "vertex"]
    a, b, c = np.array(words, float).reshape(-1, 3, 3).transpose(1, 0, 2)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


areas = {}
for recombine in (0, 1):
    gmsh.clear()
    gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
    gmsh.model.occ.synchronize()
    gmsh.option.setNumber("Mesh.RecombineAll", recombine)
    gmsh.model.mesh.generate(2)
    kind = "quadrangles" if recombine else "triangles"
    for order in (1, 2, 3):
        areas[kind, order] = stl_area(order)
        print(f"{kind} of order {order}: area {areas[kind, order]:.2f}")
    gmsh.model.mesh.setOrder(2)
    gmsh.write(f"{kind}.obj")

with open("quadrangles.obj") as file:
    lines = [line.split() for line in file]
points = np.array([line[1:] for line in lines if line[0] == "v"], float)
outlines = [points[np.array(line[1:], int) - 1] for line in lines if line[0] == "f"]
area = sum(abs(np.cross(p, np.roll(p, -1, axis=0)).sum(axis=0)[2]) / 2 for p in outlines)
print(f"outlines in the OBJ file of order 2: {len(outlines[0])} corners, area {area:.2f}")
assert all(abs(areas["triangles", order] - 1) < 0.01 for order in (1, 2, 3))
assert abs(areas["quadrangles", 1] - 1) < 0.01
assert all(0.4 < areas["quadrangles", order] < 0.6 for order in (2, 3))
assert abs(area - 1) > 0.1
PYTHON
