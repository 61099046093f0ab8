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
from renderers.raster.msaa.resolve import allocate_sample_bands, mixing_shader, paint_each_sample
from renderers.raster.scene import PreparedScene, Structure, prepare
from renderers.shading import HeadlightJob, ShadingScene, paint, solid_pixels
from renderers.shading import prepare as prepare_shading
from renderers.shading.depth_peeling import draw_cut_outs
from renderers.shading.studio.passes import paint as paint_studio
from renderers.visibility_buffer import Rasterizer, SampledShader, SampledView, Visibility, band_count

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

    @property
    def color(self) -> NDArray[Any] | None:
        """The colour image, in bytes or roots."""
        return self.frame.color if self.frame.roots is None else self.frame.roots

    def without_color(self) -> _Call:
        """Return the call for the geometry outputs."""
        return replace(self, frame=replace(self.frame, color=None, roots=None), addresses=(0, *self.addresses[1:]))


@dataclass(frozen=True, slots=True, eq=False)
class _BandRasterizer:
    """The ``Rasterizer`` that draws and shades some bands of the images only. Layers see nothing in the others."""

    renderer: CpuRenderer
    bands: NDArray[np.int32]

    def visibility(self, scene: DrawList, camera: Camera, **bounds: Any) -> Visibility:
        return self.renderer.visibility(scene, camera, bands=self.bands, **bounds)

    def shade_samples(self, *arguments: Any, **selection: Any) -> None:
        raise NotImplementedError("bands have one sample a pixel: seldom does all of an image need peeling")

    def parallel(self, units: int, work: Callable[[int], object]) -> None:
        self.renderer.parallel(len(self.bands), lambda k: work(int(self.bands[k])))


