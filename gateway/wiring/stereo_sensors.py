"""What the stereo camera sees, as values for the browser view: the join of their rooms."""

from __future__ import annotations

import asyncio
import copy
import time

import numpy as np
from numpy.typing import NDArray

from gateway.scene.live import Snapshot
from gateway.stereo.frame import Frame
from gateway.stereo.images import Shot
from gateway.stereo.request import Kind
from gateway.stereo.service import StereoService
from gateway.stereo.settings import StreamSettings
from gateway.viewer.sources import ImageName, StereoImages, StereoRig
from gateway.wiring.stereo_scene import StereoView
from renderers.stereo.errors import Measured
from renderers.stereo.model import DISPARITY_SCALE
from renderers.stereo.noise import Stream

_WANTED = Kind(left=True, right=True, disparity=True, confidence=True, color=True)
_SPREAD = (1.0, 99.0)
"""Percentiles of the disparities between which the caption's range of depths lies."""


class StereoEyes:
    """Takes sets of pictures as the stream's clients get them, whether somebody streams or not."""

    def __init__(self, service: StereoService, view: StereoView, *, live: bool) -> None:
        """
        Args:
            view: is copied, so that scene and pose of the stream's frames stay together.
            live: whether the camera sees the live tree.
        """
        self._service = service
        self._view = copy.copy(view)
        self._live = live
        self._number = 0

    def rig(self, snapshot: Snapshot) -> StereoRig | None:
        """Where the camera is in a state of the live tree."""
        if not self._live:
            return None
        model = self._service.config.model
        k = model.intrinsics()
        pose = self._view.mount.pose(snapshot.root)
        return StereoRig(pose, k.width, k.height, k.focal_length, k.focal_length, k.cx, k.cy, model.baseline)

    async def capture(self) -> StereoImages:
        """Takes a set now, with the parameters as they are.

        Raises:
            QueueFull: the worker threads have too much to do.
            ImageError: a texture of the scene cannot be decoded.
        """
        service, settings = self._service, self._service.settings
        self._number += 1
        camera, depth = await service.workers.run(self._shots, settings, self._number)
        frame = Frame(service.studio, service.workers, self._number, settings, camera, depth, (_WANTED,))
        try:
            left, right, measured, metered = await asyncio.gather(
                frame.image(Stream.LEFT, color=True),
                frame.image(Stream.RIGHT, color=True),
                frame.measured(),
                frame.metered(camera),
            )
        except BaseException:
            frame.discard()
            raise
        exposure = metered.exposure
        taken = f"{exposure.time * 1e3:.3g} ms, {exposure.gain:.3g} dB"
        captions: dict[ImageName, str] = {"left": taken, "right": taken}
        captions.update(await service.workers.run(self._captions, measured, settings))
        return StereoImages(left.image, right.image, measured.disparity, measured.confidence, captions)

    def _shots(self, settings: StreamSettings, index: int) -> tuple[Shot, Shot]:
        scene, revision = self._view.scene()
        pose: NDArray[np.float64] = self._view.pose()
        now = time.time_ns()
        camera = Shot(now, scene, revision, pose, settings.lines(depth=False), index)
        return camera, Shot(now, scene, revision, pose, settings.lines(depth=True), index)

    def _captions(self, measured: Measured, settings: StreamSettings) -> dict[ImageName, str]:
        valid = measured.disparity[measured.disparity > 0]
        if not valid.size:
            return {"disparity": "no depth", "confidence": ""}
        model = self._service.config.model
        ft = model.intrinsics(settings.quality.divisor).focal_length * model.baseline
        far, near = ft / (DISPARITY_SCALE * np.percentile(valid, _SPREAD))
        share = 100.0 * valid.size / measured.disparity.size
        return {"disparity": f"{near:.1f}–{far:.1f} m", "confidence": f"{share:.0f} %"}
