"""Values that other interfaces provide to the browser view."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from gateway.scene.live import Snapshot

ImageName = Literal["left", "right", "disparity", "confidence"]
IMAGE_NAMES: Final[tuple[ImageName, ...]] = get_args(ImageName)


@dataclass(frozen=True, slots=True, eq=False)
class StereoRig:
    """Pose and intrinsics of the stereo camera in the live scene."""

    pose: NDArray[np.float64]
    """(4, 4) float64: X_world_left, optical frame."""
    width: int
    """Pixels."""
    height: int
    """Pixels."""
    fx: float
    """Focal length in pixels."""
    fy: float
    """Focal length in pixels."""
    cx: float
    """Principal point in pixels."""
    cy: float
    """Principal point in pixels."""
    baseline: float
    """Metres from the left to the right camera, along +X."""


@dataclass(frozen=True, slots=True, eq=False)
class StereoImages:
    """One set of images of the stereo camera."""

    left: NDArray[np.uint8]
    """(H, W) grey or (H, W, 3) RGB."""
    right: NDArray[np.uint8]
    """(H, W) grey or (H, W, 3) RGB."""
    disparity: NDArray[np.uint16]
    """(h, w) in any unit; 0 is invalid."""
    confidence: NDArray[np.uint8]
    """(h, w) in 1/255; 0 is invalid."""
    captions: Mapping[ImageName, str] = field(default_factory=dict)
    """Short texts shown below the images."""


class StereoSource(Protocol):
    """The stereo camera as the view uses it."""

    def rig(self, snapshot: Snapshot) -> StereoRig | None:
        """Return the camera's place in a snapshot of the live scene; None if it sees another scene.

        Called with every update, so it must be fast.
        """

    async def capture(self) -> StereoImages:
        """Render a set of images now."""


@dataclass(frozen=True, slots=True)
class RenderSummary:
    """A finished request of the render endpoint."""

    status: int
    """HTTP status."""
    seconds: float
    """Time from the first byte of the request to the response."""
    queue_seconds: float
    """Part of ``seconds`` spent waiting for a worker thread."""
    image_text: str
    """Type and size of the image, for display."""
    scene_text: str
    """Size and origin of the scene, for display."""
    kind: Literal["color", "depth", "label", ""]
    """Type of the image; empty if the request was invalid."""
    body: bytes
    """The image as it was sent; empty if there is none."""
    media_type: str
    """Media type of ``body``."""
    error: str
    """The error message that was sent; empty if there is none."""
    warnings: tuple[str, ...] = ()
    """Sentences about what was ignored or repaired."""
