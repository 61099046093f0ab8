"""The CPU renderer, the reference implementation of ``renderers.interface.Renderer``."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.cache import Cache
from renderers.camera import Camera
from renderers.compiler.pending import wait_until_compiled
from renderers.compiler.pointers import address_of
from renderers.drawlist import DrawList, InstanceSet, Material, Mesh
from renderers.interface import Frame, Look, LookName, Output
from renderers.raster.buffer_pool import ArrayPool, ArrayShapes, PooledArrays, Scratch, ScratchPool
from renderers.raster.frame import FrameJob, Task
from renderers.raster.frame_threads import FrameThreads, Phase
from renderers.raster.layout import MAX_SIDE
from renderers.raster.msaa.resolve import allocate_sample_bands, edge_kernels, mixed_bands, paint_each_sample
from renderers.raster.scene import PreparedScene, prepare
from renderers.shading import Painter, Parallel, ShadingScene, paint
from renderers.shading import prepare as prepare_shading
from renderers.shading.studio.passes import paint as paint_studio
from renderers.shading.studio.tables import StudioScene
from renderers.shading.studio.tables import prepare as prepare_studio
from renderers.stop import check_stop
from renderers.visibility_buffer import SampledShader, SampledView, Visibility

_OUTPUTS: Final = (
    (Output.COLOR.value, True, np.uint8),
    (Output.DEPTH.value, False, np.float32),
    (Output.LABEL.value, False, np.uint32),
    (Output.INSTANCE.value, False, np.int32),
    (Output.NORMAL.value, True, np.float32),
)
"""A frame's outputs in their order: flag, whether values are vectors, dtype. All but colour show all geometry: both
sides, opaque whatever the material says."""


def _layout_of(wanted: int, height: int, width: int) -> tuple[ArrayShapes, tuple[int, ...]]:
    """Return shapes and dtypes of the wanted outputs, and for each of ``_OUTPUTS`` its index among them, or -1."""
    shapes: list[tuple[tuple[int, ...], type[np.generic]]] = []
    order = []
    for flag, is_vector, dtype in _OUTPUTS:
        order.append(len(shapes) if wanted & flag else -1)
        if wanted & flag:
            shapes.append(((height, width, 3) if is_vector else (height, width), dtype))
    return tuple(shapes), tuple(order)


MAX_SHADING_BYTES: Final = 1 << 30
"""Limit of the tables for shading of scenes that are alive. Scenes share textures and attributes, which count for each,
so that this is an upper limit."""

_shadings: Cache[DrawList | InstanceSet, dict[LookName, ShadingScene]] = Cache(MAX_SHADING_BYTES, weak=True)
_shadings_of_meshes: Cache[tuple[Mesh, ...], dict[LookName, tuple[ShadingScene, tuple[Material, ...]]]] = Cache(
    MAX_SHADING_BYTES // 2, weak=True
)
_studios: Cache[DrawList | InstanceSet, StudioScene] = Cache(MAX_SHADING_BYTES, weak=True)


def _shading(scene: DrawList, look: LookName, parallel: Parallel) -> ShadingScene:
    """Return the draw list's tables for shading."""
    looks = _shadings.get(scene.identity) or {}
    tables = looks.get(look)
    if tables is None:
        tables = _shading_of_meshes(scene, look, parallel)
        looks = {**looks, look: tables}
        _shadings.put(scene.identity, looks, sum(each.nbytes for each in looks.values()))
    return tables


def _shading_of_meshes(scene: DrawList, look: LookName, parallel: Parallel) -> ShadingScene:
    """Return tables from the last draw list with the same meshes and materials: a live scene in which things move."""
    meshes = tuple([instance.mesh for instance in scene.instances])
    materials = tuple([instance.material for instance in scene.instances])
    looks = (_shadings_of_meshes.get(meshes) if meshes else None) or {}
    found = looks.get(look)
    if found is not None and all(a is b or a == b for a, b in zip(found[1], materials, strict=True)):
        return found[0]
    tables = prepare_shading(scene.instances, look, parallel)
    check_stop()
    if meshes:
        looks = {**looks, look: (tables, materials)}
        _shadings_of_meshes.put(meshes, looks, sum(each.nbytes for each, _ in looks.values()))
    return tables


def _studio(scene: DrawList) -> StudioScene:
    """Return the draw list's tables for the ``studio`` look."""
    tables = _studios.get(scene.identity)
    if tables is None:
        tables = prepare_studio(scene.instances)
        _studios.put(scene.identity, tables, tables.nbytes)
    return tables


