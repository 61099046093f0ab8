#!/usr/bin/env bash
# Package: drake 1.51.1 (1.58.0 does the same, but needs Python 3.12 or newer).
# Wrong belief: a pose that is relative to a link of a URDF file, which an SDF world includes, counts from where that
#   link is, as for a model that is written in SDF.
# Behaviour: it counts from the root link: the offsets of the URDF file's joints are left out. The link itself is where
#   it should be. The same robot in SDF gives the right place.
# Why it matters: tools and sensors that a world mounts on an arm stand at its base, without an error.
# Seen 2026-11-29: z of what is relative to the link: URDF 0.0, SDF 0.5; the link itself is at 0.5 in both.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check drake==1.51.1

cat >arm.urdf <<'URDF'
<robot name="arm">
  <link name="base"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <link name="tip"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <joint name="j" type="revolute">
    <parent link="base"/><child link="tip"/><origin xyz="0 0 0.5"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
</robot>
URDF
cat >arm.sdf <<'SDF'
<sdf version="1.9"><model name="arm">
  <link name="base"/>
  <link name="tip"><pose>0 0 0.5 0 0 0</pose></link>
  <joint name="j" type="revolute"><parent>base</parent><child>tip</child><axis><xyz>0 0 1</xyz></axis></joint>
</model></sdf>
SDF
for kind in urdf sdf; do
  cat >"world_$kind.sdf" <<SDF
<sdf version="1.9"><world name="w">
  <include><uri>arm.$kind</uri><name>arm</name></include>
  <model name="tool"><pose relative_to="arm::tip">0 0 0 0 0 0</pose><link name="tool"/></model>
</world></sdf>
SDF
done
venv/bin/python - <<'PYTHON'
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

heights = {}
for kind in ("urdf", "sdf"):
    plant = MultibodyPlant(0.001)
    Parser(plant).AddModels(f"world_{kind}.sdf")
    plant.Finalize()
    context = plant.CreateDefaultContext()
    for name in ("tip", "tool"):
        pose = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(name))
        heights[kind, name] = round(float(pose.translation()[2]), 6)
print(heights)
assert heights == {("urdf", "tip"): 0.5, ("urdf", "tool"): 0.0, ("sdf", "tip"): 0.5, ("sdf", "tool"): 0.5}
PYTHON
