#!/usr/bin/env bash
# Package: newton 1.8.0, beside MuJoCo 4.0.0.
# Wrong belief: newton reads joints, inertias and copies wherever MJCF allows them; what it does not know gives a warning.
# Behaviour: it looks for <joint>, <freejoint> and <inertial> among the children of a <body> only, not in a <frame> there, whose
#   geoms it does read. It passes over <replicate>. Neither has a warning.
# Why it matters: such a body is fixed to its parent, a body's mass is that of its geoms, and copies are missing, while the
#   picture of the rest is right.
# Seen 2026-12-01: of two hinges newton has the one outside of the frame; a mass of 5 kg is 8 kg; of three posts there is none.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check newton==1.8.0 warp-lang==1.19.0 numpy==2.4.6 lxml==6.1.3 \
  mujoco==4.0.0 mujoco-core==4.0.0 mujoco-studio==4.0.0 \
  glfw==2.11.0 PyOpenGL==3.1.10 websockets==17.4
WARP_CACHE_PATH="$folder/cache" venv/bin/python - <<'PYTHON'
import warnings

import mujoco
import newton

MODEL = """
<mujoco>
  <worldbody>
    <body name="door"><joint name="hinge" axis="0 0 1"/><geom size="0.1"/></body>
    <body name="lid">
      <frame pos="1 0 0" euler="90 0 0">
        <joint name="framed" axis="0 0 1"/>
        <inertial pos="0 0 0" mass="5" diaginertia="1 1 1"/>
        <geom type="box" size="0.1 0.1 0.1"/>
      </frame>
    </body>
    <replicate count="3" offset="1 0 0"><body name="post"><geom size="0.1"/></body></replicate>
  </worldbody>
</mujoco>
"""
model = mujoco.MjModel.from_xml_string(MODEL)
assert model.njnt == 2 and model.nbody == 1 + 5
assert model.body("lid").mass[0] == 5
builder = newton.ModelBuilder()
warnings.simplefilter("error")
builder.add_mjcf(MODEL)
lid = next(index for index, label in enumerate(builder.body_label) if label.endswith("lid"))
print(builder.body_label, builder.joint_type, builder.body_mass)
assert [label.rpartition("/")[2] for label in builder.body_label] == ["door", "lid"]
assert [builder.joint_type[index] for index in (0, lid)] == [newton.JointType.REVOLUTE, newton.JointType.FIXED]
assert abs(builder.body_mass[lid] - 8) < 1e-4
PYTHON
