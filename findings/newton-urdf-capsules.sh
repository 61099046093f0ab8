#!/usr/bin/env bash
# Package: newton 1.8.0, beside MuJoCo 4.0.0.
# Wrong belief: a capsule of a URDF file has the length that it says.
# Behaviour: newton reads `height` of <capsule>; MuJoCo reads `length`, as newton itself does of <cylinder>. Without `height` it
#   is 1 m, without a warning.
# Why it matters: arms are collided with capsules that are much too long or too short, and links without <inertial> get their mass.
# Seen 2026-12-01: a capsule of 4 m has 1 m; so has one of 10 cm.
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

LINK = """<robot name="r"><link name="a">
  <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><geometry><{} radius="0.05" length="{}"/></geometry></collision>
</link></robot>"""
warnings.simplefilter("error")


def half_lengths(shape, length):
    xml = LINK.format(shape, length)
    builder = newton.ModelBuilder()
    builder.add_urdf(xml)
    return mujoco.MjModel.from_xml_string(xml).geom_size[0, 1], builder.shape_scale[0][1]


for shape, length in (("cylinder", 4), ("capsule", 4), ("capsule", 0.1)):
    in_mujoco, in_newton = half_lengths(shape, length)
    print(shape, length, "MuJoCo", 2 * in_mujoco, "newton", 2 * in_newton)
    assert in_mujoco == 0.5 * length
    assert in_newton == (0.5 * length if shape == "cylinder" else 0.5)
PYTHON
