"""Geometry of a rectified stereo camera: models, qualities, intrinsics and the pinhole cameras to render."""

import math
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera

DISPARITY_SCALE: Final = 1.0 / 16.0
"""Pixels per unit of a disparity or disparity error image, as on the device."""

_once: Final = lru_cache(maxsize=64)
"""Decorator of a model's methods that every set calls several times. Models live as long as the process."""

MAX_DISPARITIES: Final = 2032
"""Maximum number of disparities: the limit of OpenCV's matcher (signed 16 bits, steps of 16 pixels)."""


class Quality(Enum):
    """Resolution of the depth images; the value is the device's parameter value."""

    FULL = "Full"
    HIGH = "High"
    MEDIUM = "Medium"
    LOW = "Low"

    def __init__(self, value: str) -> None:
        self.divisor: Final = {"Full": 1, "High": 2, "Medium": 4, "Low": 6}[value]
        """Width of the camera images divided by that of the depth images."""
        self.depth_rate: Final = {"Full": 1.0, "High": 3.0, "Medium": 15.0, "Low": 25.0}[value]
        """Depth images per second of the real device, Hz."""


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """Size and intrinsics of one image of the stereo camera. Pixels are square."""

    width: int
    height: int
    focal_length: float
    """Pixels."""
    cx: float
    """Principal point, pixels from the left edge."""
    cy: float
    """Principal point, pixels from the top edge."""

    @property
    def matrix(self) -> NDArray[np.float64]:
        """Camera matrix K, (3, 3) float64. The centre of the first pixel is at (0.5, 0.5)."""
        return np.array(((self.focal_length, 0, self.cx), (0, self.focal_length, self.cy), (0, 0, 1)))

    @property
    def opencv_matrix(self) -> NDArray[np.float64]:
        """The same for OpenCV, whose first pixel has its centre at (0, 0)."""
        matrix = self.matrix
        matrix[:2, 2] -= 0.5
        return matrix


@dataclass(frozen=True, slots=True)
class StereoModel:
    """Parameters of a stereo camera model."""

    name: str
    """``model_name`` in the device's system information."""
    width: int
    """Columns of the camera images, pixels."""
    height: int
    """Rows of the camera images, pixels."""
    focal_factor: float
    """Focal length divided by the image width."""
    baseline: float
    """Metres; the right camera is at +x of the left one."""
    full_max_disparities: int = MAX_DISPARITIES
    """Maximum number of disparities at full resolution, pixels."""
    principal_point: tuple[float, float] | None = None
    """Pixels from the left and the upper edge, at full resolution; None: the centre."""

    def __post_init__(self) -> None:
        if not (16 <= self.width <= 8192 and 16 <= self.height <= 8192):
            raise ValueError(f"stereo camera size {self.width}x{self.height} must be within 16x16 and 8192x8192")
        if not (0.05 <= self.focal_factor <= 20.0):
            raise ValueError(f"stereo focal_factor {self.focal_factor} must be within 0.05 and 20")
        if not (1e-4 <= self.baseline <= 100.0):
            raise ValueError(f"stereo baseline {self.baseline} m must be within 0.0001 and 100")

    @_once
    def intrinsics(self, divisor: int = 1) -> Intrinsics:
        """Return the intrinsics of the image at 1/``divisor`` of the resolution.

        The size is rounded up (1280/6 is 214), but focal length and principal point are exact fractions, as on the
        device: the smaller image has larger pixels, and its last column and row lie partly outside.
        """
        focal_length = self.focal_factor * self.width
        cx, cy = self.principal_point or (self.width / 2, self.height / 2)
        return Intrinsics(
            width=-(-self.width // divisor),
            height=-(-self.height // divisor),
            focal_length=focal_length / divisor,
            cx=cx / divisor,
            cy=cy / divisor,
        )

    @_once
    def focal_times_baseline(self, divisor: int = 1) -> float:
        """Return disparity times depth at 1/``divisor`` of the resolution, pixels times metres."""
        return self.intrinsics(divisor).focal_length * self.baseline

    @_once
    def nearest_depth(self, mindepth: float, maxdepth: float, divisor: int) -> float:
        """Return the nearest depth that can be measured, metres.

        It is at least ``max(mindepth, 2.5 * baseline)``, as in the vendor's driver. At full resolution it may be
        farther, because memory limits the number of disparities. That number is counted from the disparity of
        ``maxdepth``, so a smaller ``maxdepth`` permits a nearer depth.
        """
        return max(mindepth, 2.5 * self.baseline, self._nearest_depth_for_memory(maxdepth, divisor))

    def has_reduced_range(self, mindepth: float, maxdepth: float, divisor: int) -> bool:
        """Return True if the device's memory limits the nearest depth."""
        return self._nearest_depth_for_memory(maxdepth, divisor) > max(mindepth, 2.5 * self.baseline)

    def _nearest_depth_for_memory(self, maxdepth: float, divisor: int) -> float:
        """Return the nearest depth that the device's memory permits, metres; 0: no limit."""
        if divisor != 1:
            return 0.0
        focal_times_baseline = self.focal_times_baseline()
        return focal_times_baseline / (focal_times_baseline / maxdepth + self.full_max_disparities)

    def disparity_count(self, divisor: int, mindepth: float, maxdepth: float = math.inf) -> int:
        """Return the number of disparities at 1/``divisor`` of the resolution: ``ceil(focal length * baseline / nearest
        depth)``, at most ``MAX_DISPARITIES``."""
        nearest = self.nearest_depth(mindepth, maxdepth, divisor)
        return min(math.ceil(self.focal_times_baseline(divisor) / nearest), MAX_DISPARITIES)

    def camera(
        self, X_world_left: NDArray[np.float64], *, offset: float, divisor: int, near: float, far: float
    ) -> Camera:
        """Return the pinhole camera at ``offset`` metres along the left camera's x axis: 0 left, the baseline right."""
        k = self.intrinsics(divisor)
        pose = X_world_left.copy()
        pose[:3, 3] += X_world_left[:3, 0] * offset
        return Camera(k.width, k.height, k.focal_length, k.focal_length, k.cx, k.cy, near, far, pose)
