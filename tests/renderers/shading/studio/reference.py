"""Reference for the ``studio`` look: slow numpy in float64 over whole images, written from the specifications
(glTF 2.0, its KHR extensions, OpenGL 4.6 8.14, Khronos PBR Neutral) and not from the kernels."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import DrawList, Image, Light, LightKind, Material, Texture
from tests.renderers.shading.pixel_reference import bilinear
from tests.renderers.shading.pixel_reference import srgb_to_linear as srgb_to_linear
from tests.renderers.shading.reference import hits, rays

Array = NDArray[np.float64]


@dataclass(frozen=True)
class VisibleSurfaces:
    """Visible surface of each of the n pixels, row by row."""

    instance: NDArray[np.int64]
    """-1 for the background."""
    primitive: NDArray[np.int64]
    weights: Array
    """(n, 3)."""
    point: Array
    """(n, 3), optical frame."""


def cast_rays(scene: DrawList, view: Camera, direction: Array | None = None) -> VisibleSurfaces:
    """Intersect every ray with every triangle, both sides."""
    d = rays(view) if direction is None else direction
    best = np.full(len(d), np.inf)
    instance, primitive = np.full(len(d), -1), np.zeros(len(d), np.int64)
    weights = np.zeros((len(d), 3))
    for k, each in enumerate(scene.instances):
        X = view.X_camera_world @ each.X_world_mesh
        points = each.mesh.positions @ X[:3, :3].T + X[:3, 3]
        z, w = hits(d, points[each.mesh.elements])
        first = np.where(np.isnan(z), np.inf, z).argmin(axis=0)
        columns = np.arange(len(d))
        nearer = z[first, columns] <= best
        best[nearer], instance[nearer], primitive[nearer] = z[first, columns][nearer], k, first[nearer]
        weights[nearer] = w[first, columns][nearer]
    return VisibleSurfaces(instance, primitive, weights, d * np.where(np.isfinite(best), best, 0.0)[:, None])


def attribute(scene: DrawList, visible: VisibleSurfaces, k: int, name: str) -> Array:
    """Interpolate an attribute of instance k's mesh at all pixels; undefined where another instance is visible."""
    values = getattr(scene.instances[k].mesh, name).astype(np.float64)
    corners = scene.instances[k].mesh.elements[np.where(visible.instance == k, visible.primitive, 0)]
    result: Array = np.einsum("nk,nkc->nc", visible.weights, values[corners])
    return result


def normalized(v: Array) -> Array:
    result: Array = v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-300)
    return result


def dot(a: Array, b: Array) -> Array:
    result: Array = (a * b).sum(axis=-1, keepdims=True)
    return result


