"""Rows of a picture: runs of equal record are resolved, segments of equal instance are shaded."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit

from renderers.jit import kernel
from renderers.shading.lights import reflect_pbr
from renderers.shading.materials import (
    ALPHA_BLEND,
    ALPHA_MASK,
    COLORS_MULTIPLY,
    COLORS_REPLACE,
    MF_BASE,
    MF_CUTOFF,
    MF_EMISSIVE,
    MF_METALLIC,
    MF_NORMAL_SCALE,
    MF_OCCLUSION,
    MF_ROUGHNESS,
    MI_ALPHA_MODE,
    MI_BASE,
    MI_COLORS,
    MI_EMISSIVE,
    MI_METALLIC_ROUGHNESS,
    MI_NORMAL,
    MI_OCCLUSION,
    MI_UNLIT,
    MI_UV,
)
from renderers.shading.memory import load_i64
from renderers.shading.resolve import A_BASE, A_COLOR, A_FACING, A_NORMAL, A_ROWS, A_TANGENT, A_UV0, resolve_run
from renderers.shading.sampling import AS_STORED, SRGB, sample
from renderers.shading.scene import II_COLORS, II_MATERIAL, II_TANGENTS
from renderers.shading.textures import TF_COLUMNS, TI_COLUMNS, TI_UV_SET
from renderers.shading.transfer import GAMMA, decode_gamma, gamma_byte, plain_byte

DIRECT: Final = 0
"""Write the picture."""
GATHER: Final = 1
"""Add a translucent layer behind those gathered so far."""
UNDER: Final = 2
"""Write the picture beneath the gathered layers."""

_ZERO: Final = np.float32(0.0)
_ONE: Final = np.float32(1.0)
_INVERSE_GAMMA: Final = 1.0 / GAMMA


@njit(nogil=True, error_model="numpy")
def _instance_of(first_record, record, hint):  # type: ignore[no-untyped-def]
    """Instance of a record; ``hint`` is tried first."""
    if first_record[hint] <= record < first_record[hint + 1]:
        return hint
    low, high = 0, first_record.shape[0] - 1
    while high - low > 1:
        middle = (low + high) >> 1
        if first_record[middle] <= record:
            low = middle
        else:
            high = middle
    return low


@njit(nogil=True, error_model="numpy")
def _mirrors(X):  # type: ignore[no-untyped-def]
    """Whether the linear part of a (4, 4) matrix has a negative determinant."""
    return (
        X[0, 0] * (X[1, 1] * X[2, 2] - X[1, 2] * X[2, 1])
        - X[0, 1] * (X[1, 0] * X[2, 2] - X[1, 2] * X[2, 0])
        + X[0, 2] * (X[1, 0] * X[2, 1] - X[1, 1] * X[2, 0])
    ) < 0.0


@njit(nogil=True, error_model="numpy")
def _texture(row, tables, space, x, a):  # type: ignore[no-untyped-def]
    """A texture at column ``x`` of the attribute rows ``a``."""
    textures, floats, values = tables
    textures += row * (8 * TI_COLUMNS)
    uv = A_UV0 + 2 * load_i64(textures, TI_UV_SET)
    return sample(
        textures, floats + row * (4 * TF_COLUMNS), values, space, np.float64(a[uv, x]), np.float64(a[uv + 1, x])
    )


@njit(nogil=True, error_model="numpy")
def _base_colors(pbr, colored, mi, mf, tables, decoded, begin, end, a):  # type: ignore[no-untyped-def]
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
def _unit_normals(mapped, mi, mf, tables, begin, end, a):  # type: ignore[no-untyped-def]
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
def _light_phong(begin, end, a):  # type: ignore[no-untyped-def]
    """The head light shines along the optical axis: base x max(0, n . (0, 0, -1)), into the rows A_BASE."""
    for x in range(begin, end):
        light = max(-a[A_NORMAL + 2, x], _ZERO)
        a[A_BASE, x] *= light
        a[A_BASE + 1, x] *= light
        a[A_BASE + 2, x] *= light


@njit(nogil=True, error_model="numpy")
def _light_pbr(mi, mf, tables, intrinsics, y, begin, end, a):  # type: ignore[no-untyped-def]
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


@njit(nogil=True, error_model="numpy")
def _write(pbr, y, begin, end, a, thresholds, guesses, color):  # type: ignore[no-untyped-def]
    """The rows A_BASE of a segment as bytes of the picture."""
    for x in range(begin, end):
        for k in range(3):
            c = a[A_BASE + k, x]
            color[y, x, k] = gamma_byte(c, thresholds, guesses) if pbr else plain_byte(c)


@njit(nogil=True, error_model="numpy")
def _shown(c, pbr):  # type: ignore[no-untyped-def]
    """What ``_write`` rounds to a byte, 0 .. 1."""
    if not (c > _ZERO):
        return _ZERO
    c = min(c, _ONE)
    return np.float32(np.float64(c) ** _INVERSE_GAMMA) if pbr else c


@njit(nogil=True, error_model="numpy")
def _gather(pbr, alpha_mode, cutoff, y, begin, end, a, gathered):  # type: ignore[no-untyped-def]
    """Adds a segment behind the layers gathered so far, in the space of the stored picture, as VTK does."""
    for x in range(begin, end):
        through = gathered[y, x, 3]
        alpha = a[A_BASE + 3, x]
        if alpha_mode == ALPHA_BLEND:
            alpha = min(max(alpha, _ZERO), _ONE) if alpha == alpha else _ONE
        elif alpha_mode == ALPHA_MASK:
            alpha = _ZERO if alpha < cutoff else _ONE
        else:
            alpha = _ONE
        if alpha > _ZERO and through > _ZERO:
            for k in range(3):
                gathered[y, x, k] += through * alpha * _shown(a[A_BASE + k, x], pbr)
            gathered[y, x, 3] = through * (_ONE - alpha)


@njit(nogil=True, error_model="numpy")
def _write_under(pbr, y, begin, end, a, gathered, color):  # type: ignore[no-untyped-def]
    for x in range(begin, end):
        through = gathered[y, x, 3]
        for k in range(3):
            color[y, x, k] = plain_byte(gathered[y, x, k] + through * _shown(a[A_BASE + k, x], pbr))


@njit(nogil=True, error_model="numpy")
def _write_background(mode, background, y, begin, end, gathered, color):  # type: ignore[no-untyped-def]
    if mode == DIRECT:
        for x in range(begin, end):
            for k in range(3):
                color[y, x, k] = background[k]
    elif mode == UNDER:
        for x in range(begin, end):
            for k in range(3):
                behind = np.float32(background[k]) / np.float32(255.0)
                color[y, x, k] = plain_byte(gathered[y, x, k] + gathered[y, x, 3] * behind)


_SIGNATURE: Final = (
    "void(boolean, int64, int32[:,::1], int64[::1], float64[:,:,::1], float64[:,:,::1], float64[::1], int64[:,::1], "
    "int64[:,::1], float32[:,::1], int64[:,::1], float32[:,::1], float32[:,::1], float32[::1], float32[::1], "
    "uint8[::1], uint8[::1], int64, int64, float32[:,:,::1], uint8[:,:,::1])"
)


@kernel(_SIGNATURE)
def shade_rows(  # type: ignore[no-untyped-def]
    pbr,
    mode,
    ids,
    first_record,
    X,
    N,
    intrinsics,
    instances,
    material_integers,
    material_floats,
    textures,
    texture_floats,
    values,
    decoded,
    thresholds,
    guesses,
    background,
    row_begin,
    row_end,
    gathered,
    color,
):
    """Shades the rows ``row_begin .. row_end - 1``; every row is independent of all others.

    Args:
        pbr: bool, the look.
        mode: ``DIRECT``, ``GATHER`` or ``UNDER``.
        ids: (H, W) int32 record per pixel, -1 for none.
        first_record: (I + 1,) int64.
        X: (I, 4, 4) float64, N: (I, 3, 3) float64: mesh to optical frame, of points and of normals.
        intrinsics: (4,) float64: fx, fy, cx, cy.
        instances ... texture_floats: the tables of ``ShadingScene``.
        values: ``BYTE_VALUES``; decoded: ``DECODED``; thresholds, guesses: see ``gamma_byte``.
        background: (3,) uint8.
        gathered: (H, W, 4) float32: colour of the layers in front, times alpha, as shown (0..1), and the share of
            light that still comes through from behind; not used by ``DIRECT``.
        color: (H, W, 3) uint8; not used by ``GATHER``.
    """
    # Below here tables are addresses: arrays given to functions that are not inlined cost reference counts.
    tables = (np.int64(textures.ctypes.data), np.int64(texture_floats.ctypes.data), np.int64(values.ctypes.data))
    decoded_at = np.int64(decoded.ctypes.data)
    thresholds_at, guesses_at = np.int64(thresholds.ctypes.data), np.int64(guesses.ctypes.data)
    width = ids.shape[1]
    a = np.zeros((A_ROWS, width), dtype=np.float32)
    weights = np.empty((3, width), dtype=np.float32)
    hint = 0
    for y in range(row_begin, row_end):
        x = 0
        while x < width:
            begin = x
            record = ids[y, x]
            if record < 0:
                while x < width and ids[y, x] < 0:
                    x += 1
                _write_background(mode, background, y, begin, x, gathered, color)
                continue
            instance = hint = _instance_of(first_record, record, hint)
            first, last = first_record[instance], first_record[instance + 1]
            columns, X_instance, N_instance = instances[instance], X[instance], N[instance]
            mi, mf = material_integers[columns[II_MATERIAL]], material_floats[columns[II_MATERIAL]]
            uv_used, mirrored = mi[MI_UV], _mirrors(X_instance)
            while x < width and first <= ids[y, x] < last:
                run = x
                record = ids[y, x]
                x += 1
                while x < width and ids[y, x] == record:
                    x += 1
                resolve_run(
                    columns,
                    record - first,
                    mirrored,
                    uv_used,
                    X_instance,
                    N_instance,
                    intrinsics,
                    y,
                    run,
                    x,
                    weights,
                    a,
                )
            colored = columns[II_COLORS] != 0
            _base_colors(pbr, colored, mi, mf, tables, decoded_at, begin, x, a)
            if mi[MI_UNLIT] == 0:
                mapped = mi[MI_NORMAL] >= 0 and columns[II_TANGENTS] != 0
                _unit_normals(mapped, mi, mf, tables, begin, x, a)
                if pbr:
                    _light_pbr(mi, mf, tables, intrinsics, y, begin, x, a)
                else:
                    _light_phong(begin, x, a)
            if mode == DIRECT:
                _write(pbr, y, begin, x, a, thresholds_at, guesses_at, color)
            elif mode == GATHER:
                _gather(pbr, mi[MI_ALPHA_MODE], mf[MF_CUTOFF], y, begin, x, a, gathered)
            else:
                _write_under(pbr, y, begin, x, a, gathered, color)
