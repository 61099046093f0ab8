"""What a segment of pixels of one instance looks like: base colour, normal, light. Works on the rows of resolve."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from renderers.shading.materials import (
    COLORS_MULTIPLY,
    COLORS_REPLACE,
    MF_BASE,
    MF_EMISSIVE,
    MF_METALLIC,
    MF_NORMAL_SCALE,
    MF_OCCLUSION,
    MF_ROUGHNESS,
    MI_BASE,
    MI_COLORS,
    MI_EMISSIVE,
    MI_METALLIC_ROUGHNESS,
    MI_NORMAL,
    MI_OCCLUSION,
)
from renderers.shading.texture_table import TF_COLUMNS, TI_COLUMNS, TI_UV_SET
from tests.renderers.shading.scalar.lights import reflect_pbr
from tests.renderers.shading.scalar.memory import load_i64
from tests.renderers.shading.scalar.resolve import A_BASE, A_COLOR, A_FACING, A_NORMAL, A_TANGENT, A_UV0
from tests.renderers.shading.scalar.sampling import AS_STORED, SRGB, sample
from tests.renderers.shading.scalar.transfer import decode_gamma

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)


@njit(nogil=True, error_model="numpy")
def _texture(row, tables, space, x, a):
    """A texture at column ``x`` of the attribute rows ``a``."""
    textures, floats, values = tables
    textures += row * (8 * TI_COLUMNS)
    uv = A_UV0 + 2 * load_i64(textures, TI_UV_SET)
    return sample(
        textures, floats + row * (4 * TF_COLUMNS), values, space, np.float64(a[uv, x]), np.float64(a[uv + 1, x])
    )


@njit(nogil=True, error_model="numpy")
def base_colors(pbr, colored, mi, mf, tables, decoded, begin, end, a):
    """Base colour and alpha of a segment into the rows A_BASE: factor x vertex colour x texture."""
    for k in range(4):
        factor = mf[MF_BASE + k]
        if colored:
            rule = mi[MI_COLORS] if k < 3 else COLORS_MULTIPLY
            if rule == COLORS_REPLACE:
                factor = _ONE
            for x in range(begin, end):
                c = a[A_COLOR + k, x]
                a[A_BASE + k, x] = factor * (c if rule == COLORS_MULTIPLY else decode_gamma(c, decoded))
        else:
            for x in range(begin, end):
                a[A_BASE + k, x] = factor
    row = mi[MI_BASE]
    if row >= 0:
        space = SRGB if pbr else AS_STORED
        for x in range(begin, end):
            r, g, b, alpha = _texture(row, tables, space, x, a)
            a[A_BASE, x] *= r
            a[A_BASE + 1, x] *= g
            a[A_BASE + 2, x] *= b
            a[A_BASE + 3, x] *= alpha


@njit(nogil=True, error_model="numpy")
def unit_normals(mapped, mi, mf, tables, begin, end, a):
    """Makes the rows A_NORMAL unit length and applies the normal map; what has no direction becomes 0."""
    for x in range(begin, end):
        nx, ny, nz = a[A_NORMAL, x], a[A_NORMAL + 1, x], a[A_NORMAL + 2, x]
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        scale = _ONE / length if length > _ZERO else _ZERO
        a[A_NORMAL, x] = nx * scale
        a[A_NORMAL + 1, x] = ny * scale
        a[A_NORMAL + 2, x] = nz * scale
    if not mapped:
        return
    row, strength = mi[MI_NORMAL], mf[MF_NORMAL_SCALE]
    two = np.float32(2.0)
    for x in range(begin, end):
        # In the frame of the front; a back face shows the reversed normal (glTF 3.9.6).
        side = a[A_FACING, x]
        nx, ny, nz = a[A_NORMAL, x] * side, a[A_NORMAL + 1, x] * side, a[A_NORMAL + 2, x] * side
        tx, ty, tz = a[A_TANGENT, x], a[A_TANGENT + 1, x], a[A_TANGENT + 2, x]
        along = nx * tx + ny * ty + nz * tz
        tx, ty, tz = tx - along * nx, ty - along * ny, tz - along * nz
        length = math.sqrt(tx * tx + ty * ty + tz * tz)
        if not (length > _ZERO):
            continue
        scale = _ONE / length
        tx, ty, tz = tx * scale, ty * scale, tz * scale
        hand = _ONE if a[A_TANGENT + 3, x] >= _ZERO else -_ONE
        bx, by, bz = (ny * tz - nz * ty) * hand, (nz * tx - nx * tz) * hand, (nx * ty - ny * tx) * hand
        r, g, b, _ = _texture(row, tables, AS_STORED, x, a)
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
        a[A_NORMAL, x] = ux * scale
        a[A_NORMAL + 1, x] = uy * scale
        a[A_NORMAL + 2, x] = uz * scale


@njit(nogil=True, error_model="numpy")
def light_phong(begin, end, a):
    """The head light shines along the optical axis: base x max(0, n . (0, 0, -1)), into the rows A_BASE."""
    for x in range(begin, end):
        light = max(-a[A_NORMAL + 2, x], _ZERO)
        a[A_BASE, x] *= light
        a[A_BASE + 1, x] *= light
        a[A_BASE + 2, x] *= light


@njit(nogil=True, error_model="numpy")
def light_pbr(mi, mf, tables, intrinsics, y, begin, end, a):
    """Reflection, occlusion and emission, linear, into the rows A_BASE."""
    fx, fy, cx, cy = intrinsics[0], intrinsics[1], intrinsics[2], intrinsics[3]
    dy = np.float32((y + 0.5 - cy) / fy)
    rough_row, occlusion_row, emissive_row = mi[MI_METALLIC_ROUGHNESS], mi[MI_OCCLUSION], mi[MI_EMISSIVE]
    er, eg, eb = mf[MF_EMISSIVE], mf[MF_EMISSIVE + 1], mf[MF_EMISSIVE + 2]
    for x in range(begin, end):
        dx = np.float32((x + 0.5 - cx) / fx)
        scale = -_ONE / math.sqrt(dx * dx + dy * dy + _ONE)
        metallic, roughness = mf[MF_METALLIC], mf[MF_ROUGHNESS]
        if rough_row >= 0:
            _, g, b, _ = _texture(rough_row, tables, AS_STORED, x, a)
            roughness *= g
            metallic *= b
        red, green, blue = reflect_pbr(
            a[A_NORMAL, x],
            a[A_NORMAL + 1, x],
            a[A_NORMAL + 2, x],
            dx * scale,
            dy * scale,
            scale,
            a[A_BASE, x],
            a[A_BASE + 1, x],
            a[A_BASE + 2, x],
            metallic,
            roughness,
        )
        if occlusion_row >= 0:
            r, _, _, _ = _texture(occlusion_row, tables, AS_STORED, x, a)
            kept = _ONE + mf[MF_OCCLUSION] * (r - _ONE)
            red, green, blue = red * kept, green * kept, blue * kept
        if emissive_row >= 0:
            r, g, b, _ = _texture(emissive_row, tables, SRGB, x, a)
            red, green, blue = red + er * r, green + eg * g, blue + eb * b
        else:
            red, green, blue = red + er, green + eg, blue + eb
        a[A_BASE, x], a[A_BASE + 1, x], a[A_BASE + 2, x] = red, green, blue
