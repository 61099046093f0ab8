#!/usr/bin/env bash
# Package: mujoco 4.0.0.
# Wrong belief: a model that MuJoCo saves (MjSpec.to_xml, mj_saveLastXML) has its bodies where they were, as far as a float64 goes.
# Behaviour: numbers have six digits in all, whatever is before the point: the step is 10 m at 5,000,000 m, 1 cm at 1 km.
# Why it matters: a cell in coordinates of a hall or of a map comes back with its parts moved against each other.
# Seen 2026-11-30: two bodies 2 mm apart at x = 1234.567 m are at the same place in the saved file, x = 1234.57 m.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check mujoco==4.0.0
venv/bin/python - <<'PYTHON'
import mujoco

SOURCE = """
<mujoco>
  <worldbody>
    <body pos="1234.567 0 0"><geom size="0.1"/></body>
    <body pos="1234.569 0 0"><geom size="0.1"/></body>
  </worldbody>
</mujoco>"""
model = mujoco.MjModel.from_xml_string(SOURCE)
mujoco.mj_saveLastXML("saved.xml", model)
spec = mujoco.MjSpec.from_string(SOURCE)
spec.compile()
for saved in (mujoco.MjModel.from_xml_path("saved.xml"), mujoco.MjModel.from_xml_string(spec.to_xml())):
    print("x:", model.body_pos[1:, 0], "saved:", saved.body_pos[1:, 0])
    assert model.body_pos[1:, 0].tolist() == [1234.567, 1234.569]
    assert saved.body_pos[1:, 0].tolist() == [1234.57, 1234.57]
PYTHON
