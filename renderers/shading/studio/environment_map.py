"""Image-based light: the surroundings as a table of irradiance and as prefiltered tables of radiance.

Sources: Karis, "Real Shading in Unreal Engine 4" (2013), for the split of the specular integral into filtered radiance
and a table of the BRDF, each filtered with the normal as the direction of view; Krivanek and Colbert, "Real-time
Shading with Filtered Importance Sampling" (2008), for the size of what a sample stands for. Irradiance is a table and
not nine harmonics (Ramamoorthi and Hanrahan 2001): a room with windows is a quarter off in those.
"""

from __future__ import annotations

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
from renderers.light_rig import Surroundings
from renderers.shading.studio.octahedral import equirect_directions, octahedral_directions, with_border

LEVEL_SIZES: Final = (256, 128, 64, 64, 32, 32)
"""Sides of the tables from roughness 0 to 1, texels, in equal steps of roughness."""
LEVELS: Final = len(LEVEL_SIZES)
MAX_HDR_PIXELS: Final = 8192 * 4096
"""Maximum number of pixels of a Radiance image: 400 MB as float32."""
_DRAWN: Final = (256, 512)
"""Height and width of surroundings without an image, pixels."""
_SAMPLES: Final = 128
IRRADIANCE_SIZE: Final = 32
"""Side of the table of irradiance, texels."""
_SPLIT: Final = 32
"""Side of the table of the BRDF's integral, by cosine and roughness."""


class SurroundingsError(ValueError):
    """A Radiance image cannot be used. The message says why."""


@dataclass(frozen=True, slots=True, eq=False)
class Ambient:
    """Filtered surroundings, world frame."""

    irradiance: NDArray[np.float32]
    """Octahedral table with border, (IRRADIANCE_SIZE + 2, IRRADIANCE_SIZE + 2, 3) float32: irradiance / pi."""
    levels: tuple[NDArray[np.float32], ...]
    """Octahedral tables with border, (N + 2, N + 2, 3) float32 radiance, by growing roughness."""
    texels: NDArray[np.float32]
    """All levels and then the irradiance, flat, four values per texel, of which the last is unused."""
    places: NDArray[np.int32]
    """(LEVELS + 1, 2) int32: offset in ``texels`` and side N of each table."""


