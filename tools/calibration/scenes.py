"""Indoor scenes for statistics of the stereo camera's errors: textured, plain, shiny, translucent, near and far.

A scene is a function of a seed, which chooses textures and places: fits and tests use different seeds. The camera is at
half a metre above the origin and looks along +x and down; z is up; walls close the view, 1.5 to 5 m away.
"""

from collections.abc import Callable
from functools import wraps
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.demo.objects import textured_box, tile
from gateway.scene.draw.flatten import flatten
from gateway.scene.tree.geometry import Part, Shape, Surface
from gateway.scene.tree.nodes import Node, TreeEdit
from gateway.scene.tree.transforms import Matrix, look_at, translation
from renderers.drawlist import AlphaMode, DrawList, Image, Material, Texture
from scenegate.messages.geometry import Box, Cylinder, Sphere

POSE: Final = look_at((-0.2, 0.0, 0.5), (1.7, 0.0, -0.25), (0.0, 0.0, 1.0))
"""X_world_left, (4, 4) float64."""
Scene = Callable[[np.random.Generator], list[Part]]
"""Function of a random generator that returns the parts of a scene."""
LEAVES: Final = 6_000
"""Number of the ellipses of a texture."""
Texturing = Callable[..., Material]
"""``textured`` or ``leafy``."""
_IMAGE_NUMBERS = iter(range(1 << 30))
"""Source of different names of images."""


def image_of(colours: NDArray[np.float64]) -> Image:
    """Return an opaque image of sRGB values from 0 to 1, (H, W, 3)."""
    pixels = np.full((*colours.shape[:2], 4), 255, np.uint8)
    pixels[:, :, :3] = np.clip(colours * 255.0, 0.0, 255.0)
    return Image(f"scenegate bench {next(_IMAGE_NUMBERS)}".encode(), lambda: pixels)


