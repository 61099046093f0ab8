"""Convert the image sets of the camera's stream to values."""

from collections import defaultdict
from typing import Any

import numpy as np

from scenegate.camera import image_interface_pb2 as pb
from scenegate.camera.files import depth, nanoseconds, pixels, points
from scenegate.recording.values import LEFT_FRAME, Calibration, CameraImage, Cloud, Disparity, Encoding, ExposureImages

OPENCV_OFFSET = 0.5
"""Ours minus OpenCV's image coordinates: OpenCV has the centre of the first pixel at 0."""
INVALID_DISPARITY = -1.0
"""Below ``min_disparity``, which is 0: consumers of ``stereo_msgs/DisparityImage`` skip it."""


class CameraConverter:
    """Converts the sets of a stream. It remembers the baseline, which only sets with disparity have."""

    def __init__(self, baseline: float | None = None, *, cloud: bool = True) -> None:
        """``baseline``: metres; None: unknown. ``cloud``: compute points."""
        self._baseline = baseline
        self._has_cloud = cloud

    def convert(self, image_set: pb.ImageSet, *, depth_only: bool = False) -> list[ExposureImages]:
        """Return the images of a set and the values computed from them, grouped by the time of exposure.

        The right image is left out until a set with disparity was converted, which has the baseline. ``depth_only``
        leaves out left and right; the left image still colours the points. Raises BadImageError.
        """
        left = image_set.left if image_set.HasField("left") else None
        fields_by_time: defaultdict[int, dict[str, Any]] = defaultdict(lambda: {"images": {}})
        """Fields of each ``ExposureImages`` by its time."""
        if image_set.HasField("disparity"):
            message = image_set.disparity
            self._baseline = message.baseline
            fields = fields_by_time[nanoseconds(message.image.timestamp)]
            metres = depth(message)
            metres[np.isinf(metres)] = np.nan
            fields["disparity"] = _disparity(message)
            fields["images"]["depth"] = CameraImage(
                _calibration(message.image), "32FC1", metres.astype("<f4").tobytes()
            )
            if self._has_cloud:
                found = points(image_set)
                fields["cloud"] = Cloud(LEFT_FRAME, found.xyz, found.rgb)
        if left is not None and not depth_only:
            fields_by_time[nanoseconds(left.timestamp)]["images"]["left"] = _image(left)
        if image_set.HasField("right") and not depth_only and self._baseline is not None:
            right = image_set.right
            tx = -right.focal_length * self._baseline
            fields_by_time[nanoseconds(right.timestamp)]["images"]["right"] = _image(right, tx)
        return [ExposureImages(time_ns, **fields) for time_ns, fields in sorted(fields_by_time.items())]


def _calibration(image: pb.Image, tx: float = 0.0) -> Calibration:
    cx, cy = image.principal_point_u - OPENCV_OFFSET, image.principal_point_v - OPENCV_OFFSET
    return Calibration(LEFT_FRAME, image.width, image.height, image.focal_length, cx, cy, tx)


def _image(message: pb.Image, tx: float = 0.0) -> CameraImage:
    """Return a grey or colour image; ``tx`` is ``Calibration.tx``."""
    array = pixels(message)
    encoding: Encoding = "rgb8"
    if array.ndim == 2:
        encoding = "mono8" if array.dtype == np.uint8 else "mono16"
    little_endian = array.astype(array.dtype.newbyteorder("<"), copy=False)
    return CameraImage(_calibration(message, tx), encoding, little_endian.tobytes())


def _disparity(message: pb.DisparityImage) -> Disparity:
    stored = pixels(message.image)
    valid = stored != message.invalid_data_value
    values = stored.astype("<f4") * np.float32(message.scale) + np.float32(message.offset)
    values[~valid] = INVALID_DISPARITY
    image = CameraImage(_calibration(message.image), "32FC1", values.tobytes())
    max_disparity = float(values.max()) if valid.any() else 0.0
    return Disparity(image, message.baseline, max_disparity, disparity_step=message.delta_d)
