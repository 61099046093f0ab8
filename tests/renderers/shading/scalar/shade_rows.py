"""Rows of an image: spans of one primitive are interpolated, segments of one instance are shaded."""

from __future__ import annotations

import numpy as np
from numba import njit

from renderers.compiler.structs import F32, U8, Struct, pointer_to
from renderers.shading.layout import MATERIAL, TEXTURE
from tests.renderers.shading.scalar.gamma import gamma_byte, plain_byte
from tests.renderers.shading.scalar.interpolation import A_BASE, A_ROWS, interpolate_span
from tests.renderers.shading.scalar.material import base_colors, light_pbr, light_phong, unit_normals
from tests.renderers.shading.scalar.tables import INSTANCE

TABLES = Struct(
    "ScalarTables",
    {
        "instances": INSTANCE,
        "materials": MATERIAL,
        "textures": TEXTURE,
        "value_from_byte": pointer_to(F32),  # sampling.VALUE_FROM_BYTE
        "linear_from_gamma": pointer_to(F32),
        "thresholds": pointer_to(F32),  # see gamma.gamma_byte
        "guesses": pointer_to(U8),
    },
)
_tables_at = TABLES.at


@njit(nogil=True, error_model="numpy")
def _instance_of(first_ids, primitive_id, hint):
    """Return the instance of a primitive id; ``hint`` is tried first."""
    if first_ids[hint] <= primitive_id < first_ids[hint + 1]:
        return hint
    low, high = 0, first_ids.shape[0] - 1
    while high - low > 1:
        middle = (low + high) >> 1
        if first_ids[middle] <= primitive_id:
            low = middle
        else:
            high = middle
    return low


@njit(nogil=True, error_model="numpy")
def _mirrors(X):
    """Return True if the linear part of a (4, 4) matrix has a negative determinant."""
    return (
        X[0, 0] * (X[1, 1] * X[2, 2] - X[1, 2] * X[2, 1])
        - X[0, 1] * (X[1, 0] * X[2, 2] - X[1, 2] * X[2, 0])
        + X[0, 2] * (X[1, 0] * X[2, 1] - X[1, 1] * X[2, 0])
    ) < 0.0


@njit(nogil=True, error_model="numpy")
def shade_rows(pbr, ids, first_ids, X_camera_mesh, normal_matrices, lens, tables_address, background, color):
    """Shade all rows.

    Args:
        pbr: bool, the look.
        ids, first_ids, X_camera_mesh: as in ``Visibility``.
        normal_matrices: (I, 3, 3) float64.
        lens: (4,) float64: fx, fy, cx, cy.
        tables_address: address of a TABLES.
        background: (3,) uint8.
        color: (H, W, 3) uint8.
    """
    tables = _tables_at(tables_address)
    height, width = ids.shape
    rows = np.zeros((A_ROWS, width), dtype=np.float32)
    weights = np.empty((3, width), dtype=np.float32)
    i = 0
    for y in range(height):
        x = 0
        while x < width:
            begin = x
            if ids[y, x] < 0:
                while x < width and ids[y, x] < 0:
                    x += 1
                color[y, begin:x] = background
                continue
            i = _instance_of(first_ids, ids[y, x], i)
            instance, mirrored = tables.instances[i], _mirrors(X_camera_mesh[i])
            material = tables.materials[instance.material]
            while x < width and first_ids[i] <= ids[y, x] < first_ids[i + 1]:
                span_begin, primitive_id = x, ids[y, x]
                x += 1
                while x < width and ids[y, x] == primitive_id:
                    x += 1
                interpolate_span(
                    instance,
                    primitive_id - first_ids[i],
                    mirrored,
                    material.uv_sets,
                    X_camera_mesh[i],
                    normal_matrices[i],
                    lens,
                    y,
                    span_begin,
                    x,
                    weights,
                    rows,
                )
            base_colors(pbr, instance.colors != 0, material, tables, begin, x, rows)
            if material.unlit == 0:
                mapped = material.normal_texture >= 0 and instance.tangents != 0
                unit_normals(mapped, material, tables, begin, x, rows)
                if pbr:
                    light_pbr(material, tables, lens, y, begin, x, rows)
                else:
                    light_phong(begin, x, rows)
            for column in range(begin, x):
                for k in range(3):
                    c = rows[A_BASE + k, column]
                    byte = gamma_byte(c, tables.thresholds, tables.guesses) if pbr else plain_byte(c)
                    color[y, column, k] = byte
