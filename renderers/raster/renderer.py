"""The CPU renderer, the reference implementation of ``renderers.interface.Renderer``."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from renderers.cache import WeakCache
from renderers.camera import Camera
from renderers.compiler.pointers import address_of, aligned
from renderers.compiler.simd import LANES
from renderers.drawlist import DrawList
from renderers.interface import VTK_LOOKS, Frame, Look, LookName, Output, Parallel
from renderers.raster.frame import FrameJob
from renderers.raster.frame_threads import FrameThreads
from renderers.raster.layout import MAX_SIDE
from renderers.raster.msaa.resolve import allocate_sample_bands, mixed_bands, paint_each_sample
from renderers.raster.scene import PreparedScene, Structure, prepare
from renderers.shading import HeadlightJob, ShadingScene, paint, solid_pixels
from renderers.shading import prepare as prepare_shading
from renderers.shading.depth_peeling import draw_cut_outs
from renderers.shading.studio.passes import paint as paint_studio
from renderers.visibility_buffer import SampledShader, SampledView, Visibility, band_count

_OUTPUTS: Final[tuple[tuple[int, tuple[int, ...], type[np.generic]], ...]] = (
    (Output.COLOR.value, (3,), np.uint8),
    (Output.DEPTH.value, (), np.float32),
    (Output.LABEL.value, (), np.uint32),
    (Output.INSTANCE.value, (), np.int32),
    (Output.NORMAL.value, (3,), np.float32),
)
"""A frame's outputs in their order: flag, shape of a value, dtype. All but colour show both sides of all
surfaces. What is translucent is opaque there, or cut out: see ``Look.alpha_threshold``."""


def _allocate(wanted: int, height: int, width: int) -> tuple[Frame, tuple[int, ...]]:
    """Return a frame with the wanted outputs, and for each of ``_OUTPUTS`` its address; 0: not wanted."""
    images: list[NDArray[Any] | None] = []
    addresses = []
    for flag, value_shape, dtype in _OUTPUTS:
        image, address = aligned((height, width, *value_shape), dtype) if wanted & flag else (None, 0)
        images.append(image)
        addresses.append(address)
    return Frame(*images), tuple(addresses)


_shadings: WeakCache[Structure, dict[LookName, ShadingScene]] = WeakCache("shading")


def _shading(scene: DrawList, prepared: PreparedScene, look: LookName, parallel: Parallel) -> ShadingScene:
    """Return the tables for shading, which draw lists with the same meshes and materials share as their Structure."""
    structure = prepared.instances.structure
    looks = _shadings.get(structure) or {}
    tables = looks.get(look)
    if tables is None:
        tables = prepare_shading(scene.instances, look, parallel)
        looks = {**looks, look: tables}
        _shadings.put(structure, looks, sum(each.nbytes for each in looks.values()))
    return tables


@dataclass(frozen=True, slots=True, eq=False)
class _Call:
    """Arguments and images of one call of ``CpuRenderer.render``."""

    scene: DrawList
    prepared: PreparedScene
    camera: Camera
    look: Look
    frame: Frame
    addresses: tuple[int, ...]
    """Of the frame's images, in the order of ``_OUTPUTS``; 0: not wanted."""


