"""Surfaces at pixels: from interpolated attributes and a glTF material to the rows R_ that are lit."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import f32_at, i64_at
from renderers.shading.layout import (
    A_BASE,
    A_EMISSIVE,
    A_FLAT,
    A_NORMAL,
    A_POINT,
    A_ROUGH,
    A_TEXEL,
    G_MATERIAL_FLOATS,
    G_MATERIAL_INTEGERS,
    G_PIXELS,
    STRIDE,
)
from renderers.shading.material import ambient_share, apply_normal_map, put_base_color, sample_maps
from renderers.shading.materials import (
    ALPHA_MASK,
    ALPHA_OPAQUE,
    MF_CUTOFF,
    MF_EMISSIVE,
    MF_METALLIC,
    MF_REFLECTANCE,
    MF_ROUGHNESS,
    MF_SPECULAR,
    MF_SPECULAR_COLOR,
    MI_ALPHA_MODE,
    MI_EMISSIVE,
    MI_METALLIC_ROUGHNESS,
    MI_SPECULAR,
    MI_SPECULAR_COLOR,
    MI_UNLIT,
)
from renderers.shading.sampling import sample
from renderers.shading.studio.layout import (
    R_ALPHA,
    R_AMBIENT,
    R_BASE,
    R_EMITTED,
    R_F0,
    R_F90,
    R_FLAT,
    R_METALLIC,
    R_NORMAL,
    R_POINT,
    R_ROUGHNESS,
)
from renderers.shading.vec3 import load3, scale_to, store3, times

COLOR: Final = 0
"""Fill the surface of opaque pixels."""
COLOR_AND_ALPHA: Final = 1
"""Fill the surface and R_ALPHA."""
ALPHA: Final = 2
"""Fill R_ALPHA only."""


@inlined
def _broadcast3(values, k):
    return vec.f32(values[k]), vec.f32(values[k + 1]), vec.f32(values[k + 2])


@inlined
def _multiply3(a, b):
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


@inlined
def _clamped(value):
    """Clamp to 0 .. 1. NaN becomes 0."""
    return vec.minimum(vec.maximum(value, vec.f32(0.0)), vec.f32(1.0))


@device_function
def fill_surfaces(job, segment, fill, count, surfaces, first):
    """Fill the rows R_, except R_VIEW and R_LIGHT, from the first ``count`` pixels of the segment's rows A_.

    Args:
        fill: ``COLOR``, ``COLOR_AND_ALPHA`` or ``ALPHA``.
        surfaces: pointer to the R_VALUES float32.
        first: index in each row R_ of the first pixel's value.

    Returns:
        True if the surfaces are to be lit. If not, R_EMITTED is the colour of unlit ones.
    """
    mi, mf = i64_at(segment[G_MATERIAL_INTEGERS]), f32_at(segment[G_MATERIAL_FLOATS])
    pixels = f32_at(segment[G_PIXELS])
    put_base_color(job, segment, np.int64(0), count, fill != COLOR)
    if fill != COLOR:
        _fill_alpha(mi, mf, pixels, count, surfaces, first)
        if fill == ALPHA:
            return False
    if mi[MI_UNLIT] != 0:
        for x in range(0, count, vec.LANES):
            r, g, b = load3(pixels, A_BASE * STRIDE + x, STRIDE)
            store3(surfaces, R_EMITTED * STRIDE + first + x, STRIDE, (_clamped(r), _clamped(g), _clamped(b)))
        return False
    sample_maps(job, segment, np.int64(0), count)
    apply_normal_map(job, segment, np.int64(0), count)
    _fill_geometry(pixels, count, surfaces, first)
    _fill_metallic_roughness(mi, mf, pixels, count, surfaces, first)
    _fill_dielectric(job, segment, mi, mf, pixels, count, surfaces, first)
    return True


@device_function
def _fill_alpha(mi, mf, pixels, count, surfaces, first):
    """Fill the row R_ALPHA by the material's alpha mode."""
    zero, one = vec.f32(0.0), vec.f32(1.0)
    for x in range(0, count, vec.LANES):
        alpha = vec.load(pixels, (A_BASE + 3) * STRIDE + x)
        if mi[MI_ALPHA_MODE] == ALPHA_OPAQUE:
            alpha = one
        elif mi[MI_ALPHA_MODE] == ALPHA_MASK:
            alpha = vec.select(alpha < vec.f32(mf[MF_CUTOFF]), zero, one)
        else:
            alpha = vec.select(alpha == alpha, _clamped(alpha), one)  # NaN is opaque
        vec.store(surfaces, R_ALPHA * STRIDE + first + x, alpha)


