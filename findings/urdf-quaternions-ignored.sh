#!/usr/bin/env bash
# Packages: mujoco 4.0.0, drake 1.51.1 (1.58.0 does the same), yourdfpy 0.0.60; beside pin 4.1.0 (urdfdom 6.0).
# Wrong belief: a URDF file that ROS reads has the same poses in other programs, or is refused.
# Behaviour: URDF 1.1 has quaternions, <origin quat_xyzw="…">, in place of rpy. These three read the file and leave the link
#   unturned, without a word about the attribute; Drake says that it ignores the version. urdfdom, and Pinocchio by it, turn it.
# Why it matters: frames that a calibration measured are quaternions; converted in this way, the camera looks along another axis
#   in the simulator than on the robot.
# Seen 2026-11-30: a quarter turn about z moves the x axis of the camera to 0 1 0 in Pinocchio, to 1 0 0 in the others.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check mujoco==4.0.0 drake==1.51.1 yourdfpy==0.0.60 pin==4.1.0

cat > camera.urdf <<'URDF'
<robot name="robot" version="1.1">
  <link name="base"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <link name="camera"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <joint name="pan" type="continuous">
    <origin xyz="1 0 0" quat_xyzw="0 0 0.7071067811865476 0.7071067811865476"/>
    <parent link="base"/><child link="camera"/><axis xyz="0 0 1"/>
  </joint>
</robot>
URDF
venv/bin/python - <<'PYTHON'
import mujoco
import pinocchio
import yourdfpy
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

x_axes = {}
model = pinocchio.buildModelFromUrdf("camera.urdf")
data = model.createData()
pinocchio.framesForwardKinematics(model, data, pinocchio.neutral(model))
x_axes["Pinocchio"] = data.oMf[model.getFrameId("camera")].rotation[:, 0]

model = mujoco.MjModel.from_xml_path("camera.urdf")
data = mujoco.MjData(model)
mujoco.mj_kinematics(model, data)
x_axes["MuJoCo"] = data.body("camera").xmat.reshape(3, 3)[:, 0]

plant = MultibodyPlant(0.001)
Parser(plant).AddModels("camera.urdf")
plant.Finalize()
camera = plant.EvalBodyPoseInWorld(plant.CreateDefaultContext(), plant.GetBodyByName("camera"))
x_axes["Drake"] = camera.rotation().matrix()[:, 0]

x_axes["yourdfpy"] = yourdfpy.URDF.load("camera.urdf").get_transform("camera")[:3, 0]

x_axes = {name: (axis.round(6) + 0.0).tolist() for name, axis in x_axes.items()}
print(x_axes)
assert x_axes.pop("Pinocchio") == [0.0, 1.0, 0.0]
assert all(axis == [1.0, 0.0, 0.0] for axis in x_axes.values())
PYTHON
