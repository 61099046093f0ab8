"""Wiring of Foxglove's WebSocket."""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from functools import partial
from typing import Any, Final

from gateway.adapters.stereo.service import StereoService
from gateway.adapters.stereo.stream.set_kind import SetKind
from gateway.adapters.stereo.stream.subscriptions import Subscription
from gateway.adapters.viewer.encoder import SnapshotFrames
from gateway.wiring.context import Context, Provided

_NODES: Final = ("rc_camera", "rc_stereomatching", "rc_iocontrol")
"""Nodes of the device whose parameters Foxglove shows."""


async def setup(context: Context, provided: Provided) -> Provided:
    """Serve Foxglove's protocol on ``--foxglove-port``."""
    try:
        from gateway.adapters.foxglove.front import Front
        from gateway.adapters.foxglove.service import FoxgloveService
    except ImportError as error:
        raise ImportError(f"{error}; --foxglove-port needs pip install 'scenegate[foxglove]'") from None

    settings = context.settings
    assert settings.foxglove_port is not None
    stereo = provided.stereo
    scene_frames = SnapshotFrames if stereo is None else partial(SnapshotFrames, stereo.sensor.rig)
    camera = FoxgloveCamera(stereo.service) if stereo else None
    front = Front(settings.trusted_hosts, settings.cors_origins)
    service = FoxgloveService(settings.foxglove_port, context.tree, scene_frames, camera, front)
    context.run_service("foxglove", service, where="Foxglove: ws://127.0.0.1, --foxglove-port")
    return provided


class FoxgloveCamera:
    """The stereo camera as Foxglove's service uses it: ``gateway.adapters.foxglove.service.CameraSource``."""

    def __init__(self, service: StereoService) -> None:
        self._service = service
        self.baseline = service.config.model.baseline

    def parameters(self) -> Mapping[str, Any]:
        """Return the camera's parameters, ``node.name``."""
        values = self._service.parameters.values
        return {f"{node}.{name}": value for node in _NODES for name, value in values(node).items()}

    def subscribe(self, left: bool, right: bool, disparity: bool) -> AbstractContextManager[Subscription]:
        """Return a subscription to sets of these images for the duration of the block."""
        color = self._service.config.color
        return self._service.hub.subscribe(SetKind(left=left, right=right, disparity=disparity, color=color))
