#!/usr/bin/env bash
# Packages: urdf-to-mjcf 0.1.1, urdf2any 0.3.0, with MuJoCo 4.0.0.
# Wrong belief: a converter to MJCF that knows <mimic> of URDF files writes its multiplier and offset for the joint that has it.
# Behaviour: urdf-to-mjcf writes an equality constraint with the two joints swapped, so that the joint that is followed gets
#   multiplier and offset. urdf2any keeps <mimic> for USD, and writes nothing of it to MJCF, without a warning.
# Why it matters: fingers with the multiplier 1 work, so that the swap is found in the first gripper with another ratio or
#   an offset: it is pulled to angles that its URDF file forbids.
# Seen 2026-11-30: where follower = 0.1 - 2 leader holds, urdf-to-mjcf's model is off by 1.4 rad; urdf2any's has no constraint.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check urdf-to-mjcf==0.1.1 urdf2any==0.3.0 mujoco==4.0.0

cat >robot.urdf <<'URDF'
<robot name="robot">
  <link name="base">
    <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><box size="1 1 1"/></geometry></visual>
  </link>
  <link name="a">
    <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><box size="1 1 1"/></geometry></visual>
  </link>
  <link name="b">
    <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><box size="1 1 1"/></geometry></visual>
  </link>
  <joint name="leader" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/></joint>
  <joint name="follower" type="continuous">
    <parent link="base"/><child link="b"/><axis xyz="0 0 1"/>
    <mimic joint="leader" multiplier="-2" offset="0.1"/>
  </joint>
</robot>
URDF
venv/bin/urdf-to-mjcf robot.urdf --output to_mjcf/robot.xml >/dev/null
venv/bin/urdf2any robot.urdf --output any.xml >any.log 2>&1
venv/bin/python - <<'PYTHON'
from pathlib import Path

import mujoco

followed = 0.5


def equalities(path: str) -> list[float]:
    """Return how far each constraint is from being fulfilled where the URDF file's mimic holds."""
    model = mujoco.MjModel.from_xml_path(path)
    data = mujoco.MjData(model)
    data.joint("leader").qpos[0] = followed
    data.joint("follower").qpos[0] = 0.1 - 2.0 * followed
    mujoco.mj_forward(model, data)
    return [float(data.efc_pos[k]) for k in range(data.ne)]


print("urdf-to-mjcf:", equalities("to_mjcf/robot.xml"), "urdf2any:", equalities("any.xml"))
(residual,) = equalities("to_mjcf/robot.xml")
assert abs(residual - (followed - (0.1 - 2.0 * (0.1 - 2.0 * followed)))) < 1e-6
assert equalities("any.xml") == []
assert "mimic" not in Path("any.log").read_text().lower()
PYTHON
