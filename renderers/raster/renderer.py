"""The reference renderer: ``renderers.interface.Renderer`` on this machine's cores."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Final, get_args

import numpy as np
from numpy.typing import NDArray

from renderers.alike import Alike
from renderers.camera import Camera
from renderers.compiler.pointers import address_of
from renderers.drawlist import Cast, DrawList
from renderers.interface import Frame, Look, LookName, Output
from renderers.raster.buffer_pool import ArrayPool, Kinds, Pooled, Scratch, ScratchPool
from renderers.raster.frame import FrameJob, Task
from renderers.raster.frame_threads import Crew, Phase
from renderers.raster.layout import MAX_SIDE
from renderers.raster.msaa.resolve import edge_kernels, edge_memory, mixed_bands, paint_each_sample
from renderers.raster.scene import PreparedScene, prepare
from renderers.shading import Painter, Parallel, ShadingScene, paint
from renderers.shading import prepare as prepare_shading
from renderers.shading.studio.passes import paint as paint_studio
from renderers.stop import check_stop
from renderers.visibility_buffer import SampledShader, SampledView, Visibility
from renderers.weaklru import WeakLru

_PICTURES: Final = (
    (Output.COLOR.value, True, np.uint8),
    (Output.DEPTH.value, False, np.float32),
    (Output.LABEL.value, False, np.uint32),
    (Output.INSTANCE.value, False, np.int32),
    (Output.NORMAL.value, True, np.float32),
)
"""A frame's pictures in their order: who wants it, whether its values are vectors, their type. All but the first show
all geometry: both sides, opaque whatever the material says."""


@lru_cache(256)
def _pictures(wanted: int, height: int, width: int) -> tuple[Kinds, tuple[int, ...]]:
    """Shapes and dtypes of the pictures that are wanted, and for each in ``_PICTURES`` its place among them; -1: not
    wanted."""
    kinds: list[tuple[tuple[int, ...], type[np.generic]]] = []
    order = []
    for each, vectors, dtype in _PICTURES:
        order.append(len(kinds) if wanted & each else -1)
        if wanted & each:
            kinds.append(((height, width, 3) if vectors else (height, width), dtype))
    return tuple(kinds), tuple(order)


MAX_SHADING_BYTES: Final = 1 << 30
"""Textures and attributes that prepared scenes keep alive; many scenes share them, so that this is an upper bound."""

_alike: dict[LookName, Alike[ShadingScene]] = {name: Alike(MAX_SHADING_BYTES // 2) for name in get_args(LookName)}
_shadings: WeakLru[DrawList | Cast, dict[LookName, ShadingScene]] = WeakLru(MAX_SHADING_BYTES)


def _shading(scene: DrawList, look: LookName, parallel: Parallel) -> ShadingScene:
    """The draw list's tables for shading, made once while it is alive and drawn."""
    who = scene.who
    looks = _shadings.get(who) or {}
    known = looks.get(look)
    if known is None:
        known = _alike[look].get(scene.instances)
        if known is None:  # else: the same meshes and materials, in other places
            known = prepare_shading(scene.instances, look, parallel)
            check_stop()
            _alike[look].put(scene.instances, known, known.nbytes)
        looks = {**looks, look: known}
        _shadings.put(who, looks, sum(tables.nbytes for tables in looks.values()))
    return known


