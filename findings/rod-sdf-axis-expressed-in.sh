#!/usr/bin/env bash
# Package: rod 0.5.0 (its UrdfExporter; jaxsim reads SDF files through rod), beside drake 1.51.1.
# Wrong belief: an axis that an SDF file expresses in the frame of the model turns the same way in the exported URDF file.
# Behaviour: the numbers of <xyz expressed_in="…"> are written as they are, into a file whose axes are in the frame of the
#   joint. There is no warning, although rod has one for each pose that URDF cannot hold.
# Why it matters: libsdformat writes expressed_in="__model__" for each axis of an older file that has
#   <use_parent_model_frame>. Where a link is turned, its joint moves about another axis; at rest nothing is to be seen.
# Seen 2026-11-30: the door, turned by a quarter about x, has the axis 0 0 1 in place of 0 1 0; at 0.5 its edge is at
#   0.878 0.479 0 in Drake, at 0.878 0 0.479 from the exported file.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check rod==0.5.0 drake==1.51.1

cat > door.sdf <<'SDF'
<sdf version="1.9">
  <model name="door">
    <link name="frame"><inertial><mass>1</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia></inertial></link>
    <link name="leaf"><pose>0 0 0 1.5707963267948966 0 0</pose><inertial><mass>1</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia></inertial></link>
    <joint name="hinge" type="revolute">
      <parent>frame</parent><child>leaf</child>
      <axis><xyz expressed_in="__model__">0 0 1</xyz><limit><lower>-1</lower><upper>1</upper></limit></axis>
    </joint>
  </model>
</sdf>
SDF
venv/bin/python - <<'PYTHON'
import logging
from pathlib import Path

import numpy as np
import rod
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from rod.urdf.exporter import UrdfExporter

logging.getLogger("drake").setLevel(logging.ERROR)
Path("door.urdf").write_text(UrdfExporter(pretty=True).to_urdf_string(rod.Sdf.load("door.sdf")))


def edge(file: str) -> list[float]:
    """Return where the point (1, 0, 0) of the leaf is."""
    plant = MultibodyPlant(0.001)
    Parser(plant).AddModels(file)
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("frame"))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    plant.GetJointByName("hinge").set_angle(context, 0.5)
    X = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName("leaf"))
    return (X.multiply(np.array((1.0, 0.0, 0.0))) + 0.0).round(3).tolist()


print(next(line for line in Path("door.urdf").read_text().splitlines() if "<axis" in line).strip())
print("SDF", edge("door.sdf"), "URDF", edge("door.urdf"))
assert edge("door.sdf") != edge("door.urdf")
PYTHON
