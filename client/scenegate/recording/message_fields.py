"""Fields that Foxglove's messages and those of ROS 2 have in common, as dicts, nested as the messages are."""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenegate.recording.values import CameraImage, Cloud

Fields = dict[str, Any]
NO_TRANSLATION: Final[Fields] = {"x": 0.0, "y": 0.0, "z": 0.0}
NO_ROTATION: Final[Fields] = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
IDENTITY: Final[Fields] = {"position": NO_TRANSLATION, "orientation": NO_ROTATION}
DISTORTION_MODEL: Final = "plumb_bob"
"""Model of the intrinsics of rectified images, whose five coefficients are 0."""


class Message(NamedTuple):
    """A message that is not encoded yet."""

    type: str
    """Name of the type: ``SceneUpdate``, ``sensor_msgs/msg/Image``."""
    fields: Fields


def vector(numbers: Sequence[float]) -> Fields:
    """Return x, y, z."""
    return dict(zip("xyz", numbers, strict=True))


def quaternion(numbers: Sequence[float]) -> Fields:
    """Return the fields of [w, x, y, z]."""
    return dict(zip("wxyz", numbers, strict=True))


def color(numbers: Sequence[float]) -> Fields:
    """Return red, green, blue and alpha, 0 to 1."""
    red, green, blue, alpha = numbers
    return {"r": red, "g": green, "b": blue, "a": alpha}


def image(value: CameraImage) -> Fields:
    """Return the size and the pixels of an image."""
    intrinsics = value.calibration
    return {
        "width": intrinsics.width,
        "height": intrinsics.height,
        "encoding": value.encoding,
        "step": value.step,
        "data": value.data,
    }


def packed_points(cloud: Cloud, channels: tuple[int, int, int], alpha: int) -> NDArray[np.void]:
    """Return the points of a cloud as records: float32 x, y, z, and four bytes if the cloud has colours.

    The first three bytes are these channels of the colours, the fourth is ``alpha``.
    """
    columns: list[tuple[str, str, tuple[int, ...]]] = [("points", "<f4", (3,))]
    if cloud.colors is not None:
        columns.append(("colors", "u1", (4,)))
    records = np.zeros(len(cloud.points), columns)
    records["points"] = cloud.points
    if cloud.colors is not None:
        records["colors"][:, :3] = cloud.colors[:, channels]
        records["colors"][:, 3] = alpha
    return records
