"""Image-based light: the environment as a table of irradiance, and as tables of radiance filtered for each roughness.

The specular integral is split into filtered radiance and a table of the BRDF, as in Karis, "Real Shading in Unreal
Engine 4" (2013). Radiance is filtered as if the viewer looked along the normal. Each sample reads a pixel of the size
of its solid angle, as in Krivanek and Colbert, "Real-time Shading with Filtered Importance Sampling" (2008). Irradiance
is a table, since nine spherical harmonics (Ramamoorthi and Hanrahan 2001) are wrong by a quarter in a room with
windows.
"""

import math
import threading
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from renderers.compiler.device_function import device_function
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_types import F64, Array1, Array2
from renderers.light_rig import Surroundings
from renderers.shading.studio.environment_image import radiance_of
from renderers.shading.studio.octahedral import equirect_directions, octahedral_directions, with_border

LEVEL_SIZES: Final = (256, 128, 64, 64, 32, 32)
"""Sides of the radiance tables, texels. Their roughness goes from 0 to 1 in equal steps."""
LEVELS: Final = len(LEVEL_SIZES)
IRRADIANCE_SIZE: Final = 32
"""Side of the table of irradiance, texels."""
_FILTER_SAMPLES: Final = 128
"""Number of directions that are sampled for a texel."""
_SPLIT_SUM_SIZE: Final = 32
"""Side of the table of the BRDF's integral, entries."""


@dataclass(frozen=True, slots=True, eq=False)
class Environment:
    """Filtered environment, world frame."""

    texels: NDArray[np.float32]
    """Octahedral tables with border, flat: radiance by ascending roughness, then irradiance / pi. Texels have four
    values; the last is unused."""
    tables: NDArray[np.int32]
    """(LEVELS + 1, 2) int32: offset in ``texels`` and side N of each table."""


_lock = threading.Lock()


def environment_of(surroundings: Surroundings) -> Environment:
    """Return the filtered environment of a light rig. The last few are cached.

    Raises:
        SurroundingsError: see ``environment_image.read_hdr``.
    """
    with _lock:  # concurrent calls would filter the same environment twice
        return _environment(surroundings)


@lru_cache(maxsize=8)
def _environment(surroundings: Surroundings) -> Environment:
    radiance = radiance_of(surroundings)
    shift = round(surroundings.turn / (2.0 * math.pi) * radiance.shape[1])
    return _filtered(np.roll(radiance, -shift, axis=1))