def irradiance_of(radiance: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return ``Ambient.irradiance`` of an equirectangular image (H, W, 3)."""
    # Under a cosine, details of a degree or two do not matter.
    height, width = min(radiance.shape[0], 64), min(radiance.shape[1], 128)
    small = cv2.resize(radiance, (width, height), interpolation=cv2.INTER_AREA).reshape(-1, 3)
    edges = np.cos(math.pi * np.arange(height + 1) / height)
    area = np.repeat((edges[:-1] - edges[1:]) * (2.0 / width), width)  # over pi
    ahead = equirect_directions(height, width).reshape(-1, 3).T
    wide = small * area[:, None]  # float64: the table does not depend on the order of the sums
    rows = [np.maximum(normals @ ahead, 0.0) @ wide for normals in octahedral_directions(IRRADIANCE_SIZE)]
    return with_border(np.stack(rows).astype(np.float32))


def read_hdr(data: bytes) -> NDArray[np.float32]:
    """Decode a Radiance image to (H, W, 3) float32 linear RGB.

    Raises:
        SurroundingsError: not a Radiance image, too large, or not equirectangular (twice as wide as high).
    """
    if not data.startswith(b"#?"):
        raise SurroundingsError("the surroundings are no Radiance image (.hdr), which begins with '#?'")
    size = next((line.split() for line in data[:4096].split(b"\n") if line.startswith((b"-Y", b"+Y"))), [])
    try:
        height, width = int(size[1]), int(size[3])
    except (IndexError, ValueError):
        raise SurroundingsError("the Radiance image has no line with its size") from None
    if not 0 < height * width <= MAX_HDR_PIXELS or width != 2 * height:
        raise SurroundingsError(
            f"the Radiance image has {width}x{height} pixels; it must be twice as wide as high and have at most "
            f"{MAX_HDR_PIXELS}"
        )
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        pixels = None
    if pixels is None or pixels.dtype != np.float32 or pixels.shape != (height, width, 3):
        raise SurroundingsError("the Radiance image is broken")
    rgb = np.ascontiguousarray(pixels[..., ::-1])
    return np.clip(np.nan_to_num(rgb, nan=0.0, posinf=65504.0), 0.0, 65504.0).astype(np.float32)


def radiance_of(surroundings: Surroundings) -> NDArray[np.float32]:
    """Return the surroundings as an equirectangular image of the world, (H, W, 3) float32. ``turn`` is not applied."""
    if surroundings.image is not None:
        return read_hdr(surroundings.image) * np.float32(surroundings.intensity)
    d = equirect_directions(*_DRAWN)
    sky, ground = np.array(surroundings.hemisphere.sky), np.array(surroundings.hemisphere.ground)
    result = ground + (0.5 + 0.5 * d[..., 2:]) * (sky - ground)
    for box in surroundings.softboxes:
        middle = np.array(box.direction) / np.linalg.norm(box.direction)
        across = np.cross((0.0, 0.0, 1.0), middle)
        across = across / np.linalg.norm(across) if np.linalg.norm(across) > 1e-9 else np.array((0.0, 1.0, 0.0))
        up = np.cross(middle, across)
        ahead = d @ middle
        inside = ahead > 0.0
        depth = np.where(inside, ahead, 1.0)
        part = inside.astype(np.float64)
        for axis, half in ((across, box.width), (up, box.height)):
            off = np.abs(d @ axis) / depth / math.tan(half)
            t = np.clip((1.0 - off) / box.softness + 0.5, 0.0, 1.0)
            part = part * t * t * (3.0 - 2.0 * t)
        result = result + part[..., None] * np.array(box.radiance)
    single: NDArray[np.float32] = (result * surroundings.intensity).astype(np.float32)
    return single


_lock = threading.Lock()


def ambient_of(surroundings: Surroundings) -> Ambient:
    """Return the filtered surroundings. The last few are kept.

    Raises:
        SurroundingsError: see ``read_hdr``.
    """
    with _lock:  # or concurrent calls would filter twice
        return _ambient(surroundings)


@lru_cache(maxsize=8)
def _ambient(surroundings: Surroundings) -> Ambient:
    radiance = radiance_of(surroundings)
    shift = round(surroundings.turn / (2.0 * math.pi) * radiance.shape[1])
    return filtered(np.roll(radiance, -shift, axis=1))


def filtered(radiance: NDArray[np.float32]) -> Ambient:
    """Filters an equirectangular picture (H, W, 3) float32 of the world."""
    height = radiance.shape[0]
    if height > 512:  # finer than the finest table shows
        radiance = cv2.resize(radiance, (1024, 512), interpolation=cv2.INTER_AREA).astype(np.float32)
    pyramid = [np.ascontiguousarray(radiance, np.float32)]
    while pyramid[-1].shape[0] > 2:
        h, w = pyramid[-1].shape[:2]
        pyramid.append(np.ascontiguousarray(cv2.resize(pyramid[-1], (w // 2, h // 2), interpolation=cv2.INTER_AREA)))
    sizes = np.array([p.shape[:2] for p in pyramid], np.int64)
    offsets = np.concatenate(((0,), np.cumsum([p.size for p in pyramid])[:-1])).astype(np.int64)
    texels = np.concatenate([p.reshape(-1) for p in pyramid])
    levels = []
    for k, size in enumerate(LEVEL_SIZES):
        directions = np.ascontiguousarray(octahedral_directions(size).reshape(-1, 3))
        out = np.zeros((size * size, 3), np.float32)
        _prefilter(texels, offsets, sizes, directions, k / (LEVELS - 1), _hammersley(1 if k == 0 else _SAMPLES), out)
        levels.append(with_border(out.reshape(size, size, 3)))
    irradiance = irradiance_of(radiance)
    tables = [*levels, irradiance]
    begins = np.cumsum([0, *(4 * table.shape[0] * table.shape[1] for table in tables[:-1])])
    return Ambient(
        irradiance,
        tuple(levels),
        np.concatenate([np.pad(table, ((0, 0), (0, 0), (0, 1))).reshape(-1) for table in tables]),
        np.stack((begins, (*LEVEL_SIZES, IRRADIANCE_SIZE)), -1).astype(np.int32),
    )


def _hammersley(count: int) -> NDArray[np.float64]:
    """(count, 2): evenly spread points of the unit square (van der Corput in base 2)."""
    k = np.arange(count)
    inverse = np.zeros(count)
    for bit in range(20):
        inverse += ((k >> bit) & 1) * 0.5 ** (bit + 1)
    return np.stack(((k + 0.5) / count, inverse), -1)


@kernel("void(float32[::1], int64[::1], int64[:,::1], float64[:,::1], float64, float64[:,::1], float32[:,::1])")
def _prefilter(texels, offsets, sizes, directions, roughness, points, out):
    """Fill the mean radiance around each direction, weighted by GGX for a viewer in that direction (Karis 2013).

    Half vectors are sampled by importance, each from the level whose texels cover the sample's solid angle.
    """
    a2 = roughness**4
    texel = 4.0 * math.pi / (sizes[0, 0] * sizes[0, 1])
    for k in range(directions.shape[0]):
        nx, ny, nz = directions[k, 0], directions[k, 1], directions[k, 2]
        # A frame around the direction.
        if abs(nz) < 0.9:
            scale = 1.0 / math.sqrt(nx * nx + ny * ny)
            tx, ty, tz = -ny * scale, nx * scale, 0.0
        else:
            scale = 1.0 / math.sqrt(ny * ny + nz * nz)
            tx, ty, tz = 0.0, -nz * scale, ny * scale
        bx, by, bz = ny * tz - nz * ty, nz * tx - nx * tz, nx * ty - ny * tx
        red = green = blue = total = 0.0
        for s in range(points.shape[0]):
            e = points[s, 0]
            cosine = math.sqrt((1.0 - e) / (1.0 + (a2 - 1.0) * e))
            sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
            phi = 2.0 * math.pi * points[s, 1]
            hx, hy = sine * math.cos(phi), sine * math.sin(phi)
            # The viewer looks along the normal, so the reflected direction has twice the half vector's angle.
            n_l = 2.0 * cosine * cosine - 1.0
            if n_l <= 0.0:
                continue
            lx, ly = 2.0 * cosine * hx, 2.0 * cosine * hy
            level = 0.0
            if a2 > 0.0:
                d = cosine * cosine * (a2 - 1.0) + 1.0
                # pdf = D n.h / (4 v.h), and v.h is n.h here.
                pdf = a2 / (4.0 * math.pi * d * d)
                level = 0.5 * math.log2(1.0 / (points.shape[0] * pdf) / texel) + 1.0
            r, g, b = _read(
                texels,
                offsets,
                sizes,
                level,
                lx * tx + ly * bx + n_l * nx,
                lx * ty + ly * by + n_l * ny,
                lx * tz + ly * bz + n_l * nz,
            )
            red, green, blue, total = red + r * n_l, green + g * n_l, blue + b * n_l, total + n_l
        if total > 0.0:
            out[k, 0], out[k, 1], out[k, 2] = red / total, green / total, blue / total


@device_function
def _read(texels, offsets, sizes, level, x, y, z):
    """Sample the nearest level of the pyramid of equirectangular images, bilinear."""
    which = min(max(int(level + 0.5), 0), offsets.shape[0] - 1)
    height, width = sizes[which, 0], sizes[which, 1]
    u = (0.5 - math.atan2(y, x) / (2.0 * math.pi)) * width - 0.5
    v = math.acos(min(max(z, -1.0), 1.0)) / math.pi * height - 0.5
    i, j = math.floor(u), math.floor(v)
    fu, fv = u - i, v - j
    red = green = blue = 0.0
    for dj in range(2):
        row = min(max(j + dj, 0), height - 1)
        for di in range(2):
            weight = (fu if di else 1.0 - fu) * (fv if dj else 1.0 - fv)
            at = offsets[which] + (row * width + (i + di) % width) * 3
            red += weight * texels[at]
            green += weight * texels[at + 1]
            blue += weight * texels[at + 2]
    return red, green, blue


@lru_cache(maxsize=1)
def split_sum() -> NDArray[np.float32]:
    """Return scale and bias of F0, (_SPLIT, _SPLIT, 2) float32, by cosine of the view and roughness, 0 to 1 each.

    They give the integral of GGX with the height-correlated Smith term over a white hemisphere (Karis 2013).
    """
    points = _hammersley(512)
    cosines = np.linspace(0.0, 1.0, _SPLIT)[:, None, None]
    rough = np.linspace(0.0, 1.0, _SPLIT)[None, :, None]
    n_v = np.maximum(cosines, 1e-3)
    a2 = np.maximum(rough, 0.01) ** 4
    e, phi = points[:, 0], 2.0 * math.pi * points[:, 1]
    n_h = np.sqrt((1.0 - e) / (1.0 + (a2 - 1.0) * e))
    sine = np.sqrt(np.maximum(0.0, 1.0 - n_h * n_h))
    v_h = np.maximum(np.sqrt(1.0 - n_v * n_v) * sine * np.cos(phi) + n_v * n_h, 0.0)
    n_l = 2.0 * v_h * n_h - n_v
    lit = n_l > 0.0
    n_l = np.where(lit, n_l, 1.0)
    visibility = 0.5 / (n_l * np.sqrt(a2 + (1 - a2) * n_v**2) + n_v * np.sqrt(a2 + (1 - a2) * n_l**2))
    weight = np.where(lit, visibility * 4.0 * n_l * v_h / n_h, 0.0)
    fresnel = (1.0 - v_h) ** 5
    table = np.stack((((1.0 - fresnel) * weight).mean(-1), (fresnel * weight).mean(-1)), -1)
    return np.ascontiguousarray(table, np.float32)