@device_function
def _fill_geometry(pixels, count, surfaces, first):
    """Fill the rows R_NORMAL, R_POINT and R_FLAT."""
    one = vec.f32(1.0)
    for x in range(0, count, vec.LANES):
        normal = load3(pixels, A_NORMAL * STRIDE + x, STRIDE)
        store3(surfaces, R_NORMAL * STRIDE + first + x, STRIDE, times(normal, scale_to(normal, one)))
        store3(surfaces, R_POINT * STRIDE + first + x, STRIDE, load3(pixels, A_POINT * STRIDE + x, STRIDE))
        store3(surfaces, R_FLAT * STRIDE + first + x, STRIDE, load3(pixels, A_FLAT * STRIDE + x, STRIDE))


@device_function
def _fill_metallic_roughness(mi, mf, pixels, count, surfaces, first):
    """Fill the rows R_BASE, R_METALLIC, R_ROUGHNESS, R_AMBIENT and R_EMITTED."""
    zero = vec.f32(0.0)
    for x in range(0, count, vec.LANES):
        r, g, b = load3(pixels, A_BASE * STRIDE + x, STRIDE)
        base = vec.maximum(r, zero), vec.maximum(g, zero), vec.maximum(b, zero)
        store3(surfaces, R_BASE * STRIDE + first + x, STRIDE, base)
        metallic, roughness = vec.f32(mf[MF_METALLIC]), vec.f32(mf[MF_ROUGHNESS])
        if mi[MI_METALLIC_ROUGHNESS] >= 0:
            roughness = roughness * vec.load(pixels, (A_ROUGH + 1) * STRIDE + x)
            metallic = metallic * vec.load(pixels, (A_ROUGH + 2) * STRIDE + x)
        vec.store(surfaces, R_METALLIC * STRIDE + first + x, _clamped(metallic))
        vec.store(surfaces, R_ROUGHNESS * STRIDE + first + x, _clamped(roughness))
        vec.store(surfaces, R_AMBIENT * STRIDE + first + x, ambient_share(mi, mf, pixels, x))
        emitted = _broadcast3(mf, MF_EMISSIVE)
        if mi[MI_EMISSIVE] >= 0:
            emitted = _multiply3(emitted, load3(pixels, A_EMISSIVE * STRIDE + x, STRIDE))
        store3(surfaces, R_EMITTED * STRIDE + first + x, STRIDE, emitted)


@device_function
def _fill_dielectric(job, segment, mi, mf, pixels, count, surfaces, first):
    """Fill the rows R_F0 and R_F90 (KHR_materials_ior, KHR_materials_specular)."""
    one, reflectance = vec.f32(1.0), vec.f32(mf[MF_REFLECTANCE])
    if mi[MI_SPECULAR] >= 0:
        sample(job, segment, mi[MI_SPECULAR], np.int64(0), count, A_TEXEL, True)
    for x in range(0, count, vec.LANES):
        f90 = vec.f32(mf[MF_SPECULAR])
        if mi[MI_SPECULAR] >= 0:
            f90 = f90 * vec.load(pixels, (A_TEXEL + 3) * STRIDE + x)
        vec.store(surfaces, R_F90 * STRIDE + first + x, f90)
    if mi[MI_SPECULAR_COLOR] >= 0:
        sample(job, segment, mi[MI_SPECULAR_COLOR], np.int64(0), count, A_TEXEL, False)
    for x in range(0, count, vec.LANES):
        tint, f90 = _broadcast3(mf, MF_SPECULAR_COLOR), vec.load(surfaces, R_F90 * STRIDE + first + x)
        if mi[MI_SPECULAR_COLOR] >= 0:
            tint = _multiply3(tint, load3(pixels, A_TEXEL * STRIDE + x, STRIDE))
        f0 = (
            vec.minimum(reflectance * tint[0], one) * f90,
            vec.minimum(reflectance * tint[1], one) * f90,
            vec.minimum(reflectance * tint[2], one) * f90,
        )
        store3(surfaces, R_F0 * STRIDE + first + x, STRIDE, f0)
