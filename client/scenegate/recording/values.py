"""Recorded values, independent of the message format: metres, radians, nanoseconds since the epoch."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

WORLD: Final = "world"
"""Name of the fixed frame, Z up."""
LEFT_FRAME: Final = "stereo_left_optical_frame"
"""Name of the left camera's optical frame: +Z forward, +X right, +Y down."""
RIGHT_FRAME: Final = "stereo_right_optical_frame"
"""Name of the right camera's optical frame."""

Color = tuple[float, float, float, float]
"""sRGB and alpha, 0 to 1."""
Encoding = Literal["mono8", "mono16", "rgb8", "32FC1"]
"""Pixels of an image by ROS 2's names; ``mono16`` and ``32FC1`` (float32) are little-endian."""


@dataclass(frozen=True, slots=True, eq=False)
class FrameTransform:
    """A rigid transform X_parent_child."""

    parent: str
    child: str
    translation: Sequence[float]
    """(3,) metres."""
    quaternion: Sequence[float]
    """(4,) unit quaternion [w, x, y, z]."""


@dataclass(frozen=True, slots=True, eq=False)
class Primitive:
    """Triangles or lines of one colour, or with a colour for each point."""

    points: NDArray[np.float32]
    """(N, 3): three for each triangle, two for each line."""
    color: Color
    colors: NDArray[np.float32] | None = None
    """(N, 4) sRGB and alpha of the points, 0 to 1, instead of ``color``."""
    is_lines: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Entity:
    """The geometry of a node, in its frame."""

    frame: str
    primitives: Sequence[Primitive]
    """Empty: the node has no geometry any more."""
    earlier_primitive_count: int = 0
    """Number of primitives that the node had before. In ROS 2 each one is a marker, which is deleted by itself."""


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """A point cloud."""

    frame: str
    points: NDArray[np.float32]
    """(N, 3) metres."""
    colors: NDArray[np.uint8] | None = None
    """(N, 3) sRGB."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneChange:
    """A change of the scene, or the whole scene."""

    time_ns: int
    """Time from which it is valid."""
    transforms: Sequence[FrameTransform] = ()
    entities: Sequence[Entity] = ()
    """Nodes whose geometry has changed."""
    clouds: Sequence[Cloud] = ()
    """Changed point clouds of the scene, of which each frame has at most one; an empty one was removed."""
    joints: Mapping[str, float] = field(default_factory=dict)
    """Values of all joints by name, radians or metres, if any has changed; else empty."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """Intrinsics of a rectified image by OpenCV's convention: the centre of the first pixel is at (0, 0)."""

    frame: str
    """Frame of the projection: the left optical frame also for the right camera, whose ``tx`` has the baseline."""
    width: int
    height: int
    focal_length: float
    """Pixels."""
    cx: float
    """Principal point, pixels: 0.5 less than in the camera's stream, where the centre of the first pixel is at 0.5."""
    cy: float
    tx: float = 0.0
    """P[0, 3] in pixels times metres: minus focal length times baseline for the right camera, 0 for others."""

    @property
    def K(self) -> list[float]:
        """Camera matrix, 9 numbers, row-major."""
        return [self.focal_length, 0.0, self.cx, 0.0, self.focal_length, self.cy, 0.0, 0.0, 1.0]

    @property
    def P(self) -> list[float]:
        """Projection matrix, 12 numbers, row-major."""
        return [self.focal_length, 0.0, self.cx, self.tx, 0.0, self.focal_length, self.cy, 0.0, 0.0, 0.0, 1.0, 0.0]


@dataclass(frozen=True, slots=True, eq=False)
class CameraImage:
    """A rectified image with its intrinsics."""

    calibration: Calibration
    encoding: Encoding
    data: bytes
    """Rows without padding."""

    @property
    def step(self) -> int:
        """Bytes of a row."""
        return len(self.data) // max(self.calibration.height, 1)


@dataclass(frozen=True, slots=True, eq=False)
class Disparity:
    """A disparity image."""

    image: CameraImage
    """``32FC1``, pixels; -1 where it is invalid."""
    baseline: float
    """Metres."""
    max_disparity: float
    """Largest valid disparity, pixels."""
    disparity_step: float
    """Smallest difference of two disparities, pixels."""


@dataclass(frozen=True, slots=True, eq=False)
class ExposureImages:
    """The images of one exposure, and the values computed from them."""

    time_ns: int
    """Time of the exposure."""
    images: Mapping[str, CameraImage] = field(default_factory=dict)
    """Images by name: ``left``, ``right``, ``depth`` (metres along the optical axis, NaN where it is invalid)."""
    disparity: Disparity | None = None
    cloud: Cloud | None = None
