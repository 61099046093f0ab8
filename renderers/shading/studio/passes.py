"""Rendering of the colour image in the look ``studio``: shadow maps, visibility, shading, blending."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.color import linear_from_srgb
from renderers.compiler.kernel_calls import kernel_address
from renderers.compiler.pointers import address_of
from renderers.compiler.simd import LANES
from renderers.drawlist import DrawList, Light
from renderers.light_rig import MAX_SHADOWS, Rig
from renderers.msaa import SampleBand, sample_cameras
from renderers.shading.depth_peeling import for_bands, peeled
from renderers.shading.scene import ShadingJob, ShadingScene
from renderers.shading.studio import layout
from renderers.shading.studio.environment_map import environment_of, split_sum
from renderers.shading.studio.lights import dimmed_to_expose, light_structs
from renderers.shading.studio.shade_rows import ADD, BENEATH, EDGES, WRITE_ALPHA, shade_rows
from renderers.shading.studio.shadows import (
    ShadowMap,
    casters,
    metres_per_pixel,
    render_shadow_maps,
    shadow_map_structs,
    visible_points,
)
from renderers.shading.studio.tone_mapping import SRGB_CELLS, TONES, write_image_rows
from renderers.stop import current_stop
from renderers.visibility_buffer import Rasterizer, SampledShader, SampledView, Visibility


def paint(
    rasterizer: Rasterizer,
    scene: DrawList,
    shading: ShadingScene,
    camera: Camera,
    rig: Rig,
    samples: int,
    background: tuple[int, int, int],
    color: NDArray[np.uint8],
) -> None:
    """Render the colour image.

    Opaque surfaces are rasterized with all samples at once. Each surface is shaded once per pixel. Pixels that
    translucent or cut-out surfaces cover are peeled and shaded at each sample position, since the alpha of textures may
    have edges. Colours are tone-mapped before they are blended.

    Args:
        shading: prepared from the scene's instances for the look ``studio``.
        background: RGB as stored in the image.
        color: (H, W, 3), C-contiguous; every pixel is written.

    Raises:
        SurroundingsError: the rig's image of the surroundings cannot be used.
        ValueError: ``samples`` is not 1, 4 or 8.
    """
    cull_back = shading.cull_back
    opaque = ~shading.transparent if shading.has_transparency else None
    cameras = sample_cameras(camera, samples)
    lights = rig.lights_of(scene)
    is_metered = bool(scene.lights) and rig.scene_lights and rig.auto_exposure
    has_shadows = rig.shadow_size != 0 and any(light.casts_shadow for light in lights)
    has_shadows = has_shadows and bool(casters(scene.instances).any())
    visible: Visibility | None = None
    if has_shadows or is_metered or opaque is not None or samples == 1:
        visible = rasterizer.visibility(scene, cameras[0], select=opaque, cull_back=cull_back)
    shadow_maps: list[ShadowMap] = []
    map_of_light = [-1] * len(lights)
    points = visible_points(visible, cameras[0]) if visible is not None else np.zeros((0, 3))
    if is_metered:
        lights = dimmed_to_expose(lights, points)
    if has_shadows:
        shadow_maps, map_of_light = render_shadow_maps(
            rasterizer,
            scene,
            lights,
            points,
            rig.shadow_size,
            metres_per_pixel(points, camera),
            MAX_SHADOWS,
            shading.transparent,
            partial(_solid_pixels, rasterizer, shading),
        )
    lighting = _lighting(rig, lights, shadow_maps, map_of_light, camera)
    output = np.empty(1, layout.StudioOutput.dtype)
    output[0] = layout.StudioOutput.record(
        background=[linear_from_srgb(value / 255.0) for value in background],
        srgb_cells=address_of(SRGB_CELLS, np.int32),
        color=address_of(color, np.uint8),
    )
    output_address = address_of(output, layout.StudioOutput.dtype)
    if samples > 1:

        def make_shader(view: SampledView) -> SampledShader:
            job = StudioJob(shading, lighting, view, camera, EDGES, output=output_address)
            return SampledShader(kernel_address(shade_rows), job.address, job)

        rasterizer.shade_samples(scene, camera, samples, make_shader, select=opaque, cull_back=cull_back)
    elif opaque is None and visible is not None:
        _layer_shader(rasterizer, shading, lighting, visible, camera, ADD, output=output_address)(visible.ids)
    if opaque is not None:
        assert visible is not None  # rendered above
        _draw_transparent(rasterizer, scene, shading, lighting, cameras, visible, output, color)


def _draw_transparent(
    rasterizer: Rasterizer,
    scene: DrawList,
    shading: ShadingScene,
    lighting: LightingJob,
    cameras: Sequence[Camera],
    visible: Visibility,
    output: NDArray[np.void],
    color: NDArray[np.uint8],
) -> None:
    """Draw the pixels that transparent surfaces cover with all surfaces behind each other; with one sample, all pixels.

    Args:
        cameras: one for each sample; ``visible`` has the opaque surfaces that the first one sees.
        output: the StudioOutput of the image, which is changed.
        color: (H, W, 3), the image; with several samples, opaque surfaces are drawn.
    """
    covered, part = np.ones(color.shape[:2], np.bool_), color
    if len(cameras) > 1:
        rows, columns, covered = _covered_pixels(rasterizer, scene, shading, cameras)
        if not covered.size:
            return
        part = color[rows, columns]
        cameras = tuple(_window_camera(each, rows, columns) for each in cameras)
        ids = np.ascontiguousarray(visible.ids[rows, columns])
        visible = replace(visible, ids=ids, inv_z=np.ascontiguousarray(visible.inv_z[rows, columns]))
    mean = _peeled_mean(rasterizer, scene, shading, lighting, cameras, visible, covered)
    blended = np.empty(part.shape, np.uint8)
    output["color"] = address_of(blended, np.uint8)
    output_address = address_of(output, layout.StudioOutput.dtype)
    write_rows = partial(write_image_rows, address_of(mean, np.float32), output_address, cameras[0].width)
    for_bands(rasterizer, cameras[0].height, write_rows)
    np.copyto(part, blended, where=covered[..., None])


def _covered_pixels(
    rasterizer: Rasterizer, scene: DrawList, shading: ShadingScene, cameras: Sequence[Camera]
) -> tuple[slice, slice, NDArray[np.bool_]]:
    """Return rows and columns of the pixels in which transparent surfaces cover a sample, and a mask of them there.

    Hidden surfaces count, too. The columns are whole vectors if the image permits: layers of other widths are copied.
    """
    covered = np.zeros((cameras[0].height, cameras[0].width), np.bool_)
    for camera in cameras:
        layer = rasterizer.visibility(scene, camera, select=shading.transparent, cull_back=shading.cull_back)
        covered |= layer.ids >= 0
    used_rows, used_columns = np.flatnonzero(covered.any(axis=1)), np.flatnonzero(covered.any(axis=0))
    if not len(used_rows):
        return slice(0), slice(0), covered[:0, :0]
    rows = slice(int(used_rows[0]), int(used_rows[-1]) + 1)
    columns = slice(int(used_columns[0]) & -LANES, min((int(used_columns[-1]) | LANES - 1) + 1, cameras[0].width))
    return rows, columns, covered[rows, columns]


def _window_camera(camera: Camera, rows: slice, columns: slice) -> Camera:
    """Return the camera of a part of an image."""
    width, height = columns.stop - columns.start, rows.stop - rows.start
    return replace(camera, width=width, height=height, cx=camera.cx - columns.start, cy=camera.cy - rows.start)


def _peeled_mean(
    rasterizer: Rasterizer,
    scene: DrawList,
    shading: ShadingScene,
    lighting: LightingJob,
    cameras: Sequence[Camera],
    first_view: Visibility,
    covered: NDArray[np.bool_],
) -> NDArray[np.float32]:
    """Peel and shade the scene at each sample position, and return the mean of the samples.

    Args:
        cameras: one for each sample; ``first_view`` has the opaque surfaces that the first one sees.
        covered: (H, W), pixels to shade.

    Returns:
        (H, 4, V) float32, the rows that ``shade_rows`` accumulates with ``BENEATH``.
    """
    height, width = cameras[0].height, cameras[0].width
    shape = height, 4, layout.channel_values(width)
    mean = np.zeros(shape, np.float32)
    for camera in cameras:
        accumulated = mean if len(cameras) == 1 else np.zeros(shape, np.float32)
        target, view = address_of(accumulated, np.float32), first_view
        if camera is not cameras[0]:
            view = rasterizer.visibility(scene, camera, select=~shading.transparent, cull_back=shading.cull_back)
        shade = _layer_shader(rasterizer, shading, lighting, view, camera, BENEATH, target=target)
        for layer in peeled(rasterizer, scene, camera, shading.transparent, shading.cull_back, view):
            shade(layer.ids)
            layer.ids[accumulated[:, 3, :width] >= 1.0] = -1  # surfaces behind are invisible
        view.ids[~covered] = -1
        shade(view.ids)
        if accumulated is not mean:
            mean += accumulated * np.float32(1.0 / len(cameras))
    return mean


class StudioJob:
    """The StudioInputs of an image or layer. Immutable, thread-safe. The addresses given to it must outlive it."""

    def __init__(
        self,
        shading: ShadingScene,
        lighting: LightingJob,
        view: Visibility | SampledView,
        camera: Camera,
        mode: int,
        *,
        target: int = 0,
        output: int = 0,
    ) -> None:
        """
        Args:
            mode, target, output: as in StudioInputs.
        """
        first_ids, X_camera_mesh = address_of(view.first_ids, np.int64), address_of(view.X_camera_mesh, np.float64)
        shading_job = ShadingJob(
            shading, camera, first_ids, X_camera_mesh, reads_positions=True, reads_flat_normals=True
        )
        job = np.empty(1, layout.StudioInputs.dtype)
        job[0] = layout.StudioInputs.record(
            shading=shading_job.address,
            lighting=lighting.address,
            mode=mode,
            width=camera.width,
            target=target,
            output=output,
        )
        self.address = address_of(job, layout.StudioInputs.dtype)
        """Valid while this object is alive."""
        self._keep = (shading_job, lighting, view.first_ids, view.X_camera_mesh, job)


def _layer_shader(
    rasterizer: Rasterizer,
    shading: ShadingScene,
    lighting: LightingJob,
    layer: Visibility,
    camera: Camera,
    mode: int,
    **rows: int,
) -> Callable[[NDArray[np.int32]], None]:
    """Return a function that shades layers of a view, given their ids; ``rows``: ``target`` or ``output``."""
    job = StudioJob(shading, lighting, layer, camera, mode, **rows)

    def shade_band(ids: NDArray[np.int32], begin: int, end: int) -> None:
        band = np.zeros(1, SampleBand.dtype)
        band["ids"] = address_of(ids[begin:], np.int32)
        shade_rows(job.address, address_of(band, SampleBand.dtype), camera.width, begin, end)

    return lambda ids: for_bands(rasterizer, camera.height, partial(shade_band, ids))


def _solid_pixels(
    rasterizer: Rasterizer, shading: ShadingScene, layer: Visibility, camera: Camera
) -> NDArray[np.bool_]:
    """Return a mask of the pixels where a layer is not cut out, (H, W)."""
    alpha = np.zeros((camera.height, layout.channel_values(camera.width)), np.float32)
    target = address_of(alpha, np.float32)
    _layer_shader(rasterizer, shading, LightingJob(), layer, camera, WRITE_ALPHA, target=target)(layer.ids)
    solid: NDArray[np.bool_] = alpha[:, : camera.width] > 0.0
    return solid


class LightingJob:
    """A StudioLighting of an image, in its camera's frame."""

    def __init__(self, *keep: object, **fields: Any) -> None:
        """
        Args:
            keep: objects that the addresses in ``fields`` point into.
        """
        struct, stop = np.empty(1, layout.StudioLighting.dtype), current_stop()
        struct[0] = layout.StudioLighting.record(stop=stop.address, **fields)
        self.address = address_of(struct, layout.StudioLighting.dtype)
        """Valid while this object is alive."""
        self._keep = (struct, stop, keep)


