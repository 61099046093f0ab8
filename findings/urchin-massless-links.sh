#!/usr/bin/env bash
# Package: urchin 0.0.30.
# Wrong belief: a link without <inertial> has no mass, as the URDF specification says, and stays so in a saved copy.
# Behaviour: it gets 1 kg and a unit inertia, which the saved file has as if it had been measured.
# Why it matters: the frames of tools and sensors are links without a mass; a robot that was read and saved once is
#   heavier by a kilogram for each of them, in every simulator.
# Seen 2026-11-29: masses 1.0 and 1.0, in memory and in the written file.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check urchin==0.0.30

cat >robot.urdf <<'URDF'
<robot name="robot">
  <link name="base"/>
  <link name="camera_frame"/>
  <joint name="mount" type="fixed"><parent link="base"/><child link="camera_frame"/></joint>
</robot>
URDF
venv/bin/python - <<'PYTHON'
import xml.etree.ElementTree as ElementTree

from urchin import URDF

robot = URDF.load("robot.urdf")
robot.save("saved.urdf")
masses = [link.inertial.mass for link in robot.links]
saved = [float(mass.get("value")) for mass in ElementTree.parse("saved.urdf").iter("mass")]
print(masses, saved)
assert masses == saved == [1.0, 1.0]
PYTHON
