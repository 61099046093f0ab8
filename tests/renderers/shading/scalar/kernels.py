"""Rows of a picture: runs of equal record are resolved, segments of equal instance are shaded."""

from __future__ import annotations

import numpy as np
from numba import njit

from renderers.shading.materials import MI_NORMAL, MI_UNLIT, MI_UV
from tests.renderers.shading.scalar.compose import write
from tests.renderers.shading.scalar.resolve import A_ROWS, resolve_run
from tests.renderers.shading.scalar.surface import base_colors, light_pbr, light_phong, unit_normals
from tests.renderers.shading.scalar.tables import II_COLORS, II_MATERIAL, II_TANGENTS


@njit(nogil=True, error_model="numpy")
def _instance_of(first_record, record, hint):
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
def _mirrors(X):
    """Whether the linear part of a (4, 4) matrix has a negative determinant."""
    return (
        X[0, 0] * (X[1, 1] * X[2, 2] - X[1, 2] * X[2, 1])
        - X[0, 1] * (X[1, 0] * X[2, 2] - X[1, 2] * X[2, 0])
        + X[0, 2] * (X[1, 0] * X[2, 1] - X[1, 1] * X[2, 0])
    ) < 0.0


@njit(nogil=True, error_model="numpy")
def shade_rows(
    pbr,
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
    color,
):
    """Shades the rows ``row_begin .. row_end - 1``; every row is independent of all others.

    Args:
        pbr: bool, the look.
        ids: (H, W) int32 record per pixel, -1 for none.
        first_record: (I + 1,) int64.
        X: (I, 4, 4) float64, N: (I, 3, 3) float64: mesh to optical frame, of points and of normals.
        intrinsics: (4,) float64: fx, fy, cx, cy.
        instances ... texture_floats: the tables of ``ShadingScene``.
        values: ``LINEAR_FROM_BYTE``; decoded: ``DECODED``; thresholds, guesses: see ``gamma_byte``.
        background: (3,) uint8.
        color: (H, W, 3) uint8.
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
                for k in range(3):
                    color[y, begin:x, k] = background[k]
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
            write(pbr, y, begin, x, a, thresholds_at, guesses_at, color)