class CpuRenderer:
    """Draws on the CPU. Thread-safe; the same scene gives the same bytes on any number of threads.

    Also the ``Rasterizer`` that shading asks for further layers and for threads.
    """

    def __init__(self, threads: int | None = None, spare: Callable[[], int] | None = None) -> None:
        """
        Args:
            threads: how many threads, the callers of ``render`` among them, may work at the same time inside frames;
                None: as many as this machine has. Concurrent callers share them: each works on its own frame.
            spare: tells how many processors nobody has work for but the frames; no more threads help than that.
        """
        self._crew = Crew(threads if threads is not None else os.cpu_count() or 1, spare)
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
        kinds, order = _pictures(outputs.value, camera.height, camera.width)  # operators of flags take microseconds
        taken = self._pool.take(kinds)
        arrays, addresses = (*taken.arrays, None), (*taken.addresses, 0)
        places = [addresses[at] for at in order]
        color, depth, label, instance, normal = [arrays[at] for at in order]
        frame = Frame(color, depth, label, instance, normal, self._releaser(taken))
        try:
            with self._crew:
                if frame.color is None:
                    self._geometry(prepared, camera, frame, places)
                else:
                    self._color(prepared, scene, camera, look, frame, frame.color, places)
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
        begin: Callable[[SampledView], SampledShader],
        *,
        cull_back: NDArray[np.bool_] | None = None,
    ) -> None:
        """As ``Rasterizer.sampled``."""
        prepared = prepare(scene)
        scratch = self._scratch.take()
        try:
            culled = address_of(cull_back, np.bool_)
            threads = self._crew.threads
            job = FrameJob(prepared, camera, scratch, threads, cull_back=culled, samples=samples)
            memory = edge_memory(scratch, threads, camera, samples, job.stride)
            shader = begin(SampledView(prepared.cast.structure.first_record, job.X_camera_mesh, job.stride))
            self._crew.share(job.sampled_task(*edge_kernels(), memory, shader))
        finally:
            self._scratch.give(scratch)

    def parallel(self, units: int, work: Callable[[int], object]) -> None:
        """As ``Rasterizer.parallel``."""
        self._crew.run((Phase(units, work),))

    def _releaser(self, taken: Pooled) -> Callable[[], None]:
        return lambda: self._pool.give(taken)

    def _geometry(self, prepared: PreparedScene, camera: Camera, frame: Frame, places: Sequence[int]) -> None:
        """Fill the frame's geometry outputs; the layer itself stays in the cache, band by band.

        Args:
            places: addresses of the frame's pictures, in the order of ``_PICTURES``.
        """
        scratch = self._scratch.take()
        try:
            job = FrameJob(prepared, camera, scratch, self._crew.threads, opaque=True)
            job.outputs(frame, places[1:])
            self._crew.share(job.task())
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
        places: Sequence[int],
    ) -> None:
        """Fill all outputs of a frame with colour. One rasterization serves all of them: a band is shaded while it is
        in the cache, before the back faces that only geometry shows are drawn on top. Translucent scenes, samples and
        the studio look take several.

        Args:
            places: as for ``_geometry``.
        """
        with_geometry = any(places[1:])
        if with_geometry and (look.name == "studio" or look.samples != 1):
            self._geometry(prepared, camera, frame, places)
        if look.name == "studio":
            shading = _shading(scene, look.name, self.parallel)
            paint_studio(self, scene, shading, camera, look.rig, look.samples, look.background, color)
            return
        shading = _shading(scene, look.name, self.parallel)
        if shading.has_transparency:
            if look.samples != 1:
                paint_each_sample(self, scene, shading, camera, look, color)
                return
            if with_geometry:
                self._geometry(prepared, camera, frame, places)
            paint(self, scene, shading, camera, look, color)
            return
        scratch = self._scratch.take()
        try:
            self._crew.share(self._task(prepared, shading, camera, look, frame, color, places, scratch, with_geometry))
        finally:
            self._scratch.give(scratch)

    def _task(
        self,
        prepared: PreparedScene,
        shading: ShadingScene,
        camera: Camera,
        look: Look,
        frame: Frame,
        color: NDArray[np.uint8],
        places: Sequence[int],
        scratch: Scratch,
        with_geometry: bool,
    ) -> Task:
        """What draws an opaque frame in one pass; ``prepared``, ``shading`` and the frame's arrays must outlive it."""
        culled, threads = shading.cull_at if shading.culls else 0, self._crew.threads
        if look.samples == 1:
            job = FrameJob(prepared, camera, scratch, threads, cull_back=culled, keep_backs=with_geometry, opaque=True)
            job.outputs(frame, places[1:])
        else:
            job = FrameJob(prepared, camera, scratch, threads, cull_back=culled, samples=look.samples)
        painter = Painter(
            shading,
            (prepared.cast.first_record_at, job.poses_address, places[0], job.stride),
            camera,
            look,
            table=lambda values: scratch.table("painter", values),
            keep=(job, color),
        )
        if look.samples != 1:
            memory = edge_memory(scratch, threads, camera, look.samples, job.stride)
            # The scratch outlives the task, the job does not.
            shader = mixed_bands(painter, lambda values: scratch.table("mixed", values))
            return job.sampled_task(*edge_kernels(), memory, shader)
        return job.task(painter.job)

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
        taken = self._pool.take(((shape, np.int32), (shape, np.float32)))
        ids, inv_z = taken.arrays
        scratch = self._scratch.take()
        try:
            selected, culled = address_of(select, np.bool_), address_of(cull_back, np.bool_)
            job = FrameJob(prepared, camera, scratch, self._crew.threads, select=selected, cull_back=culled, kept=True)
            job.layers(ids, inv_z, beyond, before)
            self._crew.share(job.task())
            poses = job.X_camera_mesh.copy()
        except BaseException:
            self._pool.give(taken)
            raise
        finally:
            self._scratch.give(scratch)
        return Visibility(
            ids=ids,
            inv_z=inv_z,
            first_record=prepared.cast.structure.first_record,
            X_camera_mesh=poses,
            _release=self._releaser(taken),
        )