def _cut_outs(call: _Call) -> NDArray[np.bool_]:
    """Return the instances of which parts may be missing in the geometry outputs, (I,) bool."""
    structure = call.prepared.instances.structure
    if call.look.name in VTK_LOOKS:
        return np.zeros_like(structure.masked)
    return structure.masked | structure.blended if call.look.alpha_threshold > 0.0 else structure.masked


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
            ValueError, TypeError: the image is larger than MAX_SIDE, a mesh is not as ``Mesh`` requires, or the image
                cannot be in roots (``Frame.roots``).
        """
        if not camera.width <= MAX_SIDE >= camera.height:
            raise ValueError(f"camera size {camera.width}x{camera.height} is larger than {MAX_SIDE}x{MAX_SIDE}")
        prepared = prepare(scene)
        frame, addresses = _allocate(outputs.value, camera.height, camera.width)
        for output, name in (
            (Output.LAMP_SHARE, "lamp_share"),
            (Output.KEY_FACTOR, "key_factor"),
            (Output.LIGHT, "light"),
        ):
            if output in outputs:
                setattr(frame, name, np.ones((camera.height, camera.width + LANES), np.float32))
        if Output.ROOTS in outputs:
            if Output.COLOR in outputs or look.name == "studio" or look.samples != 1:
                raise ValueError("roots take the place of colour, with one sample a pixel, not in the look studio")
            frame.roots, address = aligned((camera.height, camera.width + LANES), np.uint32)
            addresses = (address, *addresses[1:])
        self._draw(_Call(scene, prepared, camera, look, frame, addresses))
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
        behind: Visibility | None = None,
        in_front_of: Visibility | None = None,
        id_limits: NDArray[np.int32] | None = None,
        latest: bool = False,
        bands: NDArray[np.int32] | None = None,
    ) -> Visibility:
        """As ``Rasterizer.visibility``; ``bands``: bands of the image to draw, beyond which nothing is seen."""
        prepared = prepare(scene)
        job = FrameJob(
            prepared,
            camera,
            self._threads.threads,
            select=address_of(select, np.bool_),
            cull_back=address_of(cull_back, np.bool_),
            has_layer=True,
            bands=bands,
        )
        shape = camera.height, job.stride
        ids, inv_z = aligned(shape, np.int32)[0], aligned(shape, np.float32)[0]
        if bands is not None:
            ids.fill(-1)
        layer = Visibility(ids, inv_z, prepared.instances.first_ids, job.X_camera_mesh)
        job.layers(layer, behind, in_front_of, id_limits, latest=latest)
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
        shader = make_shader(SampledView(prepared.instances.first_ids, job.X_camera_mesh))
        bands = allocate_sample_bands(threads, camera, samples, job.stride)
        self._threads.share(job.sampled_task(*bands, shader))

    def parallel(self, units: int, work: Callable[[int], object]) -> None:
        """As ``Rasterizer.parallel``."""
        self._threads.run(units, work)

    def _draw(self, call: _Call) -> None:
        """Fill all outputs. Bands that see-through instances touch are drawn in layers, all others at once."""
        see_through = self._see_through(call)
        rasterizer: Rasterizer = self
        if (call.color is None or call.look.samples == 1) and see_through.any():
            bands = self._touched_bands(call, see_through)
            if 2 * len(bands) <= band_count(call.camera.height):
                self._draw_at_once(call, ~see_through)
                if not len(bands):
                    return
                rasterizer = _BandRasterizer(self, bands)
        if call.color is None:
            self._draw_geometry(call, rasterizer)
        else:
            self._draw_color(call, call.color, rasterizer)

    def _see_through(self, call: _Call) -> NDArray[np.bool_]:
        """Return the instances that are not opaque in all outputs, (I,) bool; none in colour images of ``studio``."""
        if call.color is None:
            return _cut_outs(call)
        if call.look.name == "studio":
            return np.zeros(call.prepared.instances.counts[0], np.bool_)
        shading = _shading(call.scene, call.prepared, call.look.name, self.parallel)
        see_through = shading.transparent | shading.blended_in_place
        if shading.has_transparency and any(call.addresses[1:]):
            see_through |= _cut_outs(call)
        return see_through

    def _touched_bands(self, call: _Call, select: NDArray[np.bool_]) -> NDArray[np.int32]:
        """Return the bands that some instances touch."""
        selected, threads, none = address_of(select, np.bool_), self._threads.threads, np.empty(0, np.int32)
        job = FrameJob(call.prepared, call.camera, threads, select=selected, has_layer=True, bands=none)
        self._threads.share(job.task())
        return job.touched_bands()

    def _draw_geometry(self, call: _Call, rasterizer: Rasterizer) -> None:
        """Fill the geometry outputs, with cut-outs by the alpha of the colour image."""
        cut_out = _cut_outs(call)
        if not cut_out.any():
            self._draw_at_once(call.without_color())
            return
        scene, camera = call.scene, call.camera
        look = replace(call.look, name="gltf") if call.look.name == "studio" else call.look
        solid = partial(solid_pixels, rasterizer, _shading(scene, call.prepared, look.name, self.parallel), look)
        visible = rasterizer.visibility(scene, camera, select=~cut_out)
        draw_cut_outs(rasterizer, scene, camera, cut_out, visible, solid)
        job = FrameJob(call.prepared, camera, self._threads.threads, outputs=call.addresses[1:], has_layer=True)
        rasterizer.parallel(band_count(camera.height), job.resolver(visible))

    def _draw_color(self, call: _Call, color: NDArray[Any], rasterizer: Rasterizer) -> None:
        """Fill all outputs, colour included; translucent scenes and the studio look take several rasterizations."""
        scene, camera, look = call.scene, call.camera, call.look
        shading = _shading(scene, call.prepared, look.name, self.parallel)
        if look.name != "studio" and not shading.has_transparency:
            self._draw_at_once(call)
            return
        if any(call.addresses[1:]):
            self._draw_geometry(call, rasterizer)
        if look.name == "studio":
            paint_studio(self, scene, shading, camera, look.rig, look.samples, look.background, color)
        elif look.samples != 1:
            paint_each_sample(self, scene, shading, camera, look, color)
        else:
            paint(rasterizer, scene, shading, camera, look, color, call.frame)

    def _draw_at_once(self, call: _Call, select: NDArray[np.bool_] | None = None) -> None:
        """Fill all outputs with instances that are opaque in them; ``select``: as in ``visibility``.

        With one sample per pixel, they are rasterized once: a band is shaded while it is in the cache, before the back
        faces that only geometry shows are drawn on top.
        """
        prepared, camera, look, threads = call.prepared, call.camera, call.look, self._threads.threads
        has_color, outputs, samples = call.color is not None, call.addresses[1:], 1
        if has_color and look.samples != 1:
            if any(outputs):
                self._draw_at_once(call.without_color(), select)
            outputs, samples = (0, 0, 0, 0), look.samples
        shading = _shading(call.scene, prepared, look.name, self.parallel) if has_color else None
        job = FrameJob(
            prepared,
            camera,
            threads,
            select=address_of(select, np.bool_),
            cull_back=address_of(shading.cull_back, np.bool_) if shading is not None else 0,
            keep_back_faces=any(outputs),
            opaque=True,
            samples=samples,
            outputs=outputs,
        )
        if shading is None:
            self._threads.share(job.task())
            return
        shading_job = HeadlightJob(
            shading,
            camera,
            look,
            first_ids=prepared.instances.tables["first_ids"],
            X_camera_mesh=job.poses_address,
            stride=job.stride,
            color=call.addresses[0],
            frame=call.frame if samples == 1 else Frame(),
        )
        if samples == 1:
            self._threads.share(job.task(shading_job.address))
        else:
            bands = allocate_sample_bands(threads, camera, samples, job.stride)
            self._threads.share(job.sampled_task(*bands, mixing_shader(shading_job)))
