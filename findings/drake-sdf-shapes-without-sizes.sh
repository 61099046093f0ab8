#!/usr/bin/env bash
# Package: drake 1.51.1 (1.58.0 does the same, but needs Python 3.12 or newer).
# Wrong belief: a shape without its size is an error, as in a URDF file.
# Behaviour: in SDF it gets the size of the specification's default without a warning: 1 m, a sphere the radius 1 m.
# Why it matters: a forgotten or empty element makes a box of 1 m around a gripper, in pictures and in contact.
# Seen 2026-11-29: a sphere of 1 m and a box of 1 m from SDF, an error from URDF, no warning.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check drake==1.51.1

venv/bin/python - 2>warnings.txt <<'PYTHON'
from pydrake.geometry import SceneGraph
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

SDF = '<sdf version="1.9"><model name="m"><link name="l"><visual name="v"><geometry>{}</geometry></visual></link></model></sdf>'
URDF = '<robot name="m"><link name="l"><visual><geometry>{}</geometry></visual></link></robot>'


def shapes(text, kind):
    plant, scene_graph = MultibodyPlant(0.001), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    Parser(plant).AddModelsFromString(text, kind)
    inspector = scene_graph.model_inspector()
    return [inspector.GetShape(each) for each in inspector.GetAllGeometryIds()]


(sphere,), (box,) = shapes(SDF.format("<sphere/>"), "sdf"), shapes(SDF.format("<box/>"), "sdf")
print(sphere.radius(), box.size())
assert sphere.radius() == 1.0 and list(box.size()) == [1.0, 1.0, 1.0]
try:
    shapes(URDF.format("<sphere/>"), "urdf")
except RuntimeError as error:
    print(error)
else:
    raise AssertionError("URDF takes it, too")
PYTHON
if grep -i "radius\|size" warnings.txt; then exit 1; fi