def brdf(n: Array, v: Array, l: Array, base: Array, material: Material, roughness: Array, metallic: Array) -> Array:
    """Return f times n.l (glTF 2.0 appendix B, KHR_materials_ior, KHR_materials_specular)."""
    h = normalized(v + l)
    n_l, n_v, n_h, v_h = (np.clip(dot(a, b), 0.0, 1.0) for a, b in ((n, l), (n, v), (n, h), (v, h)))
    a = roughness**2
    D = a**2 / (np.pi * (n_h**2 * (a**2 - 1) + 1) ** 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        V = 0.5 / (n_l * np.sqrt(n_v**2 * (1 - a**2) + a**2) + n_v * np.sqrt(n_l**2 * (1 - a**2) + a**2))
    V = np.where(n_l > 0, V, 0.0)
    f0 = ((material.ior - 1) / (material.ior + 1)) ** 2 if material.ior else 1.0
    dielectric_f0 = np.minimum(f0 * np.array(material.specular_color), 1.0) * material.specular
    F = dielectric_f0 + (material.specular - dielectric_f0) * (1 - v_h) ** 5
    diffuse = base / np.pi
    dielectric = diffuse * (1 - F.max(axis=-1, keepdims=True)) + D * V * F
    metal = D * V * (base + (1 - base) * (1 - v_h) ** 5)
    return np.where(n_l > 0, (dielectric * (1 - metallic) + metal * metallic) * n_l, 0.0)


def incident_light(light: Light, view: Camera, p: Array) -> tuple[Array, Array]:
    """Return the directions to a light and its irradiance, at points (n, 3), optical frame (KHR_lights_punctual)."""
    R, t = view.X_camera_world[:3, :3], view.X_camera_world[:3, 3]
    axis = R @ light.direction
    color = np.array(light.color) * light.intensity
    if light.kind is LightKind.DIRECTIONAL:
        return np.broadcast_to(-axis, p.shape), np.broadcast_to(color, p.shape)
    toward = R @ light.position + t - p
    distance = np.linalg.norm(toward, axis=-1, keepdims=True)
    l = toward / distance
    attenuation = 1.0 / distance**2
    if light.range is not None:
        attenuation = attenuation * np.clip(1 - (distance / light.range) ** 4, 0, 1)
    if light.kind is LightKind.SPOT:
        scale = 1 / max(0.001, np.cos(light.inner_cone) - np.cos(light.outer_cone))
        attenuation = attenuation * np.clip(dot(-l, axis[None]) * scale - np.cos(light.outer_cone) * scale, 0, 1) ** 2
    return l, attenuation * color


def neutral(color: Array) -> Array:
    """Khronos PBR Neutral, as its specification writes it."""
    start, desaturation = 0.8 - 0.04, 0.15
    x = color.min(axis=-1, keepdims=True)
    color = color - np.where(x < 0.08, x - 6.25 * x * x, 0.04)
    peak = color.max(axis=-1, keepdims=True)
    d = 1 - start
    new_peak = 1 - d * d / (peak + d - start)
    g = 1 - 1 / (desaturation * (peak - new_peak) + 1)
    compressed = color * (new_peak / np.maximum(peak, 1e-9)) * (1 - g) + new_peak * g
    return np.where(peak < start, color, compressed)


def aces(color: Array) -> Array:
    """Hill's fit with the exposure that viewers apply first."""
    into = np.array(((0.59719, 0.35458, 0.04823), (0.07600, 0.90834, 0.01566), (0.02840, 0.13383, 0.83777)))
    out = np.array(((1.60475, -0.53108, -0.07367), (-0.10208, 1.10813, -0.00605), (-0.00327, -0.07276, 1.07602)))
    v = (color / 0.6) @ into.T
    mapped: Array = ((v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081)) @ out.T
    return mapped


TONES: dict[str, Callable[[Array], Array]] = {"neutral": neutral, "aces": aces, "none": lambda color: color}


def srgb(linear: Array) -> Array:
    """Encode 0 .. 1 as sRGB levels 0 .. 255, not rounded."""
    c = np.clip(linear, 0.0, 1.0)
    return 255.0 * np.where(c <= 0.0031308, 12.92 * c, 1.055 * c ** (1 / 2.4) - 0.055)


def levels(image: Image, color: bool) -> list[Array]:
    """Return all mip levels as float64, colours linear. Sizes are powers of two: each texel is the mean of four."""
    texels = image.decode().astype(np.float64) / 255.0
    if color:
        texels[..., :3] = srgb_to_linear(texels[..., :3])
    result = [texels]
    while max(result[-1].shape[:2]) > 1:
        h, w = result[-1].shape[:2]
        blocks = result[-1].reshape(max(h // 2, 1), min(h, 2), max(w // 2, 1), min(w, 2), 4)
        result.append(blocks.mean(axis=(1, 3)))
    return result


def textured(texture: Texture, uv: Array, right: Array, below: Array, color: bool) -> Array:
    """Sample a texture at coordinates (n, 2): (n, 4).

    Args:
        right, below: (n, 2, 2), coordinates half a pixel to the right and left, and below and above.
    """
    s = texture.sampler
    if texture.uv_transform is not None:
        m = np.array(texture.uv_transform).reshape(2, 3)
        uv, right, below = (v @ m[:, :2].T + m[:, 2] for v in (uv, right, below))
    chain = levels(texture.image, color)
    size = np.array(chain[0].shape[1::-1])
    footprint = np.maximum(*(np.linalg.norm((v[:, 0] - v[:, 1]) * size, axis=-1) for v in (right, below)))
    detail = np.log2(np.maximum(footprint, 1e-9))
    border = 0.5 if s.mag_linear and not s.min_linear and s.mipmaps else 0.0
    result = bilinear(chain[0], s, uv, s.mag_linear)
    is_minified = detail > border
    if not s.mipmaps:
        return np.where(is_minified[:, None], bilinear(chain[0], s, uv, s.min_linear), result)
    filtered = np.stack([bilinear(level, s, uv, s.min_linear) for level in chain])
    detail = np.clip(detail, 0, len(chain) - 1)
    pixel = np.arange(len(uv))
    if s.mip_linear:
        low = np.floor(detail).astype(np.int64)
        t = (detail - low)[:, None]
        mipped = filtered[low, pixel] * (1 - t) + filtered[np.minimum(low + 1, len(chain) - 1), pixel] * t
    else:
        mipped = filtered[np.minimum(np.ceil(detail + 0.5).astype(np.int64) - 1, len(chain) - 1), pixel]
    return np.where(is_minified[:, None], mipped, result)


def octahedral(d: Array) -> tuple[float, float]:
    """Map a direction to octahedral coordinates, 0 .. 1."""
    x, y, z = d / np.abs(d).sum()
    if z < 0.0:
        x, y = x - z * (1.0 if x >= 0.0 else -1.0), y - z * (1.0 if y >= 0.0 else -1.0)
    return 0.5 * x + 0.5, 0.5 * y + 0.5