class CpuRenderer:
    """Renders on the CPU. Thread-safe. The output is bit-identical for any number of threads.

    It is also the ``Rasterizer`` from which shading gets further layers and threads.
    """

    def __init__(self, threads: int | None = None, spare: Callable[[], int] | None = None) -> None:
        """
        Args:
            threads: maximum number of threads that work inside frames, callers of ``render`` included; None: as many as
                the machine has. Concurrent callers share them: each works on its own frame.
            spare: returns the number of idle processors; no more helper threads are used than that.
        """
        self._threads = FrameThreads(threads if threads is not None else os.cpu_count() or 1, spare)

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
            ImageError: a texture that colour or a cut-out needs cannot be decoded.
            ValueError, TypeError: the image is larger than MAX_SIDE, or a mesh is not as ``Mesh`` requires.
        """
        if not camera.width <= MAX_SIDE >= camera.height:
            raise ValueError(f"camera size {camera.width}x{camera.height} is larger than {MAX_SIDE}x{MAX_SIDE}")
        prepared = prepare(scene)
        frame, addresses = _allocate(outputs.value, camera.height, camera.width)
        if Output.LAMP_SHARE in outputs:
            fill = np.zeros if look.name == "gltf" else np.ones  # only this look writes it
            frame.lamp_share = fill((camera.height, camera.width + LANES), np.float32)
        call = _Call(scene, prepared, camera, look, frame, addresses)
        if frame.color is None:
            self._draw_geometry(call)
        else:
            self._draw_color(call, frame.color)
        if frame.depth is not None and camera.depth_origin != 0.0:
            np.subtract(frame.depth, np.float32(camera.depth_origin), out=frame.depth)
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
        earlier: NDArray[np.int32] | None = None,
        latest: bool = False,
    ) -> Visibility:
        """As ``Rasterizer.visibility``."""
        prepared = prepare(scene)
        job = FrameJob(
            prepared,
            camera,
            self._threads.threads,
            select=address_of(select, np.bool_),
            cull_back=address_of(cull_back, np.bool_),
            has_layer=True,
        )
        shape = camera.height, job.stride
        ids, inv_z = aligned(shape, np.int32)[0], aligned(shape, np.float32)[0]
        layer = Visibility(ids, inv_z, prepared.instances.first_ids, job.X_camera_mesh)
        job.layers(layer, beyond, before, earlier, latest=latest)
        self._threads.share(job.task())
        if job.stride == camera.width:
            return layer
        columns = slice(camera.width)
        ids, inv_z = np.ascontiguousarray(layer.ids[:, columns]), np.ascontiguousarray(layer.inv_z[:, columns])
        return replace(layer, ids=ids, inv_z=inv_z)

    def shade_samples(
        self,
        scene: DrawList,
        camera: Camera,
        samples: int,
        make_shader: Callable[[SampledView], SampledShader],
        *,
        select: NDArray[np.bool_] | None = None,
        cull_back: NDArray[np.bool_] | None = None,
    ) -> None:
        """As ``Rasterizer.shade_samples``."""
        prepared = prepare(scene)
        selected, culled = address_of(select, np.bool_), address_of(cull_back, np.bool_)
        threads = self._threads.threads
        job = FrameJob(prepared, camera, threads, select=selected, cull_back=culled, opaque=True, samples=samples)
        shader = make_shader(SampledView(prepared.instances.first_ids, job.X_camera_mesh, job.stride))
        bands = allocate_sample_bands(threads, camera, samples, job.stride)
        self._threads.share(job.sampled_task(*bands, shader))

    def parallel(self, units: int, work: Callable[[int], object]) -> None:
        """As ``Rasterizer.parallel``."""
        self._threads.run(units, work)

    def _draw_geometry(self, call: _Call) -> None:
        """Fill the geometry outputs; the visibility layer itself is not kept."""
        if call.look.name not in VTK_LOOKS:
            structure = call.prepared.instances.structure
            cut_out = structure.masked | structure.blended if call.look.alpha_threshold > 0.0 else structure.masked
            if cut_out.any():
                self._draw_cut_geometry(call, cut_out)
                return
        job = FrameJob(call.prepared, call.camera, self._threads.threads, opaque=True, outputs=call.addresses[1:])
        self._threads.share(job.task())

    def _draw_cut_geometry(self, call: _Call, cut_out: NDArray[np.bool_]) -> None:
        """Fill the geometry outputs of a scene with cut-outs, whose alpha is that of the colour image."""
        scene, camera = call.scene, call.camera
        look = replace(call.look, name="gltf") if call.look.name == "studio" else call.look
        solid = partial(solid_pixels, self, _shading(scene, call.prepared, look.name, self.parallel), look)
        visible = self.visibility(scene, camera, select=~cut_out)
        draw_cut_outs(self, scene, camera, cut_out, visible, solid)
        job = FrameJob(call.prepared, camera, self._threads.threads, outputs=call.addresses[1:], has_layer=True)
        self.parallel(band_count(camera.height), job.resolver(visible))

    def _draw_color(self, call: _Call, color: NDArray[np.uint8]) -> None:
        """Fill all outputs, colour included.

        Opaque scenes with one sample per pixel are rasterized once for all outputs. Translucent scenes, several samples
        and the studio look need further rasterizations.
        """
        scene, camera, look = call.scene, call.camera, call.look
        has_geometry = any(call.addresses[1:])
        if has_geometry and (look.name == "studio" or look.samples != 1):
            self._draw_geometry(call)
        shading = _shading(scene, call.prepared, look.name, self.parallel)
        if look.name == "studio":
            paint_studio(self, scene, shading, camera, look.rig, look.samples, look.background, color)
        elif not shading.has_transparency:
            self._draw_opaque(call, shading, has_geometry)
        elif look.samples != 1:
            paint_each_sample(self, scene, shading, camera, look, color)
        else:
            if has_geometry:
                self._draw_geometry(call)
            paint(self, scene, shading, camera, look, color, call.frame.lamp_share)

    def _draw_opaque(self, call: _Call, shading: ShadingScene, has_geometry: bool) -> None:
        """Fill the colour output of an opaque scene and, with one sample per pixel, the geometry outputs.

        A band is shaded while it is in the cache, before the back faces that only geometry shows are drawn on top.
        """
        prepared, camera, look, threads = call.prepared, call.camera, call.look, self._threads.threads
        culled = address_of(shading.cull_back, np.bool_)
        if look.samples == 1:
            job = FrameJob(
                prepared,
                camera,
                threads,
                cull_back=culled,
                keep_back_faces=has_geometry,
                opaque=True,
                outputs=call.addresses[1:],
            )
        else:
            job = FrameJob(prepared, camera, threads, cull_back=culled, opaque=True, samples=look.samples)
        shading_job = HeadlightJob(
            shading,
            camera,
            look,
            first_ids=prepared.instances.tables["first_ids"],
            X_camera_mesh=job.poses_address,
            stride=job.stride,
            color=call.addresses[0],
            lamp_share=call.frame.lamp_share if look.samples == 1 else None,
        )
        if look.samples == 1:
            self._threads.share(job.task(shading_job.address))
        else:
            bands = allocate_sample_bands(threads, camera, look.samples, job.stride)
            self._threads.share(job.sampled_task(*bands, mixed_bands(shading_job)))
