#!/usr/bin/env bash
# Package: pin 4.1.0 (Pinocchio), beside mujoco 4.0.0.
# Wrong belief: the axis of a planar joint is the normal of its plane, as the URDF specification says.
# Behaviour: Pinocchio ignores the axis: the link moves in the x-y plane of the joint and turns about z. MuJoCo (and
#   Drake) turn x and y by the shortest rotation from z to the axis.
# Why it matters: the same values of the same joint give other poses, without a warning, unless the axis is z.
# Seen 2026-11-29: Pinocchio [0.1, 0.2, 0.0], MuJoCo [0.0, 0.2, -0.1].
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check pin==4.1.0 mujoco==4.0.0

cat >slider.urdf <<'URDF'
<robot name="slider">
  <link name="base"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <link name="tip"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <joint name="j" type="planar"><parent link="base"/><child link="tip"/><axis xyz="1 0 0"/></joint>
</robot>
URDF
venv/bin/python - <<'PYTHON'
import math

import mujoco
import pinocchio

x, y, angle = 0.1, 0.2, 0.3
model = pinocchio.buildModelFromUrdf("slider.urdf")
data = model.createData()
q = pinocchio.neutral(model)
q[:] = x, y, math.cos(angle), math.sin(angle)
pinocchio.framesForwardKinematics(model, data, q)
by_pinocchio = [round(float(each), 6) for each in data.oMf[model.getFrameId("tip")].translation]

model = mujoco.MjModel.from_xml_path("slider.urdf")
data = mujoco.MjData(model)
data.qpos[:] = x, y, angle
mujoco.mj_kinematics(model, data)
by_mujoco = [round(float(each), 6) for each in data.body("tip").xpos]

print("Pinocchio", by_pinocchio, "MuJoCo", by_mujoco)
assert by_pinocchio == [0.1, 0.2, 0.0]
assert by_mujoco == [0.0, 0.2, -0.1]
PYTHON
