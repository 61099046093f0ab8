"""Takes one image set from the stereo camera and turns the disparity image into points.

    python examples/stream_stereo.py [127.0.0.1:50051] [POINTS.npy]

Works with a real rc_visard as well: give its address.
"""

import sys

import grpc
import numpy as np

from scenegate.camera import image_interface_pb2 as pb

address = sys.argv[1] if len(sys.argv) > 1 else "127.0.0.1:50051"
file = sys.argv[2] if len(sys.argv) > 2 else "points.npy"

with grpc.insecure_channel(address, options=[("grpc.max_receive_message_length", -1)]) as channel:
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
np.save(file, points.astype(np.float32))
print(f"{images.left.width}x{images.left.height} left image, {len(points)} points, {points[:, 2].min():.2f} m nearest")