def _filtered(radiance: NDArray[np.float32]) -> Environment:
    """Return the filtered environment of an equirectangular image, (H, W, 3) float32, of the world frame."""
    if radiance.shape[0] > 512:  # it has more details than the finest table
        radiance = cv2.resize(radiance, (1024, 512), interpolation=cv2.INTER_AREA).astype(np.float32)
    pyramid = [np.ascontiguousarray(radiance, np.float32)]
    while pyramid[-1].shape[0] > 2:
        h, w = pyramid[-1].shape[:2]
        pyramid.append(np.ascontiguousarray(cv2.resize(pyramid[-1], (w // 2, h // 2), interpolation=cv2.INTER_AREA)))
    sizes = np.array([image.shape[:2] for image in pyramid], np.int64)
    offsets = np.concatenate(((0,), np.cumsum([image.size for image in pyramid])[:-1])).astype(np.int64)
    values = np.concatenate([image.reshape(-1) for image in pyramid])
    maps = []
    for k, size in enumerate(LEVEL_SIZES):
        directions = np.ascontiguousarray(octahedral_directions(size).reshape(-1, 3))
        samples = _hammersley(1 if k == 0 else _FILTER_SAMPLES)
        lights, means = np.zeros((len(samples), 4)), np.zeros((size * size, 3), np.float32)
        _light_samples(samples, k / (LEVELS - 1), 4.0 * math.pi / (sizes[0, 0] * sizes[0, 1]), lights)
        _prefilter(values, offsets, sizes, directions, lights, means)
        maps.append(with_border(means.reshape(size, size, 3)))
    maps.append(irradiance_of(radiance))
    map_offsets = np.cumsum([0, *(4 * each.shape[0] * each.shape[1] for each in maps[:-1])])
    texels = np.concatenate([np.pad(each, ((0, 0), (0, 0), (0, 1))).reshape(-1) for each in maps])
    return Environment(texels, np.stack((map_offsets, (*LEVEL_SIZES, IRRADIANCE_SIZE)), -1).astype(np.int32))


def irradiance_of(radiance: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the irradiance / pi of an equirectangular image, as an octahedral table of IRRADIANCE_SIZE with border."""
    # 64 x 128 pixels are enough: the cosine blurs smaller details.
    height, width = min(radiance.shape[0], 64), min(radiance.shape[1], 128)
    small = cv2.resize(radiance, (width, height), interpolation=cv2.INTER_AREA).reshape(-1, 3)
    row_edges = np.cos(math.pi * np.arange(height + 1) / height)
    solid_angles = np.repeat((row_edges[:-1] - row_edges[1:]) * (2.0 / width), width)  # divided by pi
    directions = equirect_directions(height, width).reshape(-1, 3).T
    weighted = small * solid_angles[:, None]  # float64: the table does not depend on the order of the sums
    rows = [np.maximum(normals @ directions, 0.0) @ weighted for normals in octahedral_directions(IRRADIANCE_SIZE)]
    return with_border(np.stack(rows).astype(np.float32))


def _hammersley(count: int) -> NDArray[np.float64]:
    """Return the Hammersley set: evenly distributed points of the unit square, (count, 2) float64."""
    k = np.arange(count)
    radical_inverse = np.zeros(count)
    for bit in range(20):
        radical_inverse += ((k >> bit) & 1) * 0.5 ** (bit + 1)
    return np.stack(((k + 0.5) / count, radical_inverse), -1)


@device_function
def _tangent(nx: F64, ny: F64, nz: F64) -> tuple[F64, F64, F64]:
    """Return a unit vector that is perpendicular to a unit vector."""
    if abs(nz) < 0.9:
        scale = 1.0 / math.sqrt(nx * nx + ny * ny)
        return -ny * scale, nx * scale, 0.0
    scale = 1.0 / math.sqrt(ny * ny + nz * nz)
    return 0.0, -nz * scale, ny * scale


@kernel
def _light_samples(samples: Array2[np.float64], roughness: F64, pixel_angle: F64, lights: Array2[np.float64]) -> None:
    """Fill ``lights`` with directions l that light comes from, sampled by the GGX distribution of half vectors h.

    The viewer looks along the normal n.

    Args:
        samples: (S, 2), points of the unit square.
        pixel_angle: solid angle of a pixel of the largest image, steradians.
        lights: (S, 4): l, whose z is n.l, and the level of the image with pixels of the sample's solid angle.
    """
    a2 = roughness**4
    for s in range(samples.shape[0]):
        e = samples[s, 0]
        n_h = math.sqrt((1.0 - e) / (1.0 + (a2 - 1.0) * e))
        sine = math.sqrt(max(0.0, 1.0 - n_h * n_h))
        phi = 2.0 * math.pi * samples[s, 1]
        hx, hy = sine * math.cos(phi), sine * math.sin(phi)
        # The angle between n and l is twice that between n and h.
        lights[s, 0], lights[s, 1], lights[s, 2] = 2.0 * n_h * hx, 2.0 * n_h * hy, 2.0 * n_h * n_h - 1.0
        if a2 > 0.0:
            d = n_h * n_h * (a2 - 1.0) + 1.0
            # pdf = D n.h / (4 v.h), and v.h is n.h here.
            pdf = a2 / (4.0 * math.pi * d * d)
            lights[s, 3] = 0.5 * math.log2(1.0 / (samples.shape[0] * pdf) / pixel_angle) + 1.0


@kernel
def _prefilter(
    values: Array1[np.float32],
    offsets: Array1[np.int64],
    sizes: Array2[np.int64],
    directions: Array2[np.float64],
    lights: Array2[np.float64],
    means: Array2[np.float32],
) -> None:
    """Fill ``means`` with the radiance around each direction n, a unit vector, weighted by n.l (Karis 2013).

    Args:
        values: pyramid of equirectangular images, flat.
        offsets, sizes: index of each image's first value; its height and width.
        lights: see ``_light_samples``.
    """
    for k in range(directions.shape[0]):
        nx, ny, nz = directions[k, 0], directions[k, 1], directions[k, 2]
        tx, ty, tz = _tangent(nx, ny, nz)
        bx, by, bz = ny * tz - nz * ty, nz * tx - nx * tz, nx * ty - ny * tx
        red = green = blue = total = 0.0
        for s in range(lights.shape[0]):
            lx, ly, n_l, level = lights[s, 0], lights[s, 1], lights[s, 2], lights[s, 3]
            if n_l <= 0.0:
                continue
            r, g, b = _sample_pyramid(
                values,
                offsets,
                sizes,
                level,
                lx * tx + ly * bx + n_l * nx,
                lx * ty + ly * by + n_l * ny,
                lx * tz + ly * bz + n_l * nz,
            )
            red, green, blue, total = red + r * n_l, green + g * n_l, blue + b * n_l, total + n_l
        if total > 0.0:
            means[k, 0], means[k, 1], means[k, 2] = red / total, green / total, blue / total


@device_function
def _sample_pyramid(
    values: Array1[np.float32], offsets: Array1[np.int64], sizes: Array2[np.int64], level: F64, x: F64, y: F64, z: F64
) -> tuple[F64, F64, F64]:
    """Sample the image nearest to ``level`` bilinearly in the direction (x, y, z). Return RGB."""
    nearest = min(max(int(level + 0.5), 0), offsets.shape[0] - 1)
    height, width = sizes[nearest, 0], sizes[nearest, 1]
    u = (0.5 - math.atan2(y, x) / (2.0 * math.pi)) * width - 0.5
    v = math.acos(min(max(z, -1.0), 1.0)) / math.pi * height - 0.5
    i, j = math.floor(u), math.floor(v)
    fu, fv = u - i, v - j
    red = green = blue = 0.0
    for dj in range(2):
        row = min(max(j + dj, 0), height - 1)
        for di in range(2):
            weight = (fu if di else 1.0 - fu) * (fv if dj else 1.0 - fv)
            first = offsets[nearest] + (row * width + (i + di) % width) * 3
            red += weight * values[first]
            green += weight * values[first + 1]
            blue += weight * values[first + 2]
    return red, green, blue


@lru_cache(maxsize=1)
def split_sum() -> NDArray[np.float32]:
    """Return the integral of the specular BRDF over a white hemisphere, F0 * scale + F90 * bias (Karis 2013).

    The BRDF is GGX with the height-correlated Smith term.

    Returns:
        (_SPLIT_SUM_SIZE, _SPLIT_SUM_SIZE, 2) float32: scale and bias. The first axis is the cosine between normal and
        view, the second the roughness, 0 to 1 each.
    """
    samples = _hammersley(512)
    cosines = np.linspace(0.0, 1.0, _SPLIT_SUM_SIZE)[:, None, None]
    roughness = np.linspace(0.0, 1.0, _SPLIT_SUM_SIZE)[None, :, None]
    n_v = np.maximum(cosines, 1e-3)
    a2 = np.maximum(roughness, 0.01) ** 4
    e, phi = samples[:, 0], 2.0 * math.pi * samples[:, 1]
    n_h = np.sqrt((1.0 - e) / (1.0 + (a2 - 1.0) * e))
    sine = np.sqrt(np.maximum(0.0, 1.0 - n_h * n_h))
    v_h = np.maximum(np.sqrt(1.0 - n_v * n_v) * sine * np.cos(phi) + n_v * n_h, 0.0)
    n_l = 2.0 * v_h * n_h - n_v
    is_lit = n_l > 0.0
    n_l = np.where(is_lit, n_l, 1.0)
    visibility = 0.5 / (n_l * np.sqrt(a2 + (1 - a2) * n_v**2) + n_v * np.sqrt(a2 + (1 - a2) * n_l**2))
    weight = np.where(is_lit, visibility * 4.0 * n_l * v_h / n_h, 0.0)
    fresnel = (1.0 - v_h) ** 5
    table = np.stack((((1.0 - fresnel) * weight).mean(-1), (fresnel * weight).mean(-1)), -1)
    return np.ascontiguousarray(table, np.float32)
