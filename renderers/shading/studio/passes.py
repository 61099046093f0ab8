"""Colour image of the look ``studio``."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.color import linear_from_srgb
from renderers.compiler.kernel_calls import kernel_address
from renderers.compiler.pointers import address_of
from renderers.drawlist import DrawList
from renderers.light_rig import MAX_LIGHTS, MAX_SHADOWS, Rig
from renderers.msaa import sample_cameras
from renderers.shading import layout as common
from renderers.shading.depth_peeling import peeled
from renderers.shading.scene import ShadingScene, map_instances
from renderers.shading.studio import layout as at
from renderers.shading.studio import shade_rows as k
from renderers.shading.studio.environment_map import Ambient, ambient_of, split_sum
from renderers.shading.studio.lights import light_table
from renderers.shading.studio.shadows import ShadowMap, draw_maps, pixel_size, shadow_tables, visible_points
from renderers.shading.studio.tone_mapping import finish_rows
from renderers.shading.studio.tonemap import SRGB_CELLS, TONES
from renderers.stop import current_stop

if TYPE_CHECKING:  # the rasterizer imports this module
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

    Opaque surfaces are rasterized with all samples at once and shaded once per pixel and surface. A scene with
    translucent or cut-out surfaces is peeled and shaded at each sample position, as edges may be in their textures.
    Fragments are tone-mapped and then blended in the linear light of the display.

    Args:
        rasterizer: renders visibility and runs bands.
        shading: prepared from the scene's instances for the look ``studio``.
        samples: 1, 4 or 8 per pixel.
        background: RGB as stored in the image.
        color: (H, W, 3) uint8, C-contiguous; every pixel is written.

    Raises:
        SurroundingsError: the rig's image of the surroundings cannot be used.
        ValueError: ``samples``.
    """
    from renderers.visibility_buffer import BAND_ROWS, SampledShader, band_count

    cull = shading.cull_back if shading.cull_back.any() else None
    opaque = ~shading.transparent if shading.transparent.any() else None
    cameras = sample_cameras(camera, samples)
    height, width = camera.height, camera.width
    bands = band_count(height)
    behind = np.array([linear_from_srgb(value / 255.0) for value in background], np.float32)
    finish = np.zeros(at.F_COLUMNS, np.int64)
    finish[at.F_BEHIND] = address_of(behind, np.float32)
    finish[at.F_CELLS] = address_of(SRGB_CELLS, np.int32)
    finish[at.F_COLOR] = address_of(color, np.uint8)
    finishing = address_of(finish, np.int64)

    def rows(unit: int) -> tuple[int, int]:
        return unit * BAND_ROWS, min((unit + 1) * BAND_ROWS, height)

    def cut(view: Visibility, lens: Camera) -> NDArray[np.bool_]:
        """Return where a layer is not cut out."""
        no_light = _Light(rig, light_table((), (), lens), 0, *shadow_tables((), lens), [], None)
        job, keep = _job(shading, view.X_camera_mesh, view.first_ids, lens, no_light)
        alpha = np.zeros((lens.height, at.line_of(lens.width)), np.float32)
        table, to, ids = address_of(job, np.int64), address_of(alpha, np.float32), address_of(view.ids, np.int32)

        def band(unit: int) -> None:
            begin, end = unit * BAND_ROWS, min((unit + 1) * BAND_ROWS, lens.height)
            where = ids + 4 * begin * lens.width, 0, lens.width
            k.shade_rows(k.CUT, table, *where, lens.width, begin, end, to, 0)

        rasterizer.parallel(band_count(lens.height), band)
        del keep
        there: NDArray[np.bool_] = alpha[:, : lens.width] > 0.0
        return there

    with ExitStack() as stack:
        lights = (scene.lights if scene.lights and rig.scene_lights else rig.lights)[:MAX_LIGHTS]
        shadowed = rig.shadow_size != 0 and any(light.casts_shadow for light in lights)
        seen: Visibility | None = None
        maps: list[ShadowMap] = []
        map_of = [-1] * len(lights)
        if shadowed or opaque is not None or samples == 1:
            seen = stack.enter_context(rasterizer.visibility(scene, cameras[0], select=opaque, cull_back=cull))
        if shadowed and seen is not None:
            points = visible_points(seen, cameras[0])
            pixel = pixel_size(points, camera)
            maps, map_of = draw_maps(
                rasterizer, scene, lights, points, rig.shadow_size, pixel, MAX_SHADOWS, shading.transparent, cut
            )
        ambient = ambient_of(rig.surroundings) if rig.surroundings is not None else None
        light = _Light(
            rig, light_table(lights, map_of, camera), len(lights), *shadow_tables(maps, camera), maps, ambient
        )

        def shade(view: Visibility, lens: Camera, mode: int, target: NDArray[np.float32] | None) -> None:
            """Shade a layer into ``target``; None: into the image."""
            job, keep = _job(shading, view.X_camera_mesh, view.first_ids, lens, light)
            table, to = address_of(job, np.int64), address_of(target, np.float32)
            ids = address_of(view.ids, np.int32)

            def band(unit: int) -> None:
                begin, end = rows(unit)
                k.shade_rows(mode, table, ids + 4 * begin * width, 0, width, width, begin, end, to, finishing)

            rasterizer.parallel(bands, band)
            del keep

        def begin_edges(view: SampledView) -> SampledShader:
            """Return the shader of a band's samples."""
            job, keep = _job(shading, view.X_camera_mesh, view.first_ids, camera, light)
            own = np.zeros(k.B_COLUMNS, np.int64)
            own[k.B_SHADE] = kernel_address(k.shade_rows)
            own[k.B_JOB] = address_of(job, np.int64)
            own[k.B_WIDTH] = width
            own[k.B_FINISH] = finishing
            return SampledShader(kernel_address(k.shade_edges), address_of(own, np.int64), (own, job, keep))

        if opaque is None:
            if samples == 1 and seen is not None:
                shade(seen, camera, k.ADD, None)
            else:
                rasterizer.shade_samples(scene, camera, samples, begin_edges, cull_back=cull)
            return
        shape = height, 4, at.line_of(width)
        out = np.zeros(shape, np.float32)
        for each_camera in cameras:
            own = out if samples == 1 else np.zeros(shape, np.float32)
            view = seen
            if view is None or each_camera is not cameras[0]:
                view = stack.enter_context(rasterizer.visibility(scene, each_camera, select=opaque, cull_back=cull))
            for layer in peeled(rasterizer, scene, shading, each_camera, cull, view):
                shade(layer, each_camera, k.BENEATH, own)
                layer.ids[own[:, 3, :width] >= 1.0] = -1  # nothing can be seen behind
            shade(view, each_camera, k.BENEATH, own)
            if samples > 1:
                out += own * np.float32(1.0 / samples)
        layers = address_of(out, np.float32)
        rasterizer.parallel(bands, lambda unit: finish_rows(layers, finishing, width, *rows(unit)))


