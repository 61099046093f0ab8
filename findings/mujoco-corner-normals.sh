#!/usr/bin/env bash
# Package: mujoco 4.0.0 (3.3.7 is the same); its renderer needs EGL, in software, too (Mesa).
# Wrong belief: mesh_normal and mesh_facenormal of a model have the normals with which MuJoCo draws its meshes.
# Behaviour: where a file has none, as every STL file, a vertex gets the mean of those faces that are within 36.9 degrees (a
#   cosine of 0.8) of the mean of all. Where none is, as at corners of boxes, it gets the z axis of the mesh's frame, into
#   the mesh or out of it. MuJoCo's renderer draws such corners with the normal of their face.
# Why it matters: exporters and viewers that take the normals from the model draw blotches and streaks. In models of
#   robots, whose parts are full of such corners, up to one in ten corners of triangles has a normal from behind.
# Seen 2026-11-30: of the 36 corners of a cube's triangles, 2 have a normal against their face, 20 one along it; MuJoCo's
#   renderer draws the mesh like a box, but for pixels of edges.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check mujoco==4.0.0
MUJOCO_GL=egl venv/bin/python - <<'PYTHON'
import mujoco
import numpy as np

corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
vertices = " ".join(str(number) for corner in corners for number in corner)
faces = "0 1 3 0 3 2 4 6 7 4 7 5 0 4 5 0 5 1 2 3 7 2 7 6 0 2 6 0 6 4 1 5 7 1 7 3"


def model_of(geometry: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(
        f"""
<mujoco>
  <asset><mesh name="cube" vertex="{vertices}" face="{faces}"/></asset>
  <worldbody><geom {geometry}/></worldbody>
</mujoco>"""
    )


def image(model: mujoco.MjModel) -> np.ndarray:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    camera.distance, camera.azimuth, camera.elevation = 6, 30, -30
    renderer = mujoco.Renderer(model, 120, 120)
    renderer.update_scene(data, camera)
    return renderer.render().astype(int)


model = model_of('type="mesh" mesh="cube"')
points = model.mesh_vert[model.mesh_face]
normals = model.mesh_normal[model.mesh_facenormal]
outward = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
outward /= np.linalg.norm(outward, axis=1, keepdims=True)
cosines = np.einsum("fi,fci->fc", outward, normals)
counts = int((cosines < -0.9).sum()), int((abs(cosines) < 0.1).sum()), int((cosines > 0.9).sum())
print("corners of triangles with a normal against, along and out of their face:", *counts)
differences = abs(image(model) - image(model_of('type="box" size="1 1 1"')))
print("pixels of the mesh's image that differ from a box's by more than 2 levels:", int((differences.max(axis=2) > 2).sum()))
assert counts[0] > 0
assert counts[1] > 0
assert np.percentile(differences, 99) <= 2
PYTHON
