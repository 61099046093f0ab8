#!/usr/bin/env bash
# Package: newton 1.8.0, beside MuJoCo 4.0.0.
# Wrong belief: what reads `fromto` of MJCF's capsules reads it of boxes and ellipsoids too, as MuJoCo's documentation lists all four.
# Behaviour: newton passes over it for these two. The first number of `size` becomes all three half lengths, at the body's origin;
#   the mass is that of this cube.
# Why it matters: beams and bones of models become cubes at joints, with other masses, without a warning.
# Seen 2026-12-01: a beam of 1.41 m, 57 kg, is a cube of 0.2 m, 8 kg.
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
import numpy as np

warnings.simplefilter("error")
for shape in ("capsule", "cylinder", "box", "ellipsoid"):
    xml = f'<mujoco><worldbody><body><geom type="{shape}" fromto="0 0 0 1 1 0" size="0.1"/></body></worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(xml)
    builder = newton.ModelBuilder()
    builder.add_mjcf(xml)
    mass, place = builder.body_mass[0], np.array(builder.shape_transform[0])[:3]
    print(shape, "MuJoCo", model.body_mass[1].round(1), model.geom_pos[0], "newton", round(mass, 1), place.round(3))
    assert np.allclose(model.geom_pos[0], (0.5, 0.5, 0))
    if shape in ("capsule", "cylinder"):
        assert np.allclose(place, (0.5, 0.5, 0)) and np.isclose(mass, model.body_mass[1], rtol=1e-3)
    else:
        assert np.allclose(place, 0) and mass < 0.2 * model.body_mass[1]
PYTHON
