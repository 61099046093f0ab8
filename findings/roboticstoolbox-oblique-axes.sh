#!/usr/bin/env bash
# Package: roboticstoolbox-python 1.5.0.
# Wrong belief: a joint of a URDF file may have any unit vector as its axis, and leaves its link unturned at 0.
# Behaviour: a joint whose axis is not along x, y or z turns its link at 0 already, and then about another axis.
# Why it matters: legs and fingers have oblique axes. The robot stands wrongly before it moves; no warning is given.
# Seen 2026-11-30: with the axis (0.6, 0.8, 0), a link is turned by 57.3 degrees at 0, with (0, 1, 0) by none.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check roboticstoolbox-python==1.5.0
venv/bin/python - <<'PYTHON'
import math
from pathlib import Path

import numpy as np
from roboticstoolbox import Robot
from roboticstoolbox.models.URDF.URDFRobot import URDF_read


def turned_degrees(axis: str) -> float:
    path = Path("robot.urdf").absolute()
    path.write_text(
        f"""
<robot name="robot">
  <link name="base"/>
  <link name="leg"/>
  <joint name="hip" type="revolute">
    <parent link="base"/><child link="leg"/><axis xyz="{axis}"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/>
  </joint>
</robot>"""
    )
    links, name, *_ = URDF_read(str(path))
    rotation = Robot(links, name=name).fkine([0.0]).A[:3, :3]
    return math.degrees(math.acos(min(1.0, (np.trace(rotation) - 1.0) / 2.0)))


along_y, oblique = turned_degrees("0 1 0"), turned_degrees("0.6 0.8 0")
print(f"turned at 0: axis (0, 1, 0) by {along_y:.1f} degrees, (0.6, 0.8, 0) by {oblique:.1f}")
assert along_y < 1e-3
assert abs(oblique - 57.3) < 0.1
PYTHON
