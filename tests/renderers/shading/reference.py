"""Reference for whole images: NumPy in float64, written from the specifications and not from the kernels.

``reference_color`` intersects every ray with every triangle, and blends all surfaces of each pixel.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import AlphaMode, DrawList, Image, Instance, Material, Mesh, Sampler
from renderers.interface import VTK_LOOKS, Look
from renderers.raster import CpuRenderer
from renderers.shading import paint, prepare
from renderers.visibility_buffer import Rasterizer
from tests.renderers.shading.pixel_reference import surface_colors

Array = NDArray[np.float64]


def camera(width: int = 48, height: int = 36, *, focal: float = 40.0) -> Camera:
    """Return a camera at the origin that looks along +Z, off-centre, fx != fy."""
    return Camera(width, height, focal, focal * 1.1, width / 2 - 0.5, height / 2 + 0.75, 0.05, 100.0, np.eye(4))


def rays(view: Camera) -> Array:
    """Return the direction of every pixel's ray, z = 1, (H * W, 3)."""
    x, y = np.meshgrid(np.arange(view.width) + 0.5, np.arange(view.height) + 0.5)
    return np.stack(((x - view.cx) / view.fx, (y - view.cy) / view.fy, np.ones_like(x)), axis=-1).reshape(-1, 3)


def hits(direction: Array, corners: Array) -> tuple[Array, Array]:
    """Intersect all rays with all triangles (Moeller and Trumbore).

    Args:
        direction: (n, 3).
        corners: (..., 3, 3).

    Returns:
        z, NaN where missed, (..., n), and weights, (..., n, 3).
    """
    e1, e2 = corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :]
    s = -corners[..., 0, :]
    q = np.cross(s, e1)
    with np.errstate(divide="ignore", invalid="ignore"):
        # The rays only occur in triple products, which are linear: direction x e2 . v = direction . (e2 x v).
        f = 1.0 / (np.cross(e2, e1) @ direction.T)
        u = f * (np.cross(e2, s) @ direction.T)
        v = f * (q @ direction.T)
        z = f * (e2 * q).sum(axis=-1)[..., None]
        inside = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (z > 0.0)
        weights = np.stack((1.0 - u - v, u, v), axis=-1)
    return np.where(inside, z, np.nan), weights


RENDERER = CpuRenderer(threads=1)


def painted(scene: DrawList, view: Camera, look: Look, rasterizer: Rasterizer = RENDERER) -> Array:
    """Return the image that ``renderers.shading`` paints: (H, W, 3) int64."""
    color = np.full((view.height, view.width, 3), 77, np.uint8)
    prepared = prepare(scene.instances, look.name)
    paint(rasterizer, scene, prepared, view, look, color)
    return color.astype(np.int64)


def image_of(pixels: NDArray[np.uint8]) -> Image:
    """Return an image of (H, W, 4) texels."""
    return Image(pixels.tobytes(), lambda: pixels)


UNFILTERED = Sampler(mipmaps=False)
"""For textures of these tests: the reference knows no mip levels."""


@dataclass
class Surface:
    """What a pixel sees of one triangle."""

    z: float
    color: Array
    """(3,), encoded, 0 .. 1."""
    alpha: float
    """Of the material, whatever its mode."""
    material: Material
    is_transparent: bool
    """VTK draws it after the others, without hiding any."""
    has_alpha: bool
    """Its texture is not opaque: drawn after opaque surfaces, of whose order VTK makes no promise."""


def blended_by_distance(surfaces: list[Surface], background: Array) -> Array:
    """Return a pixel's colour as glTF says."""
    mixed = background
    for surface in sorted(surfaces, key=lambda surface: -surface.z):
        mode, alpha = surface.material.alpha_mode, min(max(surface.alpha, 0.0), 1.0)
        if mode is AlphaMode.OPAQUE:
            alpha = 1.0
        elif mode is AlphaMode.MASK:
            alpha = float(surface.alpha >= surface.material.alpha_cutoff)
        mixed = mixed * (1 - alpha) + surface.color * alpha
    return mixed


def drawn_as_by_vtk(surfaces: list[Surface], background: Array) -> Array:
    """Return a pixel's colour as OpenGL blends it, in the order of the list, but opaque surfaces first."""
    mixed, depth = background, np.inf
    for surface in sorted(surfaces, key=lambda surface: (surface.is_transparent, surface.has_alpha)):
        alpha = min(max(surface.alpha, 0.0), 1.0)
        if surface.z > depth or alpha == 0.0:
            continue
        mixed = mixed * (1 - alpha) + surface.color * alpha
        depth = depth if surface.is_transparent else surface.z
    return mixed


def is_transparent_for_vtk(instance: Instance) -> bool:
    material, colors = instance.material, instance.mesh.colors
    if material.base_color[3] < 1.0 or (colors is not None and (colors[:, 3] < 1.0).any()):
        return True
    return material.vtk_export and has_alpha(material)


