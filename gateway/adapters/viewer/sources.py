"""Types of what other interfaces provide to the browser view, which imports none of them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.viewer.messages import ImageName, PlacedRig
from gateway.scene.tree.live import Snapshot


@dataclass(frozen=True, slots=True, eq=False)
class StereoImages:
    """One set of images of the stereo camera."""

    left: NDArray[np.uint8]
    """(H, W) grey or (H, W, 3) RGB."""
    right: NDArray[np.uint8]
    """(H, W) grey or (H, W, 3) RGB."""
    disparity: NDArray[np.uint16]
    """(h, w), in any unit; may be smaller than (H, W). 0 is invalid."""
    confidence: NDArray[np.uint8]
    """(h, w), in 1/255. 0 is invalid."""
    captions: Mapping[ImageName, str] = field(default_factory=dict)
    """Short texts that the page shows below the images."""
    pose: str = ""
    """Where the left image was taken, as text for ``--stereo-pose``."""


class StereoSource(Protocol):
    """The stereo camera, as the browser view uses it."""

    def rig(self, snapshot: Snapshot) -> PlacedRig | None:
        """Return pose and intrinsics in a snapshot of the live scene; None in another scene. Must be fast."""

    async def capture(self) -> StereoImages:
        """Render and return a set of images."""
