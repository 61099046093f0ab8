"""Reference for shading: NumPy in float64, all pixels of an instance at once, written from the specifications.

Which primitive a pixel sees comes from the rasterizer. Images of ``renderers.shading``, which interpolates along spans
in float32, may differ from it by one level of 255.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.color import srgb_colors_from_linear, srgb_values_from_linear
from renderers.drawlist import DrawList, Image, Instance, Material, Sampler, Texture, Wrap
from renderers.interface import VTK_LOOKS, Look
from renderers.shading.mikktspace import with_tangents
from renderers.visibility_buffer import Visibility

Array = NDArray[np.float64]


def shaded(scene: DrawList, visible: Visibility, camera: Camera, look: Look) -> NDArray[np.int64]:
    """Return the image of the visible surfaces, (H, W, 3), opaque whatever the materials say."""
    color = np.empty((camera.height, camera.width, 3), np.int64)
    color[:] = look.background
    for i, instance in enumerate(scene.instances):
        first, end = visible.first_ids[i : i + 2]
        y, x = np.nonzero((visible.ids >= first) & (visible.ids < end))
        if len(y):
            rays = np.stack(((x + 0.5 - camera.cx) / camera.fx, (y + 0.5 - camera.cy) / camera.fy, np.ones(len(x))), -1)
            with np.errstate(all="ignore"):
                seen = surface_colors(instance, visible.ids[y, x] - first, visible.X_camera_mesh[i], rays, look.name)
            color[y, x] = 255.0 * np.nan_to_num(seen[:, :3]) + 0.5
    return color


def reference_material(material: Material, look: str) -> Material:
    """Return the material as glTF says, or as RenderEngineVtk shades it in the looks that stand for it."""

    def as_in_vtk(texture: Texture | None) -> Texture | None:
        if texture is None:
            return None
        given = texture.sampler
        wrap = Wrap.CLAMP_TO_EDGE if Wrap.CLAMP_TO_EDGE in (given.wrap_s, given.wrap_t) else Wrap.REPEAT
        return replace(texture, sampler=Sampler(wrap, wrap, given.mag_linear, given.min_linear, mipmaps=False))

    if look in ("pbr", "gltf") and material.vtk_export:
        material = replace(material, roughness=0.5, metallic=0.0, metallic_roughness_texture=None)
    if look in VTK_LOOKS:
        material = replace(
            material,
            base_color_texture=as_in_vtk(material.base_color_texture),
            metallic_roughness_texture=as_in_vtk(material.metallic_roughness_texture),
            normal_texture=as_in_vtk(material.normal_texture),
            occlusion_texture=as_in_vtk(material.metallic_roughness_texture and material.occlusion_texture),
            emissive_texture=as_in_vtk(material.emissive_texture),
            emissive=material.emissive if material.emissive_texture else (0.0, 0.0, 0.0),
        )
    if look == "gltf":  # which has no ambient light
        material = replace(material, occlusion_texture=None)
    if look == "plain":
        red, green, blue = srgb_values_from_linear(np.array(material.base_color[:3])).tolist()
        material = replace(material, base_color=(red, green, blue, material.base_color[3]))
    if look in ("phong", "plain"):
        material = replace(material, normal_texture=None)
    return material


def surface_colors(instance: Instance, primitives: NDArray[np.int64], X: Array, rays: Array, look: str) -> Array:
    """Return the encoded colour and the alpha that pixels see of one instance, (n, 4) of 0 .. 1.

    Args:
        primitives: (n,) index of the primitive that each pixel sees.
        X: (4, 4), mesh to optical frame.
        rays: (n, 3) direction of each pixel, z = 1.
    """
    linear = linear_colors(instance, primitives, X, rays, look)
    encoded = np.clip(linear, 0.0, 1.0)
    if look in ("pbr", "gltf"):
        encoded[:, :3] **= 1 / 2.2
    encoded[:, 3] = linear[:, 3]
    return encoded


def linear_colors(instance: Instance, primitives: NDArray[np.int64], X: Array, rays: Array, look: str) -> Array:
    """Return colours and alpha as ``surface_colors`` does, before they are limited and encoded."""
    mesh, material = instance.mesh, reference_material(instance.material, look)
    lit = not material.unlit and mesh.elements.shape[1] == 3
    if lit and material.normal_texture is not None:
        mesh = with_tangents(mesh, material.normal_texture.uv_set)
    corners = mesh.elements[primitives]
    ends = mesh.positions.astype(np.float64)[corners] @ X[:3, :3].T + X[:3, 3]
    weights = triangle_weights(ends, rays) if corners.shape[1] == 3 else line_weights(ends, rays)

    def interpolated(values: NDArray[Any]) -> Array:
        mixed: Array = np.einsum("nk,nkc->nc", weights, values[corners].astype(np.float64))
        return mixed

    def sampled(texture: Texture, srgb: bool = False) -> Array:
        coordinates = mesh.uv1 if texture.uv_set else mesh.uv0
        return sample(texture, interpolated(coordinates) if coordinates is not None else np.zeros((len(rays), 2)), srgb)

    base = np.tile(np.array(material.base_color, np.float64), (len(rays), 1))
    if mesh.colors is not None:
        colors = interpolated(srgb_colors_from_linear(mesh.colors) if look == "plain" else mesh.colors)
        if look == "pbr":  # as RenderEngineVtk: the factor's colour only counts where nothing is lit
            colors[:, :3] = np.clip(colors[:, :3], 0.0, 1.0) ** 2.2 if material.decodes_vertex_colors else colors[:, :3]
            base[:, :3] = base[:, :3] if not lit else 1.0
        base *= colors
    if material.base_color_texture is not None:
        base *= sampled(material.base_color_texture, look in ("pbr", "gltf"))
    if not lit:
        return base
    normals = Normals(ends, X, look in VTK_LOOKS)
    n = normals.of_mesh(interpolated(mesh.normals)) if mesh.normals is not None else normals.flat()
    if material.normal_texture is not None and mesh.tangents is not None:
        texels = sampled(material.normal_texture)[:, :3] * 2.0 - 1.0
        n = normals.mapped(n, interpolated(mesh.tangents), texels * (*(material.normal_scale,) * 2, 1.0))
    if look in ("phong", "plain"):
        return np.append(base[:, :3] * np.maximum(-n[:, 2:], 0.0), base[:, 3:], axis=1)
    metallic, roughness = np.full(len(rays), material.metallic), np.full(len(rays), material.roughness)
    if material.metallic_roughness_texture is not None:
        texels = sampled(material.metallic_roughness_texture)
        roughness, metallic = roughness * texels[:, 1], metallic * texels[:, 2]
    radiance = reflected(n, unit(-rays), base[:, :3], metallic[:, None], roughness[:, None])
    if material.occlusion_texture is not None:
        radiance *= 1.0 + material.occlusion_strength * (sampled(material.occlusion_texture)[:, :1] - 1.0)
    emitted = np.array(material.emissive)
    if material.emissive_texture is not None:
        emitted = emitted * sampled(material.emissive_texture, True)[:, :3]
    return np.append(radiance + emitted, base[:, 3:], axis=1)


def unit(v: Array) -> Array:
    """Return vectors of unit length, (n, 3); 0 without a direction."""
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.where(length > 0.0, v / np.where(length > 0.0, length, 1.0), 0.0)


def triangle_weights(ends: Array, rays: Array) -> Array:
    """Return perspective-correct barycentric coordinates, (n, 3): not below 0, of the sum 1.

    Coverage is exact in 1/256 pixel: a pixel's centre may lie a little outside of its triangle.
    """
    p0, p1, p2 = ends[:, 0], ends[:, 1], ends[:, 2]
    rows = np.stack((np.cross(p1, p2), np.cross(p2, p0), np.cross(p0, p1)), axis=1)  # det(P) P^-1
    side = np.where(np.einsum("nc,nc->n", p0, rows[:, 0]) < 0.0, -1.0, 1.0)
    weights = np.maximum(np.einsum("nkc,nc->nk", rows, rays) * side[:, None], 0.0)
    total = weights.sum(axis=1, keepdims=True)
    usable: Array = np.where((total > 0.0) & np.isfinite(total), weights / total, 1.0 / 3.0)
    return usable


def line_weights(ends: Array, rays: Array) -> Array:
    """Return the weights of the end or ends of points and lines, at the place that projects nearest to the pixel.

    All points p + t e of a line project onto a line of the image with the direction e.xy p.z - p.xy e.z.
    """
    if ends.shape[1] == 1:
        return np.ones((len(ends), 1))
    p, e = ends[:, 0], ends[:, 1] - ends[:, 0]
    s = e[:, :2] * p[:, 2:] - p[:, :2] * e[:, 2:]
    along = (s * rays[:, :2]).sum(axis=1)
    t = (along * p[:, 2] - (p[:, :2] * s).sum(axis=1)) / ((e[:, :2] * s).sum(axis=1) - along * e[:, 2])
    t = np.where(np.isfinite(t), np.clip(t, 0.0, 1.0), 0.0)
    return np.stack((1.0 - t, t), axis=-1)


@dataclass(frozen=True)
class Normals:
    """Unit normals of triangles in the optical frame, on the side that the pixel sees."""

    ends: Array
    """(n, 3, 3) corners in the optical frame."""
    X: Array
    """(4, 4), mesh to optical frame."""
    as_vtk: bool
    """True: the fronts of mirrored meshes count as backs, and bitangents are not mirrored."""

    @property
    def mirror(self) -> float:
        return -1.0 if np.linalg.det(self.X[:3, :3]) < 0.0 else 1.0

    @property
    def facing(self) -> Array:
        """(n, 1): -1 where a back face is seen."""
        back = np.einsum("nc,nc->n", self.ends[:, 0], np.cross(self.ends[:, 1], self.ends[:, 2])) > 0.0
        return np.where(back, -1.0, 1.0)[:, None] * (1.0 if self.as_vtk else self.mirror)

    def flat(self) -> Array:
        """Normals of the triangles themselves, towards the camera."""
        outward = np.cross(self.ends[:, 1] - self.ends[:, 0], self.ends[:, 2] - self.ends[:, 0])
        return unit(outward) * np.where((outward * self.ends[:, 0]).sum(axis=1) < 0.0, 1.0, -1.0)[:, None]

    def of_mesh(self, normals: Array) -> Array:
        """Normals of the mesh, by the cofactors of X: its inverse transpose, also where it flattens."""
        a = self.X[:3, :3]
        cofactors = np.stack((np.cross(a[1], a[2]), np.cross(a[2], a[0]), np.cross(a[0], a[1])))
        return unit(normals @ (cofactors * self.mirror / (np.abs(cofactors).max() or 1.0)).T) * self.facing

    def mapped(self, n: Array, tangents: Array, texels: Array) -> Array:
        """Normals ``n``, bent by the texels of a normal map, (n, 3); a back face shows the reversed normal."""
        front = n * self.facing
        t = tangents[:, :3] @ self.X[:3, :3].T
        t = t - (t * front).sum(axis=1, keepdims=True) * front
        hand = np.where(tangents[:, 3:] * (1.0 if self.as_vtk else self.mirror) >= 0.0, 1.0, -1.0)
        b = np.cross(front, unit(t)) * hand
        bent = unit(texels[:, :1] * unit(t) + texels[:, 1:2] * b + texels[:, 2:] * front) * self.facing
        has_direction = (t != 0.0).any(axis=1, keepdims=True) & (bent != 0.0).any(axis=1, keepdims=True)
        return np.where(has_direction, bent, n)


def reflected(n: Array, v: Array, base: Array, metallic: Array, roughness: Array) -> Array:
    """Return the radiance, (n, 3), under one white headlight of radiance 1 along the optical axis.

    glTF 2.0, appendix B (GGX, height-correlated Smith, Schlick), with VTK's F90, lower limit of cosines and roughness.
    """
    l = np.array((0.0, 0.0, -1.0))
    h = unit(v + l)

    def cosine(a: Array, b: Array) -> Array:
        limited: Array = np.clip((a * b).sum(axis=-1, keepdims=True), 1e-5, 1.0)
        return limited

    n_l, n_v, n_h, h_l = cosine(n, l), cosine(n, v), cosine(n, h), cosine(h, l)
    alpha2 = (0.05 + 0.95 * roughness) ** 4
    D = alpha2 / (np.pi * (n_h**2 * (alpha2 - 1.0) + 1.0) ** 2)
    V = 0.5 / (n_l * np.sqrt(alpha2 + n_v**2 * (1.0 - alpha2)) + n_v * np.sqrt(alpha2 + n_l**2 * (1.0 - alpha2)))
    f0 = 0.04 * (1.0 - metallic) + base * metallic
    f90 = np.clip(16.5 * f0.sum(axis=1, keepdims=True), 0.0, 1.0)
    F = f0 + (f90 - f0) * (1.0 - h_l) ** 5
    radiance: Array = ((1.0 - F) * (1.0 - metallic) / np.pi * base + F * D * V) * n_l
    return radiance


def sample(texture: Texture, uv: Array, srgb: bool) -> Array:
    """Return RGBA of the largest mip level at (n, 2) coordinates, (n, 4); colours are decoded before they are mixed."""
    if texture.uv_transform is not None:
        matrix = np.array(texture.uv_transform, np.float64).reshape(2, 3)
        uv = uv @ matrix[:, :2].T + matrix[:, 2]
    s = texture.sampler
    uv = np.stack((near_origin(uv[:, 0], s.wrap_s), near_origin(uv[:, 1], s.wrap_t)), axis=-1)
    return bilinear(texels_of(texture.image, srgb), s, uv, s.mag_linear)


def bilinear(texels: Array, sampler: Sampler, uv: Array, smooth: bool) -> Array:
    """Return the texels of one mip level at (n, 2) coordinates, mixed or the nearest, (n, 4)."""
    height, width = texels.shape[:2]
    x, y = uv[:, 0] * width, uv[:, 1] * height

    def texel(column: Array, row: Array) -> Array:
        found: Array = texels[wrapped(row, height, sampler.wrap_t), wrapped(column, width, sampler.wrap_s)]
        return found

    if not smooth:
        return texel(np.floor(x), np.floor(y))
    left, upper = np.floor(x - 0.5), np.floor(y - 0.5)
    s, t = (x - 0.5 - left)[:, None], (y - 0.5 - upper)[:, None]
    above = texel(left, upper) * (1.0 - s) + texel(left + 1, upper) * s
    below = texel(left, upper + 1) * (1.0 - s) + texel(left + 1, upper + 1) * s
    mixed: Array = above * (1.0 - t) + below * t
    return mixed


def srgb_to_linear(c: Array) -> Array:
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


@lru_cache(maxsize=64)
def texels_of(image: Image, srgb: bool) -> Array:
    """Return the texels of an image, (H, W, 4) of 0 .. 1."""
    texels: Array = image.decode() / 255.0
    if srgb:
        texels[..., :3] = srgb_to_linear(texels[..., :3])
    return texels


def near_origin(coordinates: Array, wrap: Wrap) -> Array:
    """Return equivalent coordinates of -1 .. 2, the period of MIRRORED_REPEAT; 0 where float32 has no fractions."""
    coordinates = np.where(np.abs(coordinates) < 1e9, coordinates, 0.0)
    if wrap is Wrap.CLAMP_TO_EDGE:
        return np.clip(coordinates, -1.0, 2.0)
    return coordinates - 2.0 * np.floor(0.5 * coordinates)


def wrapped(index: Array, size: int, wrap: Wrap) -> NDArray[np.int64]:
    """Return texels 0 .. size - 1 of any indices."""
    whole = index.astype(np.int64)
    if wrap is Wrap.CLAMP_TO_EDGE:
        return np.clip(whole, 0, size - 1)
    if wrap is Wrap.REPEAT:
        return whole % size
    whole = whole % (2 * size)
    return np.where(whole < size, whole, 2 * size - 1 - whole)
