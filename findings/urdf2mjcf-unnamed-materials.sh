#!/usr/bin/env bash
# Package: urdf2mjcf 0.2.39, with MuJoCo 4.0.0.
# Wrong belief: a URDF file as the SolidWorks exporter writes it, whose materials have the name "", can be converted.
# Behaviour: the names are passed on as they are; MuJoCo refuses a material without a name. All colours of such a file
#   would share one material besides.
# Why it matters: that exporter gives every material of every robot this name; the conversion ends without a warning,
#   and the model does not load.
# Seen 2026-11-30: "empty name in material".
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check urdf2mjcf==0.2.39 mujoco==4.0.0

cat >robot.urdf <<'URDF'
<robot name="robot">
  <link name="base">
    <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual>
      <geometry><box size="1 1 1"/></geometry>
      <material name=""><color rgba="0.2 0.4 0.6 1"/></material>
    </visual>
  </link>
</robot>
URDF
venv/bin/urdf2mjcf robot.urdf --output robot.xml
venv/bin/python - <<'PYTHON'
import mujoco

try:
    mujoco.MjModel.from_xml_path("robot.xml")
except ValueError as error:
    print(error)
    assert "empty name in material" in str(error)
else:
    raise SystemExit("it loads")
PYTHON
