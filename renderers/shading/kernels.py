"""Rows of a picture: runs of equal record are resolved, segments of equal instance are shaded."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from renderers.jit import kernel
from renderers.shading.compose import DIRECT, GATHER, gather, write, write_background, write_under
from renderers.shading.materials import MF_CUTOFF, MI_ALPHA_MODE, MI_NORMAL, MI_UNLIT, MI_UV
from renderers.shading.resolve import A_ROWS, resolve_run
from renderers.shading.scene import II_COLORS, II_MATERIAL, II_TANGENTS
from renderers.shading.surface import base_colors, light_pbr, light_phong, unit_normals


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
                write_background(mode, background, y, begin, x, gathered, color)
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
            base_colors(pbr, colored, mi, mf, tables, decoded_at, begin, x, a)
            if mi[MI_UNLIT] == 0:
                mapped = mi[MI_NORMAL] >= 0 and columns[II_TANGENTS] != 0
                unit_normals(mapped, mi, mf, tables, begin, x, a)
                if pbr:
                    light_pbr(mi, mf, tables, intrinsics, y, begin, x, a)
                else:
                    light_phong(begin, x, a)
            if mode == DIRECT:
                write(pbr, y, begin, x, a, thresholds_at, guesses_at, color)
            elif mode == GATHER:
                gather(pbr, mi[MI_ALPHA_MODE], mf[MF_CUTOFF], y, begin, x, a, gathered)
            else:
                write_under(pbr, y, begin, x, a, gathered, color)
