#!/usr/bin/env bash
# Package: newton 1.8.0, beside MuJoCo 4.0.0.
# Wrong belief: newton moves a body with several joints as MuJoCo does, in the order of the MJCF file, each about its own place.
# Behaviour: it joins them to one D6 joint, whose slides come before its hinges, in the joint's values too, and which is at the
#   place of the first one.
# Why it matters: values of MuJoCo (a keyframe, a recording, an action) turn a body by what should slide it, without an error.
# Seen 2026-12-01: a hinge about x and then a slide along y, at 0.7 rad and 0.4 m, is a slide of 0.7 m and a turn of 0.4 rad; of
#   two hinges at different places the body is 12 cm away.
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

BODY = '<mujoco><worldbody><body name="a">{}<geom type="box" size="0.1 0.2 0.3"/></body></worldbody></mujoco>'
HINGE_THEN_SLIDE = BODY.format('<joint axis="1 0 0"/><joint type="slide" axis="0 1 0"/>')
TWO_PLACES = BODY.format('<joint axis="0 1 0" pos="0.5 0 0"/><joint axis="1 0 0" pos="0 0.3 0"/>')


def position(xml):
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.qpos[:] = 0.7, 0.4
    mujoco.mj_kinematics(model, data)
    return data.xpos[1].round(3)


def position_in_newton(xml):
    builder = newton.ModelBuilder()
    builder.add_mjcf(xml)
    model = builder.finalize(device="cpu")
    model.joint_q.assign([0.7, 0.4])
    state = model.state()
    newton.eval_fk(model, model.joint_q, model.joint_qd, state)
    return state.body_q.numpy()[0, :3].round(3)


for xml in (HINGE_THEN_SLIDE, TWO_PLACES):
    print("MuJoCo", position(xml), "newton", position_in_newton(xml))
assert np.allclose(position(HINGE_THEN_SLIDE), (0, 0.306, 0.258))
assert np.allclose(position_in_newton(HINGE_THEN_SLIDE), (0, 0.7, 0))
assert np.linalg.norm(position(TWO_PLACES) - position_in_newton(TWO_PLACES)) > 0.1
PYTHON
