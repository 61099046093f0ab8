"""Geometry of the separate colour camera of an RGB-D camera."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.stereo.model import Intrinsics


@dataclass(frozen=True, slots=True)
class ColorCamera:
    """A colour camera with a fixed pose relative to the stereo cameras."""

    intrinsics: Intrinsics
    position: tuple[float, float, float]
    """Optical centre in the left optical frame, metres."""
    rotation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    """Quaternion [w, x, y, z] of the optical frame in the left one, of any length but 0."""
    noise: float = 1.0
    """Factor of the standard deviation of the image noise."""
    readout: float = 0.0
    """Seconds between the exposures of the first and the last row; 0: global shutter."""

    @property
    def X_left_color(self) -> NDArray[np.float64]:
        """Pose of the colour camera's optical frame in the left one, (4, 4) float64."""
        w, x, y, z = np.array(self.rotation) / np.linalg.norm(self.rotation)
        pose = np.eye(4)
        pose[:3, :3] = (
            (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        )
        pose[:3, 3] = self.position
        return pose

    def camera(self, X_world_left: NDArray[np.float64], *, near: float, far: float, divisor: int = 1) -> Camera:
        """Return the pinhole camera at a pose of the stereo camera, with images of 1/``divisor`` of the resolution."""
        k = self.intrinsics
        width, height, f = -(-k.width // divisor), -(-k.height // divisor), k.focal_length / divisor
        pose = X_world_left @ self.X_left_color
        return Camera(width, height, f, f, k.cx / divisor, k.cy / divisor, near, far, pose)
