#!/usr/bin/env bash
# Package: open3d 0.20.0.
# Wrong belief: depth by RaycastingScene.create_rays_pinhole, made a point cloud with the same intrinsic matrix, lies where
#   the rays hit.
# Behaviour: the ray of the first pixel passes (0.5, 0.5), as if (0, 0) were its corner. create_from_depth_image, of
#   open3d.geometry as of open3d.t.geometry, takes (0, 0) for its middle. Points lie half a pixel to the left and above.
# Why it matters: simulated depth is compared with a camera's, or registered with its model, by these two functions. The
#   error grows with depth, 0.9 mm a metre with a focal length of 570 pixels, and looks like a wrong calibration. A matrix
#   for the one needs its principal point moved by half a pixel for the other.
# Seen 2026-11-30: all points of a ball lie 0.5 pixels beside the places where their rays hit it, along x and along y.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check open3d==0.20.0 libusb-package==1.0.30.0
# Open3D needs libusb-1.0, also without a camera.
ln -s "$(venv/bin/python -c 'import libusb_package; print(libusb_package.get_library_path())')" libusb-1.0.so.0

LD_LIBRARY_PATH=$folder venv/bin/python - <<'PYTHON'
import numpy as np
import open3d

width, height, focal_length = 64, 48, 50.0
matrix = np.array(((focal_length, 0.0, 32.0), (0.0, focal_length, 24.0), (0.0, 0.0, 1.0)))
ball = open3d.geometry.TriangleMesh.create_sphere(0.5).translate((0.0, 0.0, 2.0))
scene = open3d.t.geometry.RaycastingScene()
scene.add_triangles(open3d.t.geometry.TriangleMesh.from_legacy(ball))
rays = scene.create_rays_pinhole(open3d.core.Tensor(matrix), open3d.core.Tensor(np.eye(4)), width, height)
lengths, directions = scene.cast_rays(rays)["t_hit"].numpy(), rays.numpy()[..., 3:]
is_hit = np.isfinite(lengths)
hits = lengths[is_hit][:, None] * directions[is_hit]  # the camera is at the origin
depth = np.zeros((height, width), np.float32)
depth[is_hit] = hits[:, 2]

clouds = {
    "open3d.geometry": np.asarray(
        open3d.geometry.PointCloud.create_from_depth_image(
            open3d.geometry.Image(depth),
            open3d.camera.PinholeCameraIntrinsic(width, height, matrix),
            depth_scale=1.0,
            depth_trunc=10.0,
        ).points
    ),
    "open3d.t.geometry": open3d.t.geometry.PointCloud.create_from_depth_image(
        open3d.t.geometry.Image(depth), open3d.core.Tensor(matrix), depth_scale=1.0, depth_max=10.0
    ).point.positions.numpy(),
}
for name, points in clouds.items():
    pixels = (points - hits)[:, :2] / hits[:, 2:] * focal_length
    print(f"{name}: {pixels.min(axis=0).round(3)} to {pixels.max(axis=0).round(3)} pixels beside the hits")
    assert len(points) == len(hits) > 100
    assert np.abs(pixels + 0.5).max() < 1e-3
PYTHON