class CpuRenderer:
    """Renders on the CPU. Thread-safe. The output is bit-identical for any number of threads.

    It is also the ``Rasterizer`` that shading uses for further layers and for threads.
    """

    def __init__(self, threads: int | None = None, spare: Callable[[], int] | None = None) -> None:
        """
        Args:
            threads: maximum number of threads that work inside frames, callers of ``render`` included; None: as many as
                the machine has. Concurrent callers share them: each works on its own frame.
            spare: returns the number of idle processors; no more helper threads are used than that.
        """
        self._threads = FrameThreads(threads if threads is not None else os.cpu_count() or 1, spare)
        self._pool = ArrayPool()
        self._scratch = ScratchPool()

    @property
    def threads(self) -> int:
        """Maximum number of threads that work inside frames."""
        return self._threads.threads

    def close(self) -> None:
        """End the helper threads after the frames in progress."""
        self._threads.close()

    def render(self, scene: DrawList, camera: Camera, outputs: Output, look: Look = Look()) -> Frame:
        """As ``Renderer.render``.

        Raises:
            ImageError: a texture that colour needs cannot be decoded.
            ValueError, TypeError: the image is larger than MAX_SIDE, or a mesh is not as ``Mesh`` requires.
        """
        if not camera.width <= MAX_SIDE >= camera.height:
            raise ValueError(f"camera size {camera.width}x{camera.height} is larger than {MAX_SIDE}x{MAX_SIDE}")
        prepared = prepare(scene)
        shapes, order = _layout_of(outputs.value, camera.height, camera.width)
        taken = self._pool.take(shapes)
        arrays, addresses = (*taken.arrays, None), (*taken.addresses, 0)
        output_addresses = [addresses[at] for at in order]
        color, depth, label, instance, normal = [arrays[at] for at in order]
        frame = Frame(color, depth, label, instance, normal, self._releaser(taken))
        try:
            with self._threads:
                if frame.color is None:
                    self._geometry(prepared, camera, frame, output_addresses)
                else:
                    self._color(prepared, scene, camera, look, frame, frame.color, output_addresses)
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
            threads = self._threads.threads
            job = FrameJob(prepared, camera, scratch, threads, cull_back=culled, samples=samples)
            memory = allocate_sample_bands(scratch, threads, camera, samples, job.stride)
            shader = begin(SampledView(prepared.instances.first_ids, job.X_camera_mesh, job.stride))
            self._threads.share(job.sampled_task(*edge_kernels(), memory, shader))
        finally:
            self._scratch.give(scratch)

    def parallel(self, units: int, work: Callable[[int], object]) -> None:
        """As ``Rasterizer.parallel``."""
        self._threads.run((Phase(units, work),))

    def _releaser(self, taken: PooledArrays) -> Callable[[], None]:
        return lambda: self._pool.give(taken)

    def _geometry(self, prepared: PreparedScene, camera: Camera, frame: Frame, addresses: Sequence[int]) -> None:
        """Fill the frame's geometry outputs; the layer itself is not kept.

        Args:
            addresses: of the frame's outputs, in the order of ``_OUTPUTS``.
        """
        scratch = self._scratch.take()
        try:
            job = FrameJob(prepared, camera, scratch, self._threads.threads, opaque=True)
            job.outputs(frame, addresses[1:])
            self._threads.share(job.task())
        finally:
            self._scratch.give(scratch)

    def _color(
        self,
        prepared: PreparedScene,
        scene: DrawList,
        camera: Camera,
        look: Look,
        frame: Frame,
        color: NDArray[np.uint8],
        addresses: Sequence[int],
    ) -> None:
        """Fill all outputs of a frame with colour.

        One rasterization serves all outputs: a band is shaded while it is in the cache, before the back faces that only
        geometry shows are drawn on top. Translucent scenes, several samples and the studio look take further ones.

        Args:
            addresses: as for ``_geometry``.
        """
        if look.name == "studio":
            wait_until_compiled("studio")
        if look.samples != 1:
            wait_until_compiled("antialiasing")
        with_geometry = any(addresses[1:])
        if with_geometry and (look.name == "studio" or look.samples != 1):
            self._geometry(prepared, camera, frame, addresses)
        if look.name == "studio":
            paint_studio(self, scene, _studio(scene), camera, look.rig, look.samples, look.background, color)
            return
        shading = _shading(scene, look.name, self.parallel)
        if shading.translucent:
            if look.samples != 1:
                paint_each_sample(self, scene, shading, camera, look, color)
                return
            if with_geometry:
                self._geometry(prepared, camera, frame, addresses)
            paint(self, scene, shading, camera, look, color)
            return
        scratch = self._scratch.take()
        try:
            self._threads.share(
                self._task(prepared, shading, camera, look, frame, color, addresses, scratch, with_geometry)
            )
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
        addresses: Sequence[int],
        scratch: Scratch,
        with_geometry: bool,
    ) -> Task:
        """Return the work of an opaque frame; ``prepared``, ``shading`` and the frame's arrays must outlive it."""
        culled, threads = shading.cull_at if shading.culls else 0, self._threads.threads
        if look.samples == 1:
            job = FrameJob(prepared, camera, scratch, threads, cull_back=culled, keep_backs=with_geometry, opaque=True)
            job.outputs(frame, addresses[1:])
        else:
            job = FrameJob(prepared, camera, scratch, threads, cull_back=culled, samples=look.samples)
        painter = Painter(
            shading,
            (prepared.instances.first_ids_at, job.poses_address, addresses[0], job.stride),
            camera,
            look,
            table=lambda values: scratch.table("painter", values),
            keep=(job, color),
        )
        if look.samples != 1:
            memory = allocate_sample_bands(scratch, threads, camera, look.samples, job.stride)
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
            job = FrameJob(
                prepared, camera, scratch, self._threads.threads, select=selected, cull_back=culled, kept=True
            )
            job.layers(ids, inv_z, beyond, before)
            self._threads.share(job.task())
            poses = job.X_camera_mesh.copy()
        except BaseException:
            self._pool.give(taken)
            raise
        finally:
            self._scratch.give(scratch)
        return Visibility(
            ids=ids,
            inv_z=inv_z,
            first_record=prepared.instances.first_ids,
            X_camera_mesh=poses,
            _release=self._releaser(taken),
        )
