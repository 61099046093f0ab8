#!/usr/bin/env bash
# Package: yourdfpy 0.0.60.
# Wrong belief: a URDF file that is read and written again has the same joints.
# Behaviour: <mimic> is read and followed (the finger moves with its leader), but the written file has none.
# Why it matters: the second finger of a gripper stands still in each file that went through a round trip.
# Seen 2026-11-29: the finger is at -0.25, the written file has no mimic.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check yourdfpy==0.0.60

cat >gripper.urdf <<'URDF'
<robot name="gripper">
  <link name="palm"/><link name="left"/><link name="right"/>
  <joint name="left" type="prismatic">
    <parent link="palm"/><child link="left"/><axis xyz="1 0 0"/><limit lower="0" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="right" type="prismatic">
    <parent link="palm"/><child link="right"/><axis xyz="-1 0 0"/><limit lower="0" upper="1" effort="1" velocity="1"/>
    <mimic joint="left"/>
  </joint>
</robot>
URDF
venv/bin/python - <<'PYTHON'
from yourdfpy import URDF

robot = URDF.load("gripper.urdf")
robot.update_cfg({"left": 0.25})
x = float(robot.get_transform("right", "palm")[0, 3])
robot.write_xml_file("written.urdf")
written = open("written.urdf").read()
again = URDF.load("written.urdf")
print(x, "mimic" in written, robot.num_actuated_joints, again.num_actuated_joints)
assert x == -0.25
assert "mimic" not in written
assert (robot.num_actuated_joints, again.num_actuated_joints) == (1, 2)
PYTHON
