"""What the view shows of other interfaces, as values; the application wires where they come from."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from gateway.scene.live import Snapshot

PictureName = Literal["left", "right", "disparity", "confidence"]
PICTURE_NAMES: Final[tuple[PictureName, ...]] = get_args(PictureName)


@dataclass(frozen=True, slots=True, eq=False)
class Rig:
    """Where the stereo camera is in the live scene, and what it covers."""

    pose: NDArray[np.float64]
    """(4, 4) float64: X_world_left, optical frame."""
    width: int
    """Pixels."""
    height: int
    fx: float
    """Pixels."""
    fy: float
    cx: float
    cy: float
    baseline: float
    """Metres; the right camera is that far along +X."""


@dataclass(frozen=True, slots=True, eq=False)
class SensorPictures:
    """What the stereo camera sees at one moment."""

    left: NDArray[np.uint8]
    """(H, W) grey or (H, W, 3) RGB."""
    right: NDArray[np.uint8]
    disparity: NDArray[np.uint16]
    """(h, w), any unit; 0 is invalid."""
    confidence: NDArray[np.uint8]
    """(h, w), 1/255; 0 is invalid."""
    captions: Mapping[PictureName, str] = field(default_factory=dict)
    """A few words under a picture."""


class Eyes(Protocol):
    """The stereo camera, for people."""

    def rig(self, snapshot: Snapshot) -> Rig | None:
        """Where it is in a state of the live scene; None: it is not in it. Must be cheap."""

    async def look(self) -> SensorPictures:
        """Takes a set of pictures now."""


@dataclass(frozen=True, slots=True)
class RenderNote:
    """A render request that was answered."""

    status: int
    """HTTP status."""
    seconds: float
    """From the first byte of the request to the answer."""
    queued: float
    """Seconds of it spent waiting."""
    what: str
    """Kind and size of the picture, for people."""
    scene: str
    """What was drawn, for people."""
    kind: Literal["color", "depth", "label", ""]
    """Empty: the request was not understood."""
    body: bytes
    """The picture as the client got it; empty: none."""
    media_type: str
    error: str
    """The sentence that the client got; empty: none."""


@dataclass(frozen=True, slots=True)
class ViewPorts:
    """Everything that comes from elsewhere; the defaults are a view of the scene alone."""

    status: Callable[[], Mapping[str, Any]] = dict
    """``interfaces`` (name to state and problem) and ``facts`` (name, value, warn) for the status bar; about once a
    second while somebody looks."""
    rig: Callable[[Snapshot], Rig | None] = lambda snapshot: None
    """The stereo camera in a state of the scene; None: it is not in it. Called with every update: it must be cheap."""
    sensor: Callable[[], Awaitable[SensorPictures]] | None = None
    """Takes a set of pictures; None: no stereo camera runs."""
