"""Closed rooms with plain or textured walls of albedo 0.5, and what a stereo camera measures of each wall."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.parameters import Parameters
from gateway.adapters.stereo.device.stream_settings import read_settings
from gateway.adapters.stereo.imaging.matched_depth import matched_depth
from gateway.adapters.stereo.imaging.rendered_images import Imaging
from gateway.adapters.stereo.imaging.scene_view import Capture
from gateway.scene.tree.transforms import look_at
from renderers.drawlist import DrawList, Image, Instance, Material, Mesh, Sampler, Texture
from renderers.interface import Output
from renderers.raster import CpuRenderer
from renderers.stereo.depth.matching import ImagePair
from renderers.stereo.model import DISPARITY_SCALE
from renderers.stereo.realism import RealismPart
from renderers.stereo.sensor.camera_image import NoiseStream
from tests.adapters.stereo.camera_images import expose

TILE = 12.0
"""Side of the texture on a wall, metres: larger than the walls, so that nothing repeats."""
MAX_INCIDENCE = 70.0
"""Angle up to which walls are measured, degrees."""


def noise_texture(side: int = 2048) -> Texture:
    """Return a texture of noise at all scales, of albedo 0.5."""
    random = np.random.default_rng(7)
    level = np.zeros((side, side))
    for size in (1, 2, 4, 8, 16, 32):
        level += np.kron(random.standard_normal((side // size, side // size)), np.ones((size, size))) * size**0.25
    srgb = np.clip(186.0 + 25.0 * level / level.std(), 0, 255).astype(np.uint8)  # 186: 0.5 of linear light
    pixels = np.dstack((srgb, srgb, srgb, np.full_like(srgb, 255)))
    return Texture(Image(b"noise", lambda: pixels), Sampler())


def room(corners: list[tuple[float, float]], height: float, texture: Texture | None, tile: float = TILE) -> DrawList:
    """Return a closed room: walls between the corners, in order, floor at z = 0 and ceiling.

    Instances are the walls, then floor and ceiling, as rectangles around all corners.
    """
    color = 1.0 if texture is not None else 0.5
    material = Material((color, color, color, 1.0), texture, metallic=0.0, roughness=0.9, double_sided=True)
    outline = np.array(corners)
    low, high = outline.min(axis=0), outline.max(axis=0)
    quads = [
        ((*a, 0.0), (*b, 0.0), (*b, height), (*a, height))
        for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)
    ]
    quads += [
        ((low[0], low[1], z), (high[0], low[1], z), (high[0], high[1], z), (low[0], high[1], z)) for z in (0.0, height)
    ]
    instances = []
    for number, quad in enumerate(quads):
        points = np.array(quad)
        u, v = np.linalg.norm(points[1] - points[0]), np.linalg.norm(points[3] - points[0])
        uv = np.array(((0, 0), (u, 0), (u, v), (0, v)), np.float32) / np.float32(tile)
        mesh = Mesh(
            points.astype(np.float32), np.array(((0, 1, 2), (0, 2, 3)), np.uint32), uv0=uv + np.float32(0.13 * number)
        )
        instances.append(Instance(mesh, material, np.eye(4), number, number))
    return DrawList(tuple(instances), () if texture is None else (texture.image,))


@dataclass(frozen=True, slots=True)
class Wall:
    grey: float
    """Mean grey."""
    fill: float
    """Share of the pixels up to ``MAX_INCIDENCE`` with valid disparity, NaN if there are few."""
    right: float
    """Share of the same pixels whose disparity is right within 1 pixel, NaN if there are few."""


def walls_seen(
    renderer: CpuRenderer,
    scene: DrawList,
    eye: tuple[float, float, float],
    target: tuple[float, float, float],
    *,
    projector: bool = False,
    max_depth: float = np.inf,
    realism: frozenset[RealismPart] = frozenset(),
) -> dict[int, Wall]:
    """Return what a camera with default parameters sees of each wall with at least 4,000 pixels, by its number.

    Args:
        max_depth: depth up to which ``fill`` counts, metres.
    """
    imaging, settings = Imaging(StereoConfig(realism=realism), renderer), read_settings(Parameters())
    X_world_left: NDArray[np.float64] = look_at(eye, target, (0.0, 0.0, 1.0))
    capture = Capture(0, scene, 1, X_world_left, int(projector))
    exposure = imaging.meter(capture, settings).exposure
    left, right_image = (
        expose(imaging, capture, exposure, stream) for stream in (NoiseStream.LEFT_DEPTH, NoiseStream.RIGHT_DEPTH)
    )
    disparity = matched_depth(imaging.config, ImagePair(left, right_image, exposure), settings, None).disparity
    seen: Any = imaging.render(capture, 0.0, settings.quality.divisor, Output.DEPTH | Output.NORMAL | Output.INSTANCE)
    k = imaging.config.model.intrinsics(settings.quality.divisor)
    rows, columns = np.mgrid[0 : k.height, 0 : k.width] + 0.5
    ray = np.stack(((columns - k.cx) / k.focal_length, (rows - k.cy) / k.focal_length, np.ones(rows.shape)), axis=-1)
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    incidence = np.degrees(np.arccos(np.clip(-(ray * seen.normal).sum(axis=-1), -1.0, 1.0)))
    # The right camera sees nothing of the leftmost columns.
    measurable = (incidence <= MAX_INCIDENCE) & (seen.depth <= max_depth)
    exact = imaging.config.model.focal_times_baseline(settings.quality.divisor) / seen.depth
    measurable &= columns > exact
    is_right = np.abs(disparity * DISPARITY_SCALE - exact) < 1.0
    grey = left.image[:: settings.quality.divisor, :: settings.quality.divisor]
    walls = {}
    for number in np.unique(seen.instance).tolist():
        mask = seen.instance == number
        counted = mask & measurable
        if mask.sum() >= 4000:
            fill, right = (
                float(each[counted].mean()) if counted.sum() >= 1000 else np.nan for each in (disparity > 0, is_right)
            )
            walls[number] = Wall(float(grey[mask].mean()), fill, right)
    return walls
