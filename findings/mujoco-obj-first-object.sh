#!/usr/bin/env bash
# Package: mujoco 4.0.0 (3.3.7 is the same).
# Wrong belief: a mesh of an OBJ file is all of its faces, or what is left out is said.
# Behaviour: the faces of the first object or group (o, g) are drawn and weighed, the others are left out without a warning.
#   The vertices of all objects stay: contacts are those of the hull of all. Parts that only usemtl or s divides are read.
# Why it matters: Blender and CAD programs write an object or group for each part. The link of a robot is drawn in part and
#   has the mass of a part, and it touches things where nothing is drawn.
# Seen 2026-11-30: of two unit cubes 2 m apart as objects, one is left, with a mass of 1000 kg; a ball 1 m behind the other
#   is 1 m away. With usemtl instead of o, the mass is 2000 kg.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check mujoco==4.0.0
venv/bin/python - <<'PYTHON'
import warnings

import mujoco
import numpy as np

warnings.simplefilter("error")
corners = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def obj_file(keyword: str) -> bytes:
    """Return cubes from x = 0 to 1 and from 3 to 4."""
    lines = []
    for number in (0, 1):
        lines.append(f"{keyword} part{number}")
        lines += [f"v {x + 3 * number} {y} {z}" for x, y, z in corners]
        lines += ["f " + " ".join(str(index + 1 + 8 * number) for index in quad) for quad in quads]
    return "\n".join(lines).encode()


def mass_and_distance(keyword: str) -> tuple[float, float]:
    model = mujoco.MjModel.from_xml_string(
        """
<mujoco>
  <asset><mesh name="cubes" file="cubes.obj" inertia="exact"/></asset>
  <worldbody>
    <body><freejoint/><geom name="cubes" type="mesh" mesh="cubes"/></body>
    <geom name="ball" size="0.5" pos="5.5 0.5 0.5"/>
  </worldbody>
</mujoco>""",
        {"cubes.obj": obj_file(keyword)},
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    ids = (model.geom(name).id for name in ("cubes", "ball"))
    return float(model.body_mass[1]), float(mujoco.mj_geomDistance(model, data, *ids, 10.0, np.zeros(6)))


for keyword in ("o", "g", "usemtl"):
    mass, distance = mass_and_distance(keyword)
    print(f"{keyword}: mass {mass:.0f} kg, ball at {distance:.2f} m")
    assert abs(mass - (2000 if keyword == "usemtl" else 1000)) < 1
    assert abs(distance - 1.0) < 1e-3
PYTHON
