"""Types of what other interfaces provide to Foxglove's clients. ``gateway.wiring`` passes them."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from typing import Any, Protocol

from gateway.scene.tree.live import Snapshot


class SceneFrames(Protocol):
    """Changes of the scene as frames of the browser view."""

    async def advance(self, snapshot: Snapshot) -> list[bytes]:
        """Return the frames that lead from the last snapshot to this one."""


NewSceneFrames = Callable[[], SceneFrames]
"""Returns frames whose last snapshot is the empty scene."""


class ImageSets(Protocol):
    """A subscription to image sets."""

    async def get(self) -> bytes:
        """Wait for the next set of the gRPC interface; return it encoded. Raises RuntimeError, with the reason, at the
        end.
        """


class CameraSource(Protocol):
    """The stereo camera."""

    @property
    def baseline(self) -> float:
        """Distance between the cameras, in metres."""

    def parameters(self) -> Mapping[str, Any]:
        """Return the camera's parameters, ``node.name``."""

    def subscribe(self, left: bool, right: bool, disparity: bool) -> AbstractContextManager[ImageSets]:
        """Return a subscription for the duration of the block. Raises RuntimeError, with the reason, without sets."""
