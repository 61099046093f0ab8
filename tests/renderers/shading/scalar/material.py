"""Material and light of a segment of one instance: base colour, normal, light; works on ``interpolation``'s rows A_."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from renderers.shading.materials import COLORS_DECODE, COLORS_REPLACE
from tests.renderers.shading.scalar.brdf import reflect_pbr
from tests.renderers.shading.scalar.gamma import decode_gamma
from tests.renderers.shading.scalar.interpolation import A_BASE, A_COLOR, A_FACING, A_NORMAL, A_TANGENT, A_UV0
from tests.renderers.shading.scalar.sampling import AS_STORED, SRGB, sample

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)


@njit(nogil=True, error_model="numpy")
def _sample(index, tables, space, x, rows):
    """Return RGBA of a texture at column ``x`` of the attribute rows."""
    texture = tables.textures[index]
    uv = A_UV0 + 2 * texture.uv_set
    return sample(texture, tables.value_from_byte, space, np.float64(rows[uv, x]), np.float64(rows[uv + 1, x]))


@njit(nogil=True, error_model="numpy")
def base_colors(pbr, colored, material, tables, begin, end, rows):
    """Fill the rows A_BASE: base colour and alpha, factor x vertex colour x texture."""
    for k in range(4):
        factor = material.base_color[k]
        if colored:
            rule = material.vertex_colors if k < 3 else 0
            if rule & COLORS_REPLACE:
                factor = _ONE
            for x in range(begin, end):
                c = rows[A_COLOR + k, x]
                if rule & COLORS_DECODE:
                    c = decode_gamma(c, tables.linear_from_gamma)
                rows[A_BASE + k, x] = factor * c
        else:
            for x in range(begin, end):
                rows[A_BASE + k, x] = factor
    index = material.base_color_texture
    if index >= 0:
        space = SRGB if pbr else AS_STORED
        for x in range(begin, end):
            r, g, b, alpha = _sample(index, tables, space, x, rows)
            rows[A_BASE, x] *= r
            rows[A_BASE + 1, x] *= g
            rows[A_BASE + 2, x] *= b
            rows[A_BASE + 3, x] *= alpha


@njit(nogil=True, error_model="numpy")
def unit_normals(mapped, material, tables, begin, end, rows):
    """Make the rows A_NORMAL unit length and apply the normal map; normals without a direction become 0."""
    for x in range(begin, end):
        nx, ny, nz = rows[A_NORMAL, x], rows[A_NORMAL + 1, x], rows[A_NORMAL + 2, x]
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        scale = _ONE / length if length > _ZERO else _ZERO
        rows[A_NORMAL, x] = nx * scale
        rows[A_NORMAL + 1, x] = ny * scale
        rows[A_NORMAL + 2, x] = nz * scale
    if not mapped:
        return
    index, strength = material.normal_texture, material.normal_scale
    two = np.float32(2.0)
    for x in range(begin, end):
        # In the frame of the front; a back face shows the reversed normal (glTF 3.9.6).
        side = rows[A_FACING, x]
        nx, ny, nz = rows[A_NORMAL, x] * side, rows[A_NORMAL + 1, x] * side, rows[A_NORMAL + 2, x] * side
        tx, ty, tz = rows[A_TANGENT, x], rows[A_TANGENT + 1, x], rows[A_TANGENT + 2, x]
        along = nx * tx + ny * ty + nz * tz
        tx, ty, tz = tx - along * nx, ty - along * ny, tz - along * nz
        length = math.sqrt(tx * tx + ty * ty + tz * tz)
        if not (length > _ZERO):
            continue
        scale = _ONE / length
        tx, ty, tz = tx * scale, ty * scale, tz * scale
        hand = _ONE if rows[A_TANGENT + 3, x] >= _ZERO else -_ONE
        bx, by, bz = (ny * tz - nz * ty) * hand, (nz * tx - nx * tz) * hand, (nx * ty - ny * tx) * hand
        r, g, b, _ = _sample(index, tables, AS_STORED, x, rows)
        mx, my, mz = (r * two - _ONE) * strength, (g * two - _ONE) * strength, b * two - _ONE
        ux, uy, uz = (
            mx * tx + my * bx + mz * nx,
            mx * ty + my * by + mz * ny,
            mx * tz + my * bz + mz * nz,
        )
        length = math.sqrt(ux * ux + uy * uy + uz * uz)
        if not (length > _ZERO):
            continue
        scale = side / length
        rows[A_NORMAL, x] = ux * scale
        rows[A_NORMAL + 1, x] = uy * scale
        rows[A_NORMAL + 2, x] = uz * scale


@njit(nogil=True, error_model="numpy")
def light_phong(begin, end, rows):
    """Fill the rows A_BASE with base x max(0, n . (0, 0, -1)): the headlight shines along the optical axis."""
    for x in range(begin, end):
        light = max(-rows[A_NORMAL + 2, x], _ZERO)
        rows[A_BASE, x] *= light
        rows[A_BASE + 1, x] *= light
        rows[A_BASE + 2, x] *= light


@njit(nogil=True, error_model="numpy")
def light_pbr(material, tables, lens, y, begin, end, rows):
    """Fill the rows A_BASE with reflection, occlusion and emission, linear."""
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    dy = np.float32((y + 0.5 - cy) / fy)
    er, eg, eb = material.emissive[0], material.emissive[1], material.emissive[2]
    for x in range(begin, end):
        dx = np.float32((x + 0.5 - cx) / fx)
        scale = -_ONE / math.sqrt(dx * dx + dy * dy + _ONE)
        metallic, roughness = material.metallic, material.roughness
        if material.metallic_roughness_texture >= 0:
            _, g, b, _ = _sample(material.metallic_roughness_texture, tables, AS_STORED, x, rows)
            roughness *= g
            metallic *= b
        red, green, blue = reflect_pbr(
            rows[A_NORMAL, x],
            rows[A_NORMAL + 1, x],
            rows[A_NORMAL + 2, x],
            dx * scale,
            dy * scale,
            scale,
            rows[A_BASE, x],
            rows[A_BASE + 1, x],
            rows[A_BASE + 2, x],
            metallic,
            roughness,
        )
        if material.occlusion_texture >= 0:
            r, _, _, _ = _sample(material.occlusion_texture, tables, AS_STORED, x, rows)
            unoccluded = _ONE + material.occlusion_strength * (r - _ONE)
            red, green, blue = red * unoccluded, green * unoccluded, blue * unoccluded
        if material.emissive_texture >= 0:
            r, g, b, _ = _sample(material.emissive_texture, tables, SRGB, x, rows)
            red, green, blue = red + er * r, green + eg * g, blue + eb * b
        else:
            red, green, blue = red + er, green + eg, blue + eb
        rows[A_BASE, x], rows[A_BASE + 1, x], rows[A_BASE + 2, x] = red, green, blue
