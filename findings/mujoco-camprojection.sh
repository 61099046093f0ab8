#!/usr/bin/env bash
# Package: mujoco 4.0.0 from PyPI; its renderer needs EGL, as Mesa's llvmpipe has it.
# Wrong belief: the sensor camprojection of a MuJoCo camera says at which pixel of that camera's image a site is; and a
#   principal point of (20, 10) pixels lies 20 pixels right of the middle and 10 from it downwards or upwards.
# Behaviour: the sensor passes over principalpixel and principal, which the renderer applies. And the renderer moves the
#   image to the left and up by them: the principal point is (width / 2 - 20, height / 2 - 10), from the upper left corner.
# Why it matters: keypoints, labels and visual servoing by the sensor miss what is in the image by the whole offset; a
#   calibration that is written down as cx - width / 2 is rendered with the opposite sign.
# Seen 2026-11-30: without an offset, image and sensor agree within 0.1 pixels, (395, 190); with "20 10" the image has the
#   ball at (375, 180), the sensor says (395, 190).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check mujoco==4.0.0

MUJOCO_GL=egl venv/bin/python - <<'PYTHON'
import mujoco
import numpy as np

MODEL = """<mujoco>
  <visual><global offwidth="640" offheight="480"/></visual>
  <worldbody>
    <geom type="sphere" size="0.05" pos="0.3 0.2 -2"/>
    <site name="ball" pos="0.3 0.2 -2"/>
    <camera name="camera" resolution="640 480" sensorsize="0.0064 0.0048" focalpixel="500 500" principalpixel="{} {}"/>
  </worldbody>
  <sensor><camprojection site="ball" camera="camera"/></sensor>
</mujoco>"""


def positions(offset: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return the pixel of the ball in the image, and by the sensor, from the upper left corner."""
    model = mujoco.MjModel.from_xml_string(MODEL.format(*offset))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, 480, 640) as renderer:
        renderer.enable_segmentation_rendering()
        renderer.update_scene(data, "camera")
        rows, columns = np.nonzero(renderer.render()[..., 0] == 0)
    return np.array((columns.mean(), rows.mean())) + 0.5, data.sensordata.copy()


(image, sensor), (moved_image, moved_sensor) = positions((0, 0)), positions((20, 10))
print("without an offset: image", image.round(1), "sensor", sensor.round(1))
print("with (20, 10):     image", moved_image.round(1), "sensor", moved_sensor.round(1))
assert np.abs(image - sensor).max() < 0.2
assert np.abs(moved_image - image - (-20, -10)).max() < 0.1
assert np.abs(moved_sensor - sensor).max() < 0.1
PYTHON