def has_alpha(material: Material) -> bool:
    texture = material.base_color_texture
    return texture is not None and bool((texture.image.decode()[..., 3] < 255).any())


def reference_color(scene: DrawList, view: Camera, look: Look) -> Array:
    """Blend all surfaces of every pixel: (H, W, 3) float64, 0 .. 255, not rounded."""
    direction = rays(view)
    background = np.array(look.background, dtype=np.float64) / 255.0
    layers: list[list[Surface]] = [[] for _ in direction]
    for instance in scene.instances:
        X = view.X_camera_world @ instance.X_world_mesh
        corners = (instance.mesh.positions.astype(np.float64) @ X[:3, :3].T + X[:3, 3])[instance.mesh.elements]
        mirrored = np.linalg.det(X[:3, :3]) < 0
        order = is_transparent_for_vtk(instance), has_alpha(instance.material)
        z, _ = hits(direction, corners)
        shown = (z > view.near) & (z < view.far)
        if not instance.material.double_sided:
            shown &= ((np.linalg.det(corners) > 0) == mirrored)[:, None]
        triangles, pixels = np.nonzero(shown)
        colors = surface_colors(instance, triangles, X, direction[pixels], look.name)
        for triangle, p, color in zip(triangles, pixels, colors, strict=True):
            material = instance.material
            surface = Surface(float(z[triangle, p]), color[:3], float(color[3]), material, *order)
            layers[p].append(surface)
    blended = drawn_as_by_vtk if look.name in VTK_LOOKS else blended_by_distance
    result = np.array([blended(surfaces, background) for surfaces in layers]) * 255.0
    return result.reshape(view.height, view.width, 3)


def assert_as_reference(scene: DrawList, look: Look, view: Camera | None = None, *, exceptions: int = 0) -> None:
    """Compare every channel with the reference, within one level, half of which is rounding.

    Args:
        exceptions: number of pixels that may differ: where coverage, which is exact in 1/256 pixel, or a texel is
            another one.
    """
    view = view or camera()
    ours, expected = painted(scene, view, look), reference_color(scene, view, look)
    wrong = (np.abs(ours - expected) > 1.0).any(axis=-1)
    assert wrong.sum() <= exceptions, (wrong.sum(), ours[wrong][:3], expected[wrong][:3])
    assert (expected != np.array(look.background)).any(), "nothing was drawn"


def quad(size: float = 1.0, z: float = 2.0, **arrays: NDArray[np.float32]) -> Mesh:
    """Return a square in the plane z, front (counter-clockwise) towards the camera, u to the right, v downwards."""
    s = size
    positions = np.array(((-s, -s, z), (-s, s, z), (s, s, z), (s, -s, z)), dtype=np.float32)
    given: dict[str, NDArray[np.float32]] = {
        "normals": np.tile(np.array((0, 0, -1), np.float32), (4, 1)),
        "uv0": np.array(((0, 0), (0, 1), (1, 1), (1, 0)), dtype=np.float32),
    }
    return Mesh(positions, np.array(((0, 1, 2), (0, 2, 3)), dtype=np.uint32), **{**given, **arrays})


def ball(rings: int = 8, radius: float = 1.0, **arrays: NDArray[np.float32]) -> Mesh:
    """Return a sphere about the origin with normals, texture coordinates and tangents."""
    polar, azimuth = np.meshgrid(np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings + 1))
    n = np.stack((np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)), -1).reshape(-1, 3)
    uv = np.stack((azimuth / (2 * np.pi), polar / np.pi), -1).reshape(-1, 2)
    tangent = np.stack((-np.sin(azimuth), np.cos(azimuth), 0 * azimuth, np.ones_like(azimuth)), -1).reshape(-1, 4)
    n[np.abs(n) < 1e-12] = 0.0
    a = (np.arange(2 * rings)[:, None] * (rings + 1) + np.arange(rings)).reshape(-1)
    b = a + rings + 1
    triangles = np.concatenate((np.stack((a, a + 1, b + 1), -1), np.stack((a, b + 1, b), -1)))
    corners = n[triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    triangles = triangles[area > 1e-9]  # at the poles every other one is none
    given = {"normals": n.astype(np.float32), "uv0": uv.astype(np.float32), "tangents": tangent.astype(np.float32)}
    return Mesh((n * radius).astype(np.float32), triangles.astype(np.uint32), **{**given, **arrays})


def placed(mesh: Mesh, material: Material | None = None, *, z: float = 0.0, linear: Array | None = None) -> Instance:
    """Return an instance of a mesh, transformed by ``linear`` and moved along z."""
    X = np.eye(4)
    if linear is not None:
        X[:3, :3] = linear
    X[2, 3] = z
    return Instance(mesh, material or Material(metallic=0.0), X)
