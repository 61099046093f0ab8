"""One frame: everything that can be asked of an instant, each made once, however many clients want it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Hashable, Iterable
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from gateway.runtime.worker_pool import WorkerPool
from gateway.stereo import messages, wire
from gateway.stereo.images import Metered, Shot, Studio, Wanted
from gateway.stereo.messages import Taking
from gateway.stereo.request import Kind
from gateway.stereo.settings import StreamSettings
from gateway.stereo.wire import Chunk
from renderers.drawlist import ImageError
from renderers.interface import Output
from renderers.stereo.errors import Measured
from renderers.stereo.exposure import Exposure
from renderers.stereo.mesh import MeshOptions
from renderers.stereo.model import DISPARITY_SCALE
from renderers.stereo.noise import Stream
from renderers.stereo.sensor import Taken

T = TypeVar("T")


class Frame:
    """Made for the kinds of set that are wanted when it is taken; others may ask later, while it is remembered."""

    def __init__(
        self,
        studio: Studio,
        workers: WorkerPool,
        number: int,
        settings: StreamSettings,
        camera: Shot,
        depth: Shot,
        kinds: Iterable[Kind],
        epoch: int = 0,
    ) -> None:
        """
        Args:
            camera: the instant of left and right.
            depth: the instant of the depth images; 40 ms later when they are exposed with other outputs.
            kinds: wanted now; images are rendered once for those in grey and those in colour.
            epoch: of the hub when the frame was taken.
        """
        self.number = number
        self.epoch = epoch
        self.settings = settings
        self.camera = camera
        self.depth = depth
        self._studio = studio
        self._workers = workers
        self._colors = {
            Stream.LEFT: frozenset(k.color for k in kinds if k.left or (k.mesh is not None and k.mesh.textured)),
            Stream.RIGHT: frozenset(k.color for k in kinds if k.right),
        }
        self._made: dict[Hashable, asyncio.Task[Any]] = {}
        self.taken: Metered | None = None
        """How the left image was taken, once that is known."""

    async def serialised(self, kind: Kind) -> bytes:
        """The bytes of an ``ImageSet``."""
        return await self._once(kind, lambda: self._serialise(kind))

    async def measured(self) -> Measured:
        """The depth images."""
        return await self._once("depth", self._match if self._studio.config.depth_mode == "matched" else self._measure)

    async def metered(self, shot: Shot) -> Metered:
        """How the images of one of the two instants are taken."""
        return await self._once(
            ("metered", shot.timestamp, shot.lines), lambda: self._run(self._studio.meter, shot, self.settings)
        )

    def discard(self) -> None:
        """Ends what is still being made."""
        for task in self._made.values():
            task.cancel()

    async def _serialise(self, kind: Kind) -> bytes:
        names: list[tuple[int, Coroutine[Any, Any, list[Chunk]]]] = []
        if kind.left:
            names.append((2, self._image_message(Stream.LEFT, kind.color)))
        if kind.right:
            names.append((3, self._image_message(Stream.RIGHT, kind.color)))
        if kind.disparity:
            names.append((4, self._disparity_message(kind)))
        if kind.error:
            names.append((5, self._depth_message("error", kind)))
        if kind.confidence:
            names.append((6, self._depth_message("confidence", kind)))
        if kind.mesh is not None:
            names.append((7, self._mesh_message(kind.mesh, kind.color)))
        parts = await _all([part for _, part in names])
        shot = self.depth if kind.depth else self.camera
        chunks: list[Chunk] = [messages.timestamp_field(shot.timestamp)]
        for (number, _), part in zip(names, parts, strict=True):
            chunks += wire.field(number, part)
        return chunks[0] if len(chunks) == 1 else await self._run(wire.join, chunks)  # type: ignore[return-value]  # bytes

    async def _image_message(self, stream: Stream, color: bool) -> list[Chunk]:
        taken = await self.image(stream, color)
        metered = await self.metered(self.camera)
        taking = self._taking(self.camera, metered)
        if stream is Stream.LEFT:
            self.taken = replace(metered, brightness=taken.brightness)
        return messages.image(taken.image, self._studio.config.model.intrinsics(), taking, taken.brightness)

    async def _disparity_message(self, kind: Kind) -> list[Chunk]:
        picture = await self._depth_message("disparity", kind)
        scale, baseline = (await self.measured()).error_scale, self._studio.config.model.baseline
        return messages.disparity(picture, self.depth.timestamp, baseline, scale)

    async def _depth_message(self, name: str, kind: Kind) -> list[Chunk]:
        measured, metered, brightness = await asyncio.gather(
            self.measured(), self.metered(self.depth), self._depth_brightness(kind)
        )
        pixels: NDArray[np.uint8] | NDArray[np.uint16] = getattr(measured, name)
        if name == "disparity" and measured.error_scale < DISPARITY_SCALE:
            # The message has one scale for disparity and error.
            pixels = pixels * np.uint16(DISPARITY_SCALE / measured.error_scale)
        k = self._studio.config.model.intrinsics(self.settings.quality.divisor)
        return messages.image(pixels, k, self._taking(self.depth, metered), brightness)

    async def _depth_brightness(self, kind: Kind) -> float:
        """Brightness of the left image of the depth exposure: the one sent, else one at the depth resolution."""
        colors = self._colors[Stream.LEFT]
        try:
            if colors and self.depth.timestamp == self.camera.timestamp:
                return (await self.image(Stream.LEFT, kind.color if kind.left else min(colors))).brightness
            return (await self._depth_image(self.depth, Stream.LEFT_DEPTH)).brightness
        except ImageError:  # a broken texture has no depth: clients of left get the error, those of depth the image
            return 0.0

    async def _mesh_message(self, options: MeshOptions, color: bool) -> list[Chunk]:
        return await self._once(("mesh", options, color and options.textured), lambda: self._mesh(options, color))

    async def _mesh(self, options: MeshOptions, color: bool) -> list[Chunk]:
        left = (await self.image(Stream.LEFT, color)).image if options.textured else None
        measured = await self.measured()
        ply = await self._run(self._studio.mesh, measured, self.settings.quality.divisor, options, left)
        return messages.mesh(ply, self.depth.timestamp)

    def _taking(self, shot: Shot, metered: Metered) -> Taking:
        exposure = metered.exposure
        noise = exposure.sigma(128.0) * self._studio.config.noise_factor
        reduction = metered.out1_reduction
        return Taking(shot.timestamp, exposure.time, exposure.gain, exposure.gamma, noise, shot.lines, reduction)

    async def image(self, stream: Stream, color: bool) -> Taken:
        """The left or the right image of the camera's instant, in colour or grey."""
        wanted = self._colors[stream]
        if color not in wanted:  # somebody joined who wants what nobody wanted when the frame was taken
            wanted = frozenset((color,))
        taken = await self._once((stream, wanted), lambda: self._take(self.camera, stream, 1, wanted))
        return taken[color]

    async def _take(
        self, shot: Shot, stream: Stream, divisor: int, colors: frozenset[bool], averaged: int = 1
    ) -> dict[bool, Taken]:
        exposure = (await self.metered(shot)).exposure
        wanted = Wanted(exposure, self.number, stream, divisor, colors, averaged)
        return await self._run(self._studio.take, shot, wanted)

    async def _measure(self) -> Measured:
        divisor, t = self.settings.quality.divisor, self._studio.config.model.baseline
        left, right = await _all(
            [self._run(self._studio.render, self.depth, offset, divisor, Output.DEPTH) for offset in (0.0, t)]
        )
        return await self._run(self._studio.measure, left, right, self.settings, self.number)

    async def _match(self) -> Measured:
        settings, shot = self.settings, self.depth
        left, right, exposure = await self._pair(shot, Stream.LEFT_DEPTH, Stream.RIGHT_DEPTH)
        second = None
        dark = replace(shot, lines=settings.lines(depth=False))
        if settings.double_shot and shot.projected(self._studio.config) and not dark.lines & 1:
            second = await self._pair(dark, Stream.LEFT_SECOND, Stream.RIGHT_SECOND)
        return await self._run(self._studio.match, left, right, exposure, settings, second)

    async def _pair(self, shot: Shot, *streams: Stream) -> tuple[Taken, Taken, Exposure]:
        """Image pair for the matcher, and its exposure."""
        exposure = (await self.metered(shot)).exposure
        left, right = await _all([self._depth_image(shot, stream) for stream in streams])
        return left, right, exposure

    async def _depth_image(self, shot: Shot, stream: Stream) -> Taken:
        """A grey image at the depth images' resolution."""
        divisor, grey, averaged = self.settings.quality.divisor, frozenset((False,)), self.settings.averaged
        taken = await self._once(stream, lambda: self._take(shot, stream, divisor, grey, averaged))
        return taken[False]

    async def _run(self, function: Callable[..., T], *args: Any) -> T:
        return await self._workers.run(function, *args)

    async def _once(self, key: Hashable, make: Callable[[], Coroutine[Any, Any, T]]) -> T:
        """Makes something the first time it is asked for. Who stops waiting does not stop it for the others."""
        task = self._made.get(key)
        if task is None:
            task = self._made[key] = asyncio.get_running_loop().create_task(make())
            task.add_done_callback(_retrieve)
        result: T = await asyncio.shield(task)
        return result


def _retrieve(task: asyncio.Task[Any]) -> None:
    """Marks a failure as seen: whoever waited got it, and nobody may be waiting."""
    if not task.cancelled():
        task.exception()


async def _all(coroutines: list[Coroutine[Any, Any, T]]) -> list[T]:
    """All results; the first failure is raised when everything has ended."""
    if len(coroutines) == 1:
        return [await coroutines[0]]
    results = await asyncio.gather(*coroutines, return_exceptions=True)
    for result in results:
        if isinstance(result, BaseException):
            raise result
    return results  # type: ignore[return-value]  # no exceptions are left
