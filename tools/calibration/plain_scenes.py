"""Rooms of plain, pale, tiled and wooden things, for ``confidence``.

A window of such surfaces sees a single line. At a silhouette, a match belongs to one of its sides; on a tile's seam or
a plank's grain, it is right on both.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.scene.tree.geometry import Part
from renderers.drawlist import Material, Texture
from scenegate.messages.geometry import Cylinder, Sphere
from tools.calibration.scenes import Scene, at, box, image_of, plain, room, textured


def patterned(pattern: NDArray[np.float64], tint: NDArray[np.float64]) -> Material:
    """Return a matte material with a pattern, (H, W), times a colour, (3,), sRGB from 0 to 1."""
    texture = Texture(image_of(pattern[:, :, None] * tint))
    return Material(base_color_texture=texture, metallic=0.0, roughness=0.8, double_sided=True)


def tiles(random: np.random.Generator) -> Material:
    """Return plain tiles of one or two colours with darker seams."""
    y, x = np.mgrid[0:256, 0:256]
    side = 256 // int(random.integers(1, 5))
    grey = 0.95 - random.uniform(0.0, 0.3) * ((x // side + y // side) % 2)
    is_seam = np.minimum(x % side, y % side) < random.integers(2, 8)
    seams = np.where(is_seam, random.uniform(0.6, 0.95), 1.0)
    return patterned(grey * seams * random.uniform(0.5, 1.0), random.uniform(0.7, 1.0, 3))


def planks(random: np.random.Generator) -> Material:
    """Return wooden planks with grain along one of the axes."""
    y, x = np.mgrid[0:256, 0:256] / 256.0
    rings = random.uniform(4.0, 14.0) * np.hypot(0.4 * (y - 0.4), random.uniform(0.03, 0.2) * (x + 3.0))
    rings += random.uniform(0.2, 1.0) * np.sin(random.uniform(2.0, 5.0) * x + random.uniform(0.0, 6.0) + 2.0 * y)
    grey = 1.0 - random.uniform(0.05, 0.2) * (0.5 + 0.5 * np.sin(2.0 * np.pi * rings))
    grey += random.uniform(-0.03, 0.03, (256, 1))
    grey *= np.where((y * random.integers(2, 6)) % 1.0 < 0.02, 0.75, 1.0)
    grey = (grey if random.random() < 0.5 else grey.T) * random.uniform(0.5, 1.0)
    return patterned(grey, np.array((1.0, 0.85, 0.65)))


def any_material(random: np.random.Generator) -> Material:
    """Return a plain, tiled, wooden or textured material of any contrast."""
    kinds = (plain, tiles, planks, lambda random: textured(random, 0.15 * 2.0 ** random.uniform(-5.0, 0.0)))
    return kinds[int(random.integers(len(kinds)))](random)


def tiled_room(random: np.random.Generator) -> list[Part]:
    """Plain and wooden boxes in a tiled room."""
    parts = room(tiles(random) if random.random() < 0.5 else plain(random), tiles(random), 2.6)
    for _ in range(7):
        x, y, z = random.uniform(1.1, 2.2), random.uniform(-0.7, 0.7), random.uniform(-0.6, 0.3)
        material = plain(random) if random.random() < 0.5 else planks(random)
        parts.append(box(x, y, z, tuple(random.uniform(0.15, 0.5, 3)), material))
    return parts


def workbench(random: np.random.Generator) -> list[Part]:
    """Small things on a wooden table in a plain room with tiles."""
    parts = [*room(plain(random), tiles(random), 2.8), box(1.6, 0.0, -0.3, (1.0, 1.5, 0.05), planks(random))]
    for index in range(9):
        x, y, radius = random.uniform(1.2, 2.0), random.uniform(-0.6, 0.6), random.uniform(0.04, 0.15)
        z = -0.27 + radius
        if index % 3 == 2:
            parts.append(box(x, y, z, (2 * radius,) * 3, any_material(random)))
        else:
            shape = Sphere(radius) if index % 3 == 0 else Cylinder(radius, 2 * radius)
            parts.append(at(x, y, z, shape, plain(random, random.uniform(0.1, 0.8))))
    return parts


def posters(random: np.random.Generator) -> list[Part]:
    """Posters on the wall of a plain room, and boxes of any materials."""
    parts = room(plain(random), plain(random), 2.6)
    for _ in range(7):
        y, z = random.uniform(-1.2, 1.2), random.uniform(-0.6, 0.9)
        width, height = random.uniform(0.15, 0.5, 2)
        parts.append(box(2.58, y, z, (0.01, width, height), textured(random, random.uniform(0.03, 0.15))))
    for _ in range(5):
        x, y, z = random.uniform(1.2, 2.3), random.uniform(-0.7, 0.7), random.uniform(-0.6, 0.3)
        parts.append(box(x, y, z, tuple(random.uniform(0.1, 0.5, 3)), any_material(random)))
    return parts


def pale(random: np.random.Generator) -> list[Part]:
    """Walls and boxes with textures of about the image noise."""

    def material() -> Material:
        return textured(random, 0.004 * 2.0 ** random.uniform(0.0, 3.5))

    parts = room(material(), material(), random.uniform(1.6, 2.6))
    for _ in range(4):
        x = random.uniform(1.2, 2.2)
        y, z = random.uniform(-0.5, 0.5) * x, random.uniform(-0.3, 0.3) * x
        parts.append(box(x, y, z, tuple(random.uniform(0.3, 0.7, 3)), material()))
    return parts


PLAIN_SCENES: Final[tuple[Scene, ...]] = (tiled_room, workbench, posters, pale)
"""Functions that return the parts of a scene."""
