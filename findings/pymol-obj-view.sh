#!/usr/bin/env bash
# Package: pymol-open-source 3.2.0a0 (PyMOL).
# Wrong belief: an OBJ file has what is seen, in the coordinates of the molecule, as the COLLADA file of the same scene has.
# Behaviour: an OBJ file is turned as the camera is. Spheres are one triangle each, whose corners are all at the atom; sticks are not
#   in the file at all. COLLADA files have all of these, in the molecule's coordinates, whatever the view.
# Why it matters: two OBJ files of one molecule do not fit each other, nor its COLLADA file, once the mouse has moved; and a model of
#   balls and sticks is an empty file.
# Seen 2026-12-01: the surface of benzene, 3.6 high in z, is 6.5 high in the OBJ file after `turn x, 90`, and as before in COLLADA;
#   spheres are 12 triangles without an area; there are 0 triangles of sticks, but 21 meshes in COLLADA.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 pymol-open-source==3.2.0a0

venv/bin/python - <<'PYTHON'
from xml.etree import ElementTree

import numpy as np
from pymol import cmd


def obj(name):
    rows = [line.split() for line in open(name)]
    vertices = np.array([row[1:4] for row in rows if row[:1] == ["v"]], float).reshape(-1, 3)
    faces = [[int(word.split("/")[0]) - 1 for word in row[1:]] for row in rows if row[:1] == ["f"]]
    return vertices[np.array(faces, int).reshape(-1, 3)]


def dae_height(name):
    geometries = ElementTree.parse(name).findall(".//{*}geometry")
    arrays = [g.find(".//{*}float_array").text for g in geometries]
    return round(float(np.ptp(np.concatenate([np.array(a.split(), float).reshape(-1, 3) for a in arrays])[:, 2])), 1)


heights = []
for angle in (0, 90):
    cmd.reinitialize()
    cmd.fragment("benzene")
    cmd.show_as("surface")
    cmd.turn("x", angle)
    cmd.save("surface.obj")
    cmd.save("surface.dae")
    heights.append((round(float(np.ptp(obj("surface.obj")[..., 2])), 1), dae_height("surface.dae")))
print("heights in OBJ and COLLADA, before and after a turn:", heights)
assert heights == [(3.6, 3.6), (6.5, 3.6)]

cmd.show_as("spheres")
cmd.save("spheres.obj")
triangles = obj("spheres.obj")
areas = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1) / 2
cmd.show_as("sticks")
cmd.save("sticks.obj")
cmd.save("sticks.dae")
sticks = ElementTree.parse("sticks.dae").findall(".//{*}geometry")
print(len(triangles), "triangles of spheres, area", areas.sum(), "and", len(obj("sticks.obj")), "of sticks; COLLADA:", len(sticks))
assert len(triangles) == 12 and areas.sum() == 0.0
assert len(obj("sticks.obj")) == 0 and len(sticks) > 12
PYTHON
