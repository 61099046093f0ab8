#!/usr/bin/env bash
# Package: kinpy 0.6.1; mujoco 4.0.0 beside it.
# Wrong belief: kinpy reads the poses of bodies of MJCF files, since it places their links.
# Behaviour: it reads their positions and quaternions. A body with euler, axisangle, xyaxes or zaxis is not turned.
# Why it matters: most MJCF files have euler. The chain is built without a warning, and its links are elsewhere.
# Seen 2026-11-30: a tip 1 m along y of a body that is turned by 90 degrees about x is at (0, 1, 0), in MuJoCo at
#   (0, 0, 1); with the same turn as quat, both are at (0, 0, 1).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check kinpy==0.6.1 mujoco==4.0.0
venv/bin/python - <<'PYTHON'
import kinpy
import mujoco
import numpy as np

MODEL = """
<mujoco>
  <worldbody>
    <body name="arm" {turn}>
      <joint name="turn" type="hinge" axis="0 0 1"/>
      <geom type="sphere" size="0.1"/>
      <body name="tip" pos="0 1 0"><geom type="sphere" size="0.1"/></body>
    </body>
  </worldbody>
</mujoco>"""
TURNS = {
    "euler": 'euler="90 0 0"',
    "axisangle": 'axisangle="1 0 0 90"',
    "xyaxes": 'xyaxes="1 0 0 0 0 1"',
    "zaxis": 'zaxis="0 -1 0"',
    "quat": 'quat="0.70710678 0.70710678 0 0"',
}
for name, turn in TURNS.items():
    text = MODEL.format(turn=turn)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    poses = kinpy.build_chain_from_mjcf(text).forward_kinematics({"turn": 0.0})
    by_kinpy = next(pose.pos for link, pose in poses.items() if "tip" in link)
    by_mujoco = data.body("tip").xpos
    print(name, "kinpy", np.round(by_kinpy, 4), "MuJoCo", np.round(by_mujoco, 4))
    assert np.allclose(by_mujoco, (0, 0, 1), atol=1e-6)
    assert np.allclose(by_kinpy, (0, 0, 1) if name == "quat" else (0, 1, 0), atol=1e-6)
PYTHON
