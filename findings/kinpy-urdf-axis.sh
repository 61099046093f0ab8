#!/usr/bin/env bash
# Package: kinpy 0.6.1; ikpy 4.2.1 beside it.
# Wrong belief: a joint of a URDF file without <axis> turns about x, as the specification says.
# Behaviour: kinpy turns it about z, ikpy about x. (So did pytorch_kinematics 0.10.0, which is not installed here: about z.)
# Why it matters: files whose author left the default out move differently in two programs, and no one says a word.
# Seen 2026-11-30: a tip at (0, 1, 0) behind a joint at 90 degrees is at (-1, 0, 0) in kinpy, at (0, 0, 1) in ikpy.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check kinpy==0.6.1 ikpy==4.2.1

cat >robot.urdf <<'URDF'
<robot name="robot">
  <link name="base"/>
  <link name="arm"/>
  <link name="tip"/>
  <joint name="turn" type="revolute">
    <parent link="base"/><child link="arm"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/>
  </joint>
  <joint name="mount" type="fixed"><parent link="arm"/><child link="tip"/><origin xyz="0 1 0"/></joint>
</robot>
URDF
venv/bin/python - <<'PYTHON'
import math
from pathlib import Path

import kinpy
import numpy as np
from ikpy.chain import Chain

angle = math.pi / 2
by_kinpy = kinpy.build_chain_from_urdf(Path("robot.urdf").read_text()).forward_kinematics({"turn": angle})["tip"].pos
chain = Chain.from_urdf_file("robot.urdf", base_elements=["base"], active_links_mask=[False, True, False])
by_ikpy = chain.forward_kinematics([0, angle, 0])[:3, 3]
print("kinpy", np.round(by_kinpy, 6), "ikpy", np.round(by_ikpy, 6))
assert np.allclose(by_kinpy, (-1, 0, 0))
assert np.allclose(by_ikpy, (0, 0, 1))
PYTHON