def noise_image(random: np.random.Generator, contrast: float, finest: int = 1, size: int = 256) -> Image:
    """Return a tinted random texture: the sum of noise with patches of 1, 2, 4, … times ``finest`` texels.

    Args:
        random: source of the noise.
        contrast: standard deviation of the sRGB values, 0 to 1.
        finest: side of the smallest patches, texels.
        size: side of the image, texels.
    """
    field = np.zeros((size, size))
    side = finest
    while side <= size // 8:
        field += np.kron(random.normal(size=(size // side, size // side)), np.ones((side, side)))
        side *= 2
    field *= contrast / field.std()
    tint = random.uniform(0.4, 0.75, 3)
    return image_of(tint + field[:, :, None])


def leaves_image(random: np.random.Generator, contrast: float) -> Image:
    """Return a tinted random texture of ellipses of all sizes that hide each other ("dead leaves").

    As in photographs, it has edges, patches of one colour, and the same statistics in each scale; things are dark or
    bright, and dark ones have less contrast. ``contrast`` is the standard deviation of the sRGB values at mid grey.
    """
    field: NDArray[np.floating] = np.zeros((512, 512))
    smallest, largest = 2.0 ** random.uniform(0.5, 3.0), 170.0
    for radius in random.uniform(largest**-2, smallest**-2, LEAVES) ** -0.5:
        axes = int(radius) + 1, int(radius * random.uniform(0.4, 1.0)) + 1
        centre, angle = random.integers(0, 512, 2).tolist(), random.uniform(0.0, 180.0)
        cv2.ellipse(field, centre, axes, angle, 0.0, 360.0, random.normal(), cv2.FILLED)
    grain = random.normal(size=field.shape) * random.uniform(0.02, 0.15)
    field = cv2.GaussianBlur(field, (0, 0), random.uniform(0.5, 1.2)) + cv2.GaussianBlur(grain, (0, 0), 0.8)
    tint = random.uniform(0.05, 0.9) * random.uniform(0.8, 1.2, 3)
    return image_of(tint * (1.0 + 2.0 * contrast / field.std() * field[:, :, None]))


def leafy(random: np.random.Generator, contrast: float = 0.15) -> Material:
    """Return a matte material with a random texture (``leaves_image``)."""
    texture = Texture(leaves_image(random, contrast * random.uniform(0.6, 1.6)))
    return Material(base_color_texture=texture, metallic=0.0, roughness=0.8, double_sided=True)


def textured(random: np.random.Generator, contrast: float = 0.15, finest: int = 1) -> Material:
    """Return a matte material with a random texture (``noise_image``)."""
    texture = Texture(noise_image(random, contrast, finest))
    return Material(base_color_texture=texture, metallic=0.0, roughness=0.8, double_sided=True)


def plain(random: np.random.Generator, roughness: float = 0.8, metallic: float = 0.0, alpha: float = 1.0) -> Material:
    """Return a material of one random colour, translucent if ``alpha`` is below 1."""
    r, g, b = random.uniform(0.15, 0.7, 3)
    mode = AlphaMode.OPAQUE if alpha == 1.0 else AlphaMode.BLEND
    return Material((r, g, b, alpha), metallic=metallic, roughness=roughness, alpha_mode=mode, double_sided=True)


def at(x: float, y: float, z: float, shape: Shape, material: Material) -> Part:
    """Return a part with its origin at (x, y, z) in the world, metres."""
    return Part(shape, material, translation(x, y, z))


def box(x: float, y: float, z: float, sides: tuple[float, float, float], material: Material) -> Part:
    """Return a box with the material's texture on each face. Centre and sides are in metres."""
    return at(x, y, z, Surface(textured_box(*sides)), material)


def room(back: Material, floor: Material, depth: float = 3.0) -> list[Part]:
    """Return a wall at x = ``depth`` metres, two side walls, and a floor at z = -0.7 m."""
    turned: Matrix = np.array(((0, 0, 1, depth), (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 0, 1)), np.float64)
    side: Matrix = np.array(((1, 0, 0, depth), (0, 0, 1, 0), (0, 1, 0, 0), (0, 0, 0, 1)), np.float64)
    walls = [Part(Surface(tile(6.0, 8)), back, turned), at(depth, 0.0, -0.7, Surface(tile(6.0, 8)), floor)]
    for y in (-0.62 * depth - 0.3, 0.62 * depth + 0.3):
        X = side.copy()
        X[1, 3] = y
        walls.append(Part(Surface(tile(6.0, 8)), back, X))
    return walls


def textured_table(random: np.random.Generator, texture: Texturing = textured) -> list[Part]:
    """Boxes on a floor, all textured."""
    parts = room(texture(random), texture(random), 2.5)
    for _ in range(6):
        side = random.uniform(0.15, 0.35, 3)
        x, y = random.uniform(1.1, 2.2), random.uniform(-0.6, 0.6)
        parts.append(box(x, y, -0.7 + side[2] / 2, tuple(side), texture(random)))
    return parts


def plain_room(random: np.random.Generator) -> list[Part]:
    """Plain boxes in a plain room."""
    parts = room(plain(random), plain(random), 2.5)
    for _ in range(6):
        side = random.uniform(0.2, 0.5, 3)
        x, y, z = random.uniform(1.1, 2.2), random.uniform(-0.7, 0.7), random.uniform(-0.5, 0.3)
        parts.append(box(x, y, z, tuple(side), plain(random)))
    return parts


def mixed_room(random: np.random.Generator) -> list[Part]:
    """Plain and textured boxes in a plain room with a faintly textured floor, as in most offices."""
    parts = room(plain(random), textured(random, 0.05), 2.8)
    for index in range(8):
        side = random.uniform(0.2, 0.5, 3)
        x, y, z = random.uniform(1.2, 2.5), random.uniform(-0.8, 0.8), random.uniform(-0.6, 0.4)
        parts.append(box(x, y, z, tuple(side), textured(random) if index % 2 else plain(random)))
    return parts


def clutter(random: np.random.Generator, texture: Texturing = textured) -> list[Part]:
    """Many small boxes at all depths before a textured wall: edges everywhere."""
    parts = room(texture(random), texture(random), 2.5)
    for _ in range(60):
        side = random.uniform(0.04, 0.2, 3)
        x = random.uniform(0.9, 2.3)
        y, z = random.uniform(-0.5, 0.5, 2) * x * (1.1, 0.8)
        parts.append(box(x, y, z, tuple(side), texture(random, random.uniform(0.05, 0.2))))
    return parts


def poles(random: np.random.Generator, texture: Texturing = textured) -> list[Part]:
    """Thin upright poles before a textured wall, which a matcher makes too wide."""
    parts = room(texture(random), texture(random), 2.2)
    for y in np.linspace(-0.7, 0.7, 8):
        x, width = random.uniform(0.9, 1.8), random.uniform(0.01, 0.08)
        parts.append(box(x, y * x, 0.0, (width, width, 2.0), texture(random)))
    return parts


def spheres(random: np.random.Generator) -> list[Part]:
    """Plain spheres and cylinders before a textured wall."""
    parts = room(textured(random, 0.08), textured(random, 0.08), 2.4)
    for index in range(9):
        x, radius = random.uniform(1.1, 2.0), random.uniform(0.08, 0.25)
        y, z = random.uniform(-0.5, 0.5) * x, random.uniform(-0.35, 0.35) * x
        shape = Sphere(radius) if index % 3 else Cylinder(radius, 0.4)
        parts.append(at(x, y, z, shape, plain(random)))
    return parts


def shiny(random: np.random.Generator) -> list[Part]:
    """Spheres of polished metal and lacquer, with highlights, before a textured wall."""
    parts = room(textured(random), textured(random), 2.4)
    for index in range(8):
        x, radius = random.uniform(1.0, 2.0), random.uniform(0.1, 0.25)
        y, z = random.uniform(-0.5, 0.5) * x, random.uniform(-0.4, 0.3) * x
        parts.append(at(x, y, z, Sphere(radius), plain(random, 0.15, float(index % 2))))
    return parts


def clear(random: np.random.Generator) -> list[Part]:
    """Translucent panes and balls before a textured wall."""
    parts = room(textured(random), textured(random), 2.4)
    for index in range(6):
        x, alpha = random.uniform(1.0, 2.0), random.uniform(0.2, 0.6)
        y, z = random.uniform(-0.5, 0.5) * x, random.uniform(-0.35, 0.35) * x
        shape: Shape = Sphere(0.2) if index % 2 else Box((0.02, 0.5, 0.5))
        parts.append(at(x, y, z, shape, plain(random, 0.1, 0.0, alpha)))
    return parts


def steep(random: np.random.Generator, texture: Texturing = textured) -> list[Part]:
    """Textured planes at steep angles."""
    parts = room(texture(random), texture(random), 3.0)
    for y in (-0.9, -0.3, 0.3, 0.9):
        angle = random.uniform(0.5, 1.3) * (1.0 if y < 0 else -1.0)
        X = translation(1.7, y, 0.0)
        X[:2, :2] = ((np.cos(angle), -np.sin(angle)), (np.sin(angle), np.cos(angle)))
        parts.append(Part(Surface(textured_box(0.02, 0.6, 1.2)), texture(random), X))
    return parts


def far(random: np.random.Generator) -> list[Part]:
    """Boxes of little contrast, 2 to 5 m away."""
    parts = room(textured(random, 0.03, 4), textured(random, 0.02, 2), 5.0)
    for _ in range(14):
        side = random.uniform(0.2, 0.8, 3)
        x = random.uniform(2.0, 4.5)
        y, z = random.uniform(-0.5, 0.5) * x, random.uniform(-0.3, 0.3) * x
        parts.append(box(x, y, z, tuple(side), textured(random, random.uniform(0.01, 0.06), 2)))
    return parts


def faint(random: np.random.Generator) -> list[Part]:
    """Walls and boxes of all contrasts down to that of the image noise."""
    contrasts = 0.15 * 2.0 ** random.uniform(-5.0, 0.0, 12)
    parts = room(textured(random, contrasts[0]), textured(random, contrasts[1]), random.uniform(1.6, 2.6))
    for contrast in contrasts[2:]:
        side = random.uniform(0.3, 0.7, 3)
        x = random.uniform(1.2, 2.4)
        y, z = random.uniform(-0.5, 0.5) * x, random.uniform(-0.3, 0.3) * x
        parts.append(box(x, y, z, tuple(side), textured(random, contrast)))
    return parts


SCENES: Final[tuple[Scene, ...]] = (
    textured_table, plain_room, mixed_room, clutter, poles, spheres, shiny, clear, steep, far, faint,
)  # fmt: skip
"""Functions that return the parts of a scene."""


def with_leaves(scene: Callable[[np.random.Generator, Texturing], list[Part]]) -> Scene:
    """Return the scene with textures of ``leafy``."""
    return wraps(scene)(lambda random: scene(random, leafy))


LEAFY_SCENES: Final[tuple[Scene, ...]] = tuple(map(with_leaves, (textured_table, clutter, poles, steep)))
"""Scenes with textures like photographs."""


def make_scene(scene: Scene, seed: tuple[int, int]) -> DrawList:
    """Return the draw list of a scene, whose generator has the given seed."""
    edit = TreeEdit(Node())
    edit.set_parts(("scene",), tuple(scene(np.random.default_rng(seed))))
    return flatten(edit.commit())
