"""Projector of another camera, whose light a camera sees (``--stereo-projectors shared``)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.stereo.device.stream_settings import StreamSettings
from renderers.camera import Camera
from renderers.stereo.model import StereoModel


@dataclass(frozen=True, slots=True, eq=False)
class OtherProjector:
    """Projector half-way between the cameras of another stereo camera."""

    X_world_left: NDArray[np.float64]
    """(4, 4) float64, pose of that camera's left optical frame."""
    model: StereoModel
    dot_light: float
    """Light that a full dot adds, relative to the rendered light."""
    settings: StreamSettings
    """Parameters of that camera, which switch the projector."""

    def camera(self, divisor: int, *, near: float, far: float) -> Camera:
        """Return the camera at the projector, with that camera's intrinsics at 1/``divisor`` of the resolution."""
        return self.model.camera(self.X_world_left, offset=self.model.baseline / 2, divisor=divisor, near=near, far=far)
