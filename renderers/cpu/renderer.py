"""The reference renderer: ``renderers.port.Renderer`` on this machine's cores."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, Final, get_args

import numpy as np
from numpy.typing import NDArray

from renderers.alike import Alike
from renderers.camera import Camera
from renderers.cpu.crew import Crew, Phase
from renderers.cpu.edges import draw_samples, find_edges
from renderers.cpu.frame import FrameJob
from renderers.cpu.layout import MAX_SIDE
from renderers.cpu.pools import ArrayPool, ScratchPool
from renderers.cpu.sampled import EdgeMemory, mixed_bands, paint_each_sample
from renderers.cpu.scene import PreparedScene, prepare
from renderers.cpu.visibility import SampledView, Visibility
from renderers.drawlist import DrawList
from renderers.pointers import address_of
from renderers.port import Frame, Look, LookName, Output
from renderers.shading import Painter, Parallel, ShadingScene, paint
from renderers.shading import prepare as prepare_shading
from renderers.studio.paint import paint as paint_studio
from renderers.studio.tables import StudioScene
from renderers.studio.tables import prepare as prepare_studio
from renderers.weaklru import WeakLru

GEOMETRY = Output.DEPTH | Output.LABEL | Output.INSTANCE | Output.NORMAL
"""Outputs of all geometry: both sides, opaque whatever the material says."""

MAX_SHADING_BYTES: Final = 1 << 30
"""Textures and attributes that prepared scenes keep alive; many scenes share them, so that this is an upper bound."""

_alike: dict[LookName, Alike[ShadingScene]] = {name: Alike(MAX_SHADING_BYTES // 2) for name in get_args(LookName)}
_shadings: WeakLru[DrawList, dict[LookName, ShadingScene]] = WeakLru(MAX_SHADING_BYTES)
_studios: WeakLru[DrawList, StudioScene] = WeakLru(MAX_SHADING_BYTES)


def _shading(scene: DrawList, look: LookName, parallel: Parallel) -> ShadingScene:
    """The draw list's tables for shading, made once while it is alive and drawn."""
    looks = _shadings.get(scene) or {}
    known = looks.get(look)
    if known is None:
        known = _alike[look].get(scene.instances)
        if known is None:  # else: the same meshes and materials, in other places
            known = prepare_shading(scene.instances, look, parallel)
            _alike[look].put(scene.instances, known, known.nbytes)
        looks = {**looks, look: known}
        _shadings.put(scene, looks, sum(tables.nbytes for tables in looks.values()))
    return known


def _studio(scene: DrawList) -> StudioScene:
    """The draw list's tables for the ``studio`` look, made once while it is alive and drawn."""
    known = _studios.get(scene)
    if known is None:
        known = prepare_studio(scene.instances)
        _studios.put(scene, known, known.nbytes)
    return known


