#!/usr/bin/env bash
# Package: aspose-3d 26.9.0, read by pycollada 0.9.3.
# Wrong belief: a COLLADA file that Aspose.3D writes keeps the colours of its materials.
# Behaviour: triangles name the material "default", nodes bind theirs to the symbol "mat0", so none is bound; and the
#   opacity of a lambert material is written as its opposite, by the rule of COLLADA 1.4.
# Why it matters: readers that follow the symbols (pycollada, trimesh, three.js) draw everything in a default grey; glTF
#   and OBJ files of the same scene are right.
# Seen 2026-11-30: symbols of triangles ['default'], bound ['mat0'], materials found [None].
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check aspose-3d==26.9.0 pycollada==0.9.3 numpy==2.4.6

DOTNET_SYSTEM_GLOBALIZATION_INVARIANT=1 venv/bin/python - <<'PYTHON'
import aspose.threed as threed
from aspose.threed.entities import Box
from aspose.threed.shading import LambertMaterial
from aspose.threed.utilities import Vector3

scene = threed.Scene()
material = LambertMaterial("green")
material.diffuse_color = Vector3(0.1, 0.8, 0.1)
scene.root_node.create_child_node("box", Box(1.0, 1.0, 1.0)).material = material
scene.save("box.dae", threed.FileFormat.COLLADA)
PYTHON
venv/bin/python - <<'PYTHON'
import xml.etree.ElementTree as ElementTree

import collada

elements = list(ElementTree.parse("box.dae").iter())
named = [each.get("material") for each in elements if each.tag.endswith("polylist")]
bound = [each.get("symbol") for each in elements if each.tag.endswith("instance_material")]
(geometry,) = collada.Collada("box.dae").scene.objects("geometry")
found = [primitive.material for primitive in geometry.primitives()]
print(named, bound, found)
assert (named, bound, found) == (["default"], ["mat0"], [None])
PYTHON
