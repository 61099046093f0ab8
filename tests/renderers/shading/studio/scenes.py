"""Small scenes of the studio look's tests, and cameras for them."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import DrawList, Image, Instance, Light, LightKind, Material, Mesh
from renderers.interface import Look, Output, SampleCount
from renderers.light_rig import Rig
from renderers.raster import CpuRenderer
from tests.renderers.shading.reference import ball

DARK = Rig(surroundings=None, shadow_size=0)
"""No light at all."""
KINDS = {
    "directional": Light(LightKind.DIRECTIONAL, (1.0, 0.9, 0.8), 2.0, direction=(0.48, 0.6, 0.64)),
    "point": Light(LightKind.POINT, (0.6, 0.8, 1.0), 9.0, position=(-1.5, -1.0, 1.5), range=6.0),
    "spot": Light(
        LightKind.SPOT,
        intensity=20.0,
        position=(0.5, -2.0, 1.0),
        direction=(0.0, 0.8, 0.6),
        inner_cone=0.2,
        outer_cone=0.6,
    ),
}


def view(width: int = 48, height: int = 36, focal: float = 40.0) -> Camera:
    """Return a camera at the origin that looks along +Z, with +Y down."""
    return Camera(width, height, focal, 1.1 * focal, width / 2 - 0.5, height / 2 + 0.75, 0.05, 100.0, np.eye(4))


def sheet(corners: NDArray[np.float64] | list[tuple[float, float, float]], uv: float = 1.0) -> Mesh:
    """Return a quadrilateral with texture coordinates 0 .. uv and its normal towards the origin."""
    p = np.array(corners, np.float64)
    n = np.cross(p[1] - p[0], p[3] - p[0])
    n /= -np.linalg.norm(n) * np.sign(n @ p[0])
    order = ((0, 1, 2), (0, 2, 3)) if np.cross(p[1] - p[0], p[2] - p[0]) @ n > 0 else ((0, 2, 1), (0, 3, 2))
    uvs = np.array(((0, 0), (1, 0), (1, 1), (0, 1)), np.float32) * np.float32(uv)
    return Mesh(p.astype(np.float32), np.array(order, np.uint32), np.tile(n, (4, 1)).astype(np.float32), uvs)


def translation(x: float, y: float, z: float) -> NDArray[np.float64]:
    X = np.eye(4)
    X[:3, 3] = x, y, z
    return X


def two_balls(**material: Any) -> DrawList:
    """Return a dielectric and a metal ball."""
    plastic = Material((0.8, 0.3, 0.2, 1.0), metallic=0.0, roughness=0.4, **material)
    metal = Material((0.9, 0.8, 0.5, 1.0), metallic=1.0, roughness=0.5)
    mesh = ball(12, 0.8)
    return DrawList(
        (Instance(mesh, plastic, translation(-0.9, 0.0, 3.5)), Instance(mesh, metal, translation(0.9, 0.1, 3.5)))
    )


def noise(side: int = 64, seed: int = 0) -> Image:
    """Return an image of coarse and fine patterns with one red corner."""
    rng = np.random.default_rng(seed)
    coarse = rng.integers(0, 256, (side // 8, side // 8, 4)).repeat(8, 0).repeat(8, 1)
    fine = rng.integers(0, 256, (side, side, 4))
    pixels = (0.6 * coarse + 0.4 * fine).astype(np.uint8)
    pixels[..., 3] = 255
    pixels[: side // 4, : side // 4, :3] = (255, 0, 0)
    return Image(pixels.tobytes(), lambda: pixels)


def slab_over_floor(kind: LightKind) -> DrawList:
    """Return a floor, a slab over it and a light from above. The world is Y-down, as an optical frame."""
    floor = sheet([(-3, 1, 2), (3, 1, 2), (3, 1, 8), (-3, 1, 8)])
    slab = sheet([(-0.7, 0.2, 4.0), (0.7, 0.2, 4.0), (0.7, 0.2, 5.4), (-0.7, 0.2, 5.4)])
    grey = Material((0.6, 0.6, 0.6, 1.0), metallic=0.0, roughness=1.0, double_sided=True)
    if kind is LightKind.SPOT:
        light = Light(kind, intensity=60.0, position=(0.3, -3.0, 4.4), direction=(0.0, 1.0, 0.0), outer_cone=1.0)
    else:
        light = Light(kind, intensity=3.0, direction=(0.28, 0.96, 0.0))
    return DrawList((Instance(floor, grey, np.eye(4)), Instance(slab, grey, np.eye(4))), lights=(light,))


def from_above() -> Camera:
    """Return a camera that looks down at the floor of ``slab_over_floor`` at 40 degrees."""
    c, s = math.cos(math.radians(40.0)), math.sin(math.radians(40.0))
    X = np.eye(4)
    X[:3, :3] = np.array(((1, 0, 0), (0, c, s), (0, -s, c)))
    X[:3, 3] = 0.0, -2.2, 1.0
    return Camera(96, 72, 80.0, 80.0, 48.0, 36.0, 0.05, 100.0, X)


def rendered(
    renderer: CpuRenderer,
    scene: DrawList,
    camera: Camera,
    rig: Rig,
    samples: SampleCount = 1,
    background: tuple[int, int, int] = (0, 0, 0),
) -> NDArray[np.uint8]:
    """Render the studio look: (H, W, 3)."""
    frame = renderer.render(scene, camera, Output.COLOR, Look("studio", background, samples, rig))
    return frame.color.copy()
