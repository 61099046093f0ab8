"""Shows the stereo camera's stream and the live scene in Rerun's viewer, or writes them to a file.

    pip install 'scenegate[rerun]'    # or rerun-sdk
    python examples/rerun_stream.py [127.0.0.1:50051] [http://127.0.0.1:8000] [FILE.rrd] [SETS]

Frames are those of docs/conventions.md: the world is Z-up, and the cameras' optical frames are +X right, +Y down.
"""

import io
import sys
import urllib.error
import urllib.request

import numpy as np
import rerun as rr

from scenegate.camera import Credentials, StreamOptions, depth, fetch_truth, intrinsics, pixels, receive

camera = sys.argv[1] if len(sys.argv) > 1 else "127.0.0.1:50051"
url = sys.argv[2] if len(sys.argv) > 2 else "http://127.0.0.1:8000"
sets = int(sys.argv[4]) if len(sys.argv) > 4 else 0  # 0: until it is interrupted


def log_scene(etag):
    """Log the live scene if it has changed, and return its ETag. The file is Y-up, as glTF demands."""
    try:
        request = urllib.request.Request(f"{url}/scene.glb", headers={"If-None-Match": etag})
        with urllib.request.urlopen(request) as response:
            rr.log("world/scene", rr.Asset3D(contents=response.read(), media_type="model/gltf-binary"))
            return response.headers["ETag"]
    except urllib.error.HTTPError as error:
        if error.code != 304:
            raise
        return etag


def log_image(name, message, image):
    """Log an image at the camera that it belongs to."""
    size = [message.width, message.height]
    rr.log(name, rr.Pinhole(image_from_camera=intrinsics(message), resolution=size, camera_xyz=rr.ViewCoordinates.RDF))
    rr.log(name, image)


def points_of(metres, message):
    """Return the points of a depth image in the left optical frame, (N, 3), and their rows and columns."""
    rows, columns = np.nonzero(np.isfinite(metres))
    z, f = metres[rows, columns], message.focal_length
    x = (columns + 0.5 - message.principal_point_u) * z / f
    y = (rows + 0.5 - message.principal_point_v) * z / f
    return np.column_stack((x, y, z)), rows, columns


rr.init("scenegate")
if len(sys.argv) > 3:
    rr.save(sys.argv[3])
else:
    rr.spawn()
rr.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
rr.log("world/scene", rr.Transform3D(rotation_axis_angle=rr.RotationAxisAngle([1, 0, 0], degrees=90)), static=True)
etag = ""
for images, _ in receive(StreamOptions(camera, left=True, right=True, disparity=True, color=True, count=sets)):
    stamp = f"{images.timestamp.sec}.{images.timestamp.nsec:09}"
    rr.set_time("exposure", timestamp=np.datetime64(images.timestamp.sec * 10**9 + images.timestamp.nsec, "ns"))
    truth = np.load(io.BytesIO(fetch_truth(url, stamp, Credentials())))
    for side, message in (("left", images.left), ("right", images.right)):
        pose = truth[f"X_world_{side}"]
        rr.log(f"world/{side}", rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))
        log_image(f"world/{side}/image", message, rr.Image(pixels(message)))
    metres = depth(images.disparity)
    valid = np.where(np.isfinite(metres), metres, np.float32(0))
    log_image("world/left/depth", images.disparity.image, rr.DepthImage(valid, meter=1.0))
    points, rows, columns = points_of(metres, images.disparity.image)
    factor = images.left.height // images.disparity.image.height
    rr.log("world/left/points", rr.Points3D(points, colors=pixels(images.left)[rows * factor, columns * factor]))
    etag = log_scene(etag)
