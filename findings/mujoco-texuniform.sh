#!/usr/bin/env bash
# Package: mujoco 4.0.0; its renderer needs EGL, in software, too (Mesa).
# Wrong belief: with texuniform="true" a texture is repeated texrepeat times over one spatial unit, so once a metre for 1.
# Behaviour: once over two metres: the factor is the half size of the plane. Most floors of dm_control and robosuite are
#   such planes.
# Why it matters: a floor made elsewhere from the same numbers has squares of half the size, by which people judge speed and size.
# Seen 2026-11-30: a checker texture of 2 by 2 squares, texrepeat 1: squares of 1.0 m, 6 along 6 m.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check mujoco==4.0.0
MUJOCO_GL=egl venv/bin/python - <<'PYTHON'
import mujoco
import numpy as np

model = mujoco.MjModel.from_xml_string("""
<mujoco>
  <visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual>
  <statistic extent="6"/>
  <asset>
    <texture name="squares" type="2d" builtin="checker" rgb1="1 0 0" rgb2="0 0 1" width="64" height="64"/>
    <material name="floor" texture="squares" texrepeat="1 1" texuniform="true"/>
  </asset>
  <worldbody><geom type="plane" size="3 3 0.1" material="floor"/></worldbody>
</mujoco>""")
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
camera = mujoco.MjvCamera()
camera.distance, camera.elevation, camera.azimuth = 20, -90, 90
renderer = mujoco.Renderer(model, 400, 400)
renderer.update_scene(data, camera)
row = renderer.render()[190].astype(int)  # beside the middle, from -x to +x
red = row[np.maximum(row[:, 0], row[:, 2]) > 100, 0] > 100  # pixels of the floor
squares = 1 + int(np.count_nonzero(np.diff(red)))
print(squares, "squares along 6 m, each", 6 / squares, "m")
assert squares == 6
PYTHON
