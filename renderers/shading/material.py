"""Material maps at pixels: base colour, normal map, metallic-roughness, occlusion, emissive."""

from __future__ import annotations

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import f32_at, i64_at
from renderers.shading.gamma import decode_gamma
from renderers.shading.layout import (
    A_BASE,
    A_COLOR,
    A_EMISSIVE,
    A_FACING,
    A_NORMAL,
    A_OCCLUSION,
    A_ROUGH,
    A_TANGENT,
    A_TEXEL,
    G_HAS,
    G_MAPS,
    G_MATERIAL_FLOATS,
    G_MATERIAL_INTEGERS,
    G_PIXELS,
    HAS_COLORS,
    HAS_TANGENTS,
    P_MIRROR,
    S_DECODED,
    STRIDE,
)
from renderers.shading.materials import (
    COLORS_MULTIPLY,
    COLORS_REPLACE,
    MF_BASE,
    MF_NORMAL_SCALE,
    MF_OCCLUSION,
    MI_BASE,
    MI_COLORS,
    MI_EMISSIVE,
    MI_METALLIC_ROUGHNESS,
    MI_NORMAL,
    MI_OCCLUSION,
)
from renderers.shading.sampling import sample
from renderers.shading.vec3 import cross, dot, load3, scale_to, store3, times


@inlined
def has_color_map(segment):
    """Return True if the base colour differs between the pixels of a segment."""
    return i64_at(segment[G_MATERIAL_INTEGERS])[MI_BASE] >= 0 or segment[G_HAS] & HAS_COLORS != 0


@device_function
def put_base_color(job, segment, begin, end, alpha):
    """Fill the rows A_BASE: factor x vertex colour x texture. The fourth one only if ``alpha``."""
    mi, mf = i64_at(segment[G_MATERIAL_INTEGERS]), f32_at(segment[G_MATERIAL_FLOATS])
    pixels = f32_at(segment[G_PIXELS])
    textured, colored = mi[MI_BASE] >= 0, segment[G_HAS] & HAS_COLORS != 0
    if textured:
        sample(job, segment, mi[MI_BASE], begin, end, A_BASE, alpha)
    rule = mi[MI_COLORS]
    for k in range(4 if alpha else 3):
        factor = vec.f32(mf[MF_BASE + k])
        if k < 3 and colored and rule == COLORS_REPLACE:
            factor = vec.f32(1.0)
        if textured and not colored and mf[MF_BASE + k] == 1.0:
            continue
        decoded = k < 3 and rule != COLORS_MULTIPLY
        for x in range(begin, end, vec.LANES):
            value = factor
            if colored:
                color = vec.load(pixels, (A_COLOR + k) * STRIDE + x)
                if decoded:
                    color = decode_gamma(color, job[S_DECODED])
                value = value * color
            if textured:
                value = value * vec.load(pixels, (A_BASE + k) * STRIDE + x)
            vec.store(pixels, (A_BASE + k) * STRIDE + x, value)


@device_function
def sample_maps(job, segment, begin, end):
    """Fill the rows A_ROUGH, A_OCCLUSION and A_EMISSIVE, as far as the material has these textures."""
    mi = i64_at(segment[G_MATERIAL_INTEGERS])
    if mi[MI_METALLIC_ROUGHNESS] >= 0:
        sample(job, segment, mi[MI_METALLIC_ROUGHNESS], begin, end, A_ROUGH, False)
    if mi[MI_OCCLUSION] >= 0 and mi[MI_OCCLUSION] != mi[MI_METALLIC_ROUGHNESS]:
        sample(job, segment, mi[MI_OCCLUSION], begin, end, A_OCCLUSION, False)
    if mi[MI_EMISSIVE] >= 0:
        sample(job, segment, mi[MI_EMISSIVE], begin, end, A_EMISSIVE, False)


@inlined
def ambient_share(mi, mf, pixels, x):
    """Share of the light that occlusion leaves at eight pixels, after ``sample_maps``."""
    one = vec.f32(1.0)
    if mi[MI_OCCLUSION] < 0:
        return one
    row = np.int64(A_OCCLUSION)
    if mi[MI_OCCLUSION] == mi[MI_METALLIC_ROUGHNESS]:  # mostly one texture for both
        row = np.int64(A_ROUGH)
    return one + vec.f32(mf[MF_OCCLUSION]) * (vec.load(pixels, row * STRIDE + x) - one)


@device_function
def apply_normal_map(job, segment, begin, end):
    """Replace the rows A_NORMAL by the unit normals of the material's normal map, if it and the mesh have what it
    takes. Where a tangent has no direction, the normal stays."""
    mi, mf = i64_at(segment[G_MATERIAL_INTEGERS]), f32_at(segment[G_MATERIAL_FLOATS])
    if mi[MI_NORMAL] < 0 or segment[G_HAS] & HAS_TANGENTS == 0:
        return
    sample(job, segment, mi[MI_NORMAL], begin, end, A_TEXEL, False)
    pixels, mirror = f32_at(segment[G_PIXELS]), vec.f32(f32_at(segment[G_MAPS])[P_MIRROR])
    one, two, zero, strength = vec.f32(1.0), vec.f32(2.0), vec.f32(0.0), vec.f32(mf[MF_NORMAL_SCALE])
    for x in range(begin, end, vec.LANES):
        seen = load3(pixels, A_NORMAL * STRIDE + x, STRIDE)
        seen = times(seen, scale_to(seen, one))
        # The map is in the frame of the front; a back face shows the reversed normal (glTF 3.9.6).
        side = vec.load(pixels, A_FACING * STRIDE + x)
        n = times(seen, side)
        t = load3(pixels, A_TANGENT * STRIDE + x, STRIDE)
        along = dot(n, t)
        t = t[0] - along * n[0], t[1] - along * n[1], t[2] - along * n[2]
        scale = scale_to(t, one)
        usable = scale > zero
        t = times(t, scale)
        # The bitangent of a mirror image is the mirrored one.
        hand = vec.select(vec.load(pixels, (A_TANGENT + 3) * STRIDE + x) * mirror >= zero, one, -one)
        b = cross(n, t)
        texel = load3(pixels, A_TEXEL * STRIDE + x, STRIDE)
        mx, my, mz = (two * texel[0] - one) * strength, (two * texel[1] - one) * strength * hand, two * texel[2] - one
        mapped = (
            mx * t[0] + my * b[0] + mz * n[0],
            mx * t[1] + my * b[1] + mz * n[1],
            mx * t[2] + my * b[2] + mz * n[2],
        )
        scale = scale_to(mapped, side)
        usable = usable & (scale != zero)
        normal = (
            vec.select(usable, mapped[0] * scale, seen[0]),
            vec.select(usable, mapped[1] * scale, seen[1]),
            vec.select(usable, mapped[2] * scale, seen[2]),
        )
        store3(pixels, A_NORMAL * STRIDE + x, STRIDE, normal)
