"""Takes one image set from the stereo camera and turns the disparity image into points.

    python examples/stream_stereo.py [127.0.0.1:50051] [points.npy]

Works with a real rc_visard as well: give its address.
"""

import argparse

import grpc
import numpy as np

from scenegate.camera import image_interface_pb2 as pb

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("address", nargs="?", default="127.0.0.1:50051", help="host and port of the camera's gRPC server")
parser.add_argument("file", nargs="?", default="points.npy", help="file to write, (N, 3) float32, metres")
arguments = parser.parse_args()

options = [("grpc.max_receive_message_length", -1), ("grpc.enable_http_proxy", 0)]  # no proxy, whatever http_proxy says
with grpc.insecure_channel(arguments.address, options=options) as channel:
    stream = channel.unary_stream(
        "/ImageInterface/StreamImageSets",
        request_serializer=pb.ImageSetRequest.SerializeToString,
        response_deserializer=pb.ImageSet.FromString,
    )(pb.ImageSetRequest(left_enabled=True, disparity_enabled=True), timeout=30)
    images = next(iter(stream))
    stream.cancel()

disparity, image = images.disparity, images.disparity.image
raw = np.frombuffer(image.data, "<u2").reshape(image.height, image.width)
row, column = np.nonzero(raw != disparity.invalid_data_value)
d = raw[row, column] * disparity.scale + disparity.offset
# The device's manual: pixel (i, k) is sampled at its centre; the left camera's frame is x right, y down, z forward.
points = np.column_stack(
    (
        (column + 0.5 - image.principal_point_u) * disparity.baseline / d,
        (row + 0.5 - image.principal_point_v) * disparity.baseline / d,
        image.focal_length * disparity.baseline / d,
    )
)
np.save(arguments.file, points.astype(np.float32))
print(f"{images.left.width}x{images.left.height} left image, {len(points)} points, {points[:, 2].min():.2f} m nearest")
