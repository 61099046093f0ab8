"""What interfaces provide to those that start after them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gateway.runtime.lcm.listener import ChannelListener
from gateway.scene.tree.live import Snapshot
from renderers.camera import Camera

if TYPE_CHECKING:
    from gateway.adapters.stereo.service import StereoService
    from gateway.adapters.viewer.sources import StereoSource
    from gateway.runtime.logs.render_record import RenderRecord


@dataclass(frozen=True)
class ProvidedCamera:
    """The first stereo camera."""

    service: StereoService
    sensor: StereoSource
    """Its images for the browser view."""
    camera: Callable[[Snapshot], Camera | None]
    """Returns its left camera in a snapshot of the live tree; None if it sees another scene."""


@dataclass(frozen=True)
class Provided:
    """What the interfaces that have started provide. A set-up returns it with its own part."""

    recent_renders: Sequence[RenderRecord] = ()
    """Newest finished requests of the render endpoint, oldest first."""
    lcm_listeners: tuple[ChannelListener, ...] = ()
    """Receivers of channels besides those of the tree viewer."""
    stereo: ProvidedCamera | None = None