class CpuRenderer:
    """Draws on the CPU. Thread-safe; the same scene gives the same bytes on any number of threads.

    Also the ``Rasterizer`` that shading asks for further layers and for threads.
    """

    def __init__(self, threads: int | None = None) -> None:
        """
        Args:
            threads: how many threads, the callers of ``render`` among them, may work at the same time inside frames;
                None: as many as this machine has. Concurrent callers share them: each works on its own frame.
        """
        self._crew = Crew(threads if threads is not None else os.cpu_count() or 1)
        self._pool = ArrayPool()
        self._scratch = ScratchPool()

    @property
    def threads(self) -> int:
        """Threads that may work inside frames."""
        return self._crew.threads

    def close(self) -> None:
        """End the helper threads; frames in work are finished."""
        self._crew.close()

    def render(self, scene: DrawList, camera: Camera, outputs: Output, look: Look = Look()) -> Frame:
        """As ``Renderer.render``.

        Raises:
            ImageError: a texture that colour needs cannot be decoded.
            ValueError, TypeError: the picture is larger than MAX_SIDE, or a mesh breaks its promises.
        """
        if not camera.width <= MAX_SIDE >= camera.height:
            raise ValueError(f"camera size {camera.width}x{camera.height} is larger than {MAX_SIDE}x{MAX_SIDE}")
        prepared = prepare(scene)
        shape = (camera.height, camera.width)
        taken: list[NDArray[Any]] = []
        all_wanted = outputs.value

        def take(wanted: Output, shape: tuple[int, ...], dtype: type[np.generic]) -> NDArray[Any] | None:
            if not wanted.value & all_wanted:  # operators of flags take microseconds
                return None
            taken.append(self._pool.take(shape, dtype))
            return taken[-1]

        frame = Frame(
            color=take(Output.COLOR, (*shape, 3), np.uint8),
            depth=take(Output.DEPTH, shape, np.float32),
            label=take(Output.LABEL, shape, np.uint32),
            instance=take(Output.INSTANCE, shape, np.int32),
            normal=take(Output.NORMAL, (*shape, 3), np.float32),
            _release=self._releaser(taken),
        )
        try:
            with self._crew.caller():
                if frame.color is None:
                    self._geometry(prepared, camera, frame)
                else:
                    self._color(
                        prepared, scene, camera, look, frame, frame.color, with_geometry=bool(outputs & GEOMETRY)
                    )
        except BaseException:
            frame.close()
            raise
        return frame

    def visibility(
        self,
        scene: DrawList,
        camera: Camera,
        *,
        select: NDArray[np.bool_] | None = None,
        cull_back: NDArray[np.bool_] | None = None,
        beyond: Visibility | None = None,
        before: Visibility | None = None,
    ) -> Visibility:
        """As ``Rasterizer.visibility``."""
        return self._visibility(
            prepare(scene), camera, select=select, cull_back=cull_back, beyond=beyond, before=before
        )

    def sampled(
        self,
        scene: DrawList,
        camera: Camera,
        samples: int,
        begin: Callable[[SampledView], Callable[[int, NDArray[np.int64]], None]],
        *,
        cull_back: NDArray[np.bool_] | None = None,
    ) -> None:
        """As ``Rasterizer.sampled``."""
        prepared = prepare(scene)
        scratch = self._scratch.take()
        try:
            job = FrameJob(prepared, camera, scratch, cull_back=cull_back, samples=samples)
            memory = EdgeMemory(scratch, self._crew.threads, camera, samples, job.stride)
            work = begin(SampledView(prepared.first_record, job.X_camera_mesh, job.stride))

            def draw(job_at: int, lens_at: int, band: int) -> None:
                with memory.taken() as edges:
                    edges_at = address_of(edges, np.int64)
                    draw_samples(job_at, lens_at, band, edges_at)
                    find_edges(job_at, band, edges_at)
                    work(band, edges)

            self._crew.run(job.phases(self._crew.threads, draw=draw), alone=job.small)
        finally:
            self._scratch.give(scratch)

    def parallel(self, units: int, work: Callable[[int], object]) -> None:
        """As ``Rasterizer.parallel``."""
        self._crew.run((Phase(units, work),))

    def _releaser(self, arrays: list[NDArray[Any]]) -> Callable[[], None]:
        def release() -> None:
            for array in arrays:
                self._pool.give(array)

        return release

    def _geometry(self, prepared: PreparedScene, camera: Camera, frame: Frame) -> None:
        """Fill the frame's geometry outputs; the layer itself stays in the cache, band by band."""
        scratch = self._scratch.take()
        try:
            job = FrameJob(prepared, camera, scratch, opaque=True)
            job.outputs(frame)
            self._crew.share(job.task(self._crew.threads))
        finally:
            # Nothing works on these any more: run() returns when all units have ended.
            self._scratch.give(scratch)

    def _color(
        self,
        prepared: PreparedScene,
        scene: DrawList,
        camera: Camera,
        look: Look,
        frame: Frame,
        color: NDArray[np.uint8],
        *,
        with_geometry: bool,
    ) -> None:
        """Fill all outputs of a frame with colour. One rasterization serves all of them: a band is shaded while it is
        in the cache, before the back faces that only geometry shows are drawn on top. Translucent scenes, samples and
        the studio look take several.
        """
        if with_geometry and (look.name == "studio" or look.samples != 1):
            self._geometry(prepared, camera, frame)
        if look.name == "studio":
            paint_studio(self, scene, _studio(scene), camera, look.rig, look.samples, look.background, color)
            return
        shading = _shading(scene, look.name, self.parallel)
        if shading.translucent:
            if look.samples != 1:
                paint_each_sample(self, scene, shading, camera, look, color)
                return
            if with_geometry:
                self._geometry(prepared, camera, frame)
            paint(self, scene, shading, camera, look, color)
            return
        cull = shading.cull_back if shading.culls else None
        if look.samples != 1:

            def begin(view: SampledView) -> Callable[[int, NDArray[np.int64]], None]:
                painter = Painter(
                    shading, view.X_camera_mesh, view.first_record, camera, look, color, stride=view.stride
                )
                return mixed_bands(painter, view.stride)

            self.sampled(scene, camera, look.samples, begin, cull_back=cull)
            return
        scratch = self._scratch.take()
        try:
            job = FrameJob(prepared, camera, scratch, cull_back=cull, keep_backs=with_geometry, opaque=True)
            job.outputs(frame)
            painter = Painter(shading, job.X_camera_mesh, prepared.first_record, camera, look, color, stride=job.stride)
            self._crew.share(job.task(self._crew.threads, painter.job))
        finally:
            self._scratch.give(scratch)

    def _visibility(
        self,
        prepared: PreparedScene,
        camera: Camera,
        *,
        select: NDArray[np.bool_] | None = None,
        cull_back: NDArray[np.bool_] | None = None,
        beyond: Visibility | None = None,
        before: Visibility | None = None,
    ) -> Visibility:
        """Rasterize one layer."""
        shape = (camera.height, camera.width)
        arrays = [self._pool.take(shape, np.int32), self._pool.take(shape, np.float32)]
        scratch = self._scratch.take()
        try:
            job = FrameJob(prepared, camera, scratch, select=select, cull_back=cull_back)
            job.layers(arrays[0], arrays[1], beyond, before)
            self._crew.share(job.task(self._crew.threads))
        finally:
            self._scratch.give(scratch)
        return Visibility(
            ids=arrays[0],
            inv_z=arrays[1],
            first_record=prepared.first_record,
            X_camera_mesh=job.X_camera_mesh,
            _release=self._releaser(arrays),
        )
