"""The pinhole camera of all renderers: intrinsics in pixels, pose of the optical frame in the world."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

OPENGL_FROM_OPTICAL: Final = np.diag([1.0, -1.0, -1.0, 1.0])
"""(4, 4) float64: ``X_world_optical = X_world_opengl @ OPENGL_FROM_OPTICAL``. In glTF and OpenGL, cameras look along -Z
with +Y up. In the optical frame they look along +Z with +Y down."""


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A pinhole camera. The principal point is arbitrary, and fx and fy may differ.

    Pixel (i, j) (column, row; (0, 0) is top-left) is sampled along the ray
    ``((i + 0.5 - cx) / fx, (j + 0.5 - cy) / fy, 1)`` of the optical frame, as in Drake and rc_visard.
    """

    width: int
    """Columns, pixels."""
    height: int
    """Rows, pixels."""
    fx: float
    """Focal length along x, pixels."""
    fy: float
    """Focal length along y, pixels."""
    cx: float
    """Principal point, pixels from the left edge of the image."""
    cy: float
    """Principal point, pixels from the top edge of the image."""
    near: float
    """Near clipping plane, metres along +Z, > 0."""
    far: float
    """Far clipping plane, metres along +Z, > near; may be inf."""
    X_world_camera: NDArray[np.float64]
    """(4, 4) float64, affine: pose of the optical frame (+X right, +Y down, +Z forward) in the world."""
    depth_origin: float = 0.0
    """Metres along +Z from which depth images count. An orthographic camera is a pinhole so far behind it."""

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise ValueError(f"camera size {self.width}x{self.height} must be at least 1x1")
        if not (self.fx > 0 and self.fy > 0 and math.isfinite(self.fx) and math.isfinite(self.fy)):
            raise ValueError(f"focal lengths ({self.fx}, {self.fy}) must be positive and finite")
        if not (math.isfinite(self.cx) and math.isfinite(self.cy)):
            raise ValueError(f"principal point ({self.cx}, {self.cy}) must be finite")
        if not (0 < self.near < self.far):
            raise ValueError(f"clipping planes must satisfy 0 < near < far, got near={self.near}, far={self.far}")
        if self.X_world_camera.shape != (4, 4) or not np.isfinite(self.X_world_camera).all():
            raise ValueError("X_world_camera must be a finite (4, 4) matrix")

    @property
    def X_camera_world(self) -> NDArray[np.float64]:
        """(4, 4) float64: transform from the world to the optical frame, the inverse of ``X_world_camera``."""
        return np.linalg.inv(self.X_world_camera).astype(np.float64, copy=False)