@dataclass(frozen=True, slots=True, eq=False)
class _Light:
    """Light of an image, in its camera's frame."""

    rig: Rig
    lights: NDArray[np.float64]
    count: int
    floats: NDArray[np.float64]
    """``shadow_tables`` of the maps, as ``integers``."""
    integers: NDArray[np.int64]
    maps: list[ShadowMap]
    """Keeps the addresses in ``integers`` valid."""
    ambient: Ambient | None


def _job(
    shading: ShadingScene,
    X_camera_mesh: NDArray[np.float64],
    first_record: NDArray[np.int64],
    camera: Camera,
    light: _Light,
) -> tuple[NDArray[np.int64], tuple[object, ...]]:
    """Return a job, and the objects that its addresses point into."""
    X = X_camera_mesh if len(X_camera_mesh) else np.eye(4)[None]
    maps = np.empty((len(X), common.P_COLUMNS), np.float32)
    map_instances(address_of(X, np.float64), address_of(maps, np.float32), len(X))
    world = camera.X_world_camera[:3, :3]
    lens = np.array((camera.fx, camera.fy, camera.cx, camera.cy, light.rig.exposure, *world.flat))
    job = np.zeros(at.J_COLUMNS, np.int64)
    job[common.S_FIRST] = address_of(first_record, np.int64)
    job[common.S_COUNT] = len(first_record) - 1
    job[common.S_POINTS] = address_of(X, np.float64)
    job[common.S_MAPS] = address_of(maps, np.float32)
    job[common.S_LENS] = address_of(lens, np.float64)
    job[common.S_INSTANCES : common.S_COMMON] = shading.job
    job[at.J_LIGHTS] = address_of(light.lights, np.float64)
    job[at.J_LIGHT_COUNT] = light.count
    job[at.J_SHADOW_FLOATS] = address_of(light.floats, np.float64)
    job[at.J_SHADOW_INTEGERS] = address_of(light.integers, np.int64)
    job[at.J_SHADOW_RADIUS] = light.rig.shadow_radius
    if light.ambient is not None:
        job[at.J_RADIANCE] = address_of(light.ambient.texels, np.float32)
        job[at.J_LEVELS] = address_of(light.ambient.places, np.int32)
        job[at.J_SPLIT] = address_of(split_sum(), np.float32)
        job[at.J_SPLIT_SIDE] = split_sum().shape[0]
    job[at.J_TONE] = TONES.index(light.rig.tone)
    stop = current_stop()
    job[at.J_STOP] = stop.address
    return job, (X, maps, lens, light, first_record, stop)