def _lighting(
    rig: Rig, lights: Sequence[Light], shadow_maps: Sequence[ShadowMap], map_of_light: Sequence[int], camera: Camera
) -> LightingJob:
    """Return the StudioLighting of an image; ``map_of_light`` has the index of each light's shadow map, or -1."""
    light_array, map_array = light_structs(lights, map_of_light, camera), shadow_map_structs(shadow_maps, camera)
    environment, environment_fields = None, dict[str, int]()
    if rig.surroundings is not None:
        environment = environment_of(rig.surroundings)
        environment_fields = {
            "has_environment": 1,
            "environment_texels": address_of(environment.texels, np.float32),
            "environment_tables": address_of(environment.tables, np.int32),
            "split_sum": address_of(split_sum(), np.float32),
            "split_sum_side": len(split_sum()),
        }
    return LightingJob(
        light_array,
        map_array,
        shadow_maps,
        environment,
        lights=address_of(light_array, layout.StudioLight.dtype),
        light_count=len(lights),
        shadow_maps=address_of(map_array, layout.StudioShadowMap.dtype),
        shadow_radius=rig.shadow_radius,
        R_world_camera=camera.X_world_camera[:3, :3].reshape(-1),
        exposure=rig.exposure,
        tone=TONES.index(rig.tone),
        **environment_fields,
    )
