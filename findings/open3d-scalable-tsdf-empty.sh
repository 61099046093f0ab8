#!/usr/bin/env bash
# Package: open3d 0.20.0, which needs libusb-1.0 and libGL; beside it 0.19.0.
# Wrong belief: the example of RGB-D integration makes a mesh: RGBDImage with depth_scale=1 for metres, ScalableTSDFVolume.
# Behaviour: the mesh is empty, without an error. PointCloud.create_from_depth_image divides float depth, too, by its depth_scale
#   (1000 by default) since 0.20, and ignored it before. ScalableTSDFVolume seems to find its voxels by such a cloud, a
#   thousandth of the way to the surface (its source was not read). UniformTSDFVolume is not affected.
# Why it matters: reconstructions of RGB-D cameras end without a surface, and clouds from float depth are a thousand times too small.
# Seen 2026-11-30: a wall at 1.0037 m has 0 vertices with 0.20.0, 12288 with 0.19.0; its cloud is at 0.0010037 m and at 1.0037 m.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
cat > wall.py <<'PYTHON'
import numpy as np
import open3d as o3d

WIDTH, HEIGHT = 640, 480
integration = o3d.pipelines.integration
camera = o3d.camera.PinholeCameraIntrinsic(WIDTH, HEIGHT, 500, 500, 319.5, 239.5)
depth = o3d.geometry.Image(np.full((HEIGHT, WIDTH), 1.0037, np.float32))
color = o3d.geometry.Image(np.full((HEIGHT, WIDTH, 3), 128, np.uint8))
rgbd = o3d.geometry.RGBDImage.create_from_color_and_depth(color, depth, depth_scale=1, convert_rgb_to_intensity=False)

scalable = integration.ScalableTSDFVolume(0.01, 0.04, integration.TSDFVolumeColorType.RGB8)
scalable.integrate(rgbd, camera, np.eye(4))
uniform = integration.UniformTSDFVolume(2, 128, 0.05, integration.TSDFVolumeColorType.RGB8, origin=(-1, -1, 0))
uniform.integrate(rgbd, camera, np.eye(4))
vertices = [len(volume.extract_triangle_mesh().vertices) for volume in (scalable, uniform)]
z = [
    np.asarray(o3d.geometry.PointCloud.create_from_depth_image(depth, camera, **options).points)[0, 2]
    for options in ({}, {"depth_scale": 1})
]
print(o3d.__version__, "vertices", vertices, "cloud at", z)
assert vertices[1] > 1000
assert abs(z[1] - 1.0037) < 1e-6
if o3d.__version__ == "0.20.0":
    assert vertices[0] == 0
    assert abs(z[0] - 0.0010037) < 1e-9
else:
    assert vertices[0] > 1000
    assert abs(z[0] - 1.0037) < 1e-6
PYTHON
for version in 0.20.0 0.19.0; do
  python3 -m venv $version
  $version/bin/pip install --quiet --disable-pip-version-check open3d==$version
  $version/bin/python wall.py
done
