#!/usr/bin/env bash
# Package: newton 1.8.0, beside MuJoCo 4.0.0.
# Wrong belief: a link behind a floating joint of a URDF file begins at the joint's origin, and the joint's values at 0.
# Behaviour: in newton the link begins at the robot's root. The joint keeps its origin, and its values are the inverse of it, so
#   that both cancel.
# Why it matters: objects and robots that stand at places in a scene's URDF file all begin in one spot, inside of each other.
# Seen 2026-12-01: a box with <origin xyz="1 2 3" rpy="0 0 0.5"> is at 1 2 3 in MuJoCo, at 0 0 0 in newton, whose values are
#   -1.836 -1.276 -3 and a turn by -0.5.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check newton==1.8.0 warp-lang==1.19.0 numpy==2.4.6 lxml==6.1.3 \
  mujoco==4.0.0 mujoco-core==4.0.0 mujoco-studio==4.0.0 \
  glfw==2.11.0 PyOpenGL==3.1.10 websockets==17.4
WARP_CACHE_PATH="$folder/cache" venv/bin/python - <<'PYTHON'
import mujoco
import newton
import numpy as np

ROBOT = """<robot name="scene">
  <link name="room"/>
  <link name="box">
    <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><box size="1 1 1"/></geometry></collision>
  </link>
  <joint name="free" type="floating"><parent link="room"/><child link="box"/><origin xyz="1 2 3" rpy="0 0 0.5"/></joint>
</robot>"""
in_mujoco = mujoco.MjModel.from_xml_string(ROBOT).qpos0[:3]
builder = newton.ModelBuilder()
builder.add_urdf(ROBOT)
model = builder.finalize(device="cpu")
state = model.state()
newton.eval_fk(model, model.joint_q, model.joint_qd, state)
in_newton, values = state.body_q.numpy()[1, :3], model.joint_q.numpy()
print("MuJoCo", in_mujoco, "newton", in_newton.round(3), "values", values.round(3), builder.joint_X_p[1])
assert np.allclose(in_mujoco, (1, 2, 3))
assert np.allclose(in_newton, 0, atol=1e-5) and np.allclose(np.array(builder.joint_X_p[1])[:3], (1, 2, 3))
assert np.allclose(values[:3], (-1.836, -1.276, -3), atol=1e-3)
PYTHON
