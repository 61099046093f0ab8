"""Lighting of a part of a segment: the looks ``phong``, ``plain`` and ``pbr``, eight pixels at a time."""

from __future__ import annotations

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import f32_at, f64_at, i32_at, i64_at
from renderers.shading.brdf import headlight_cosines, schlick, vtk_colors, vtk_reflected, vtk_specular
from renderers.shading.headlight.layout import S_MODE, S_PBR
from renderers.shading.headlight.output_merge import DIRECT, packed, write
from renderers.shading.layout import (
    A_BASE,
    A_EMISSIVE,
    A_NORMAL,
    A_ROUGH,
    G_COLUMNS,
    G_LENS,
    G_MATERIAL_FLOATS,
    G_MATERIAL_INTEGERS,
    G_PIXELS,
    G_SPANS,
    G_STARTS,
    G_Y,
    SPAN_ROOM,
    STRIDE,
    T_NORMAL,
)
from renderers.shading.material import ambient_share, apply_normal_map, has_color_map, put_base_color, sample_maps
from renderers.shading.materials import (
    MF_BASE,
    MF_EMISSIVE,
    MF_METALLIC,
    MF_ROUGHNESS,
    MI_EMISSIVE,
    MI_METALLIC_ROUGHNESS,
    MI_UNLIT,
)
from renderers.shading.vec3 import load3, scale_to, store3, times


@inlined
def _base_color(varies, mf, pixels, x):
    """Base colour of eight pixels."""
    if varies:
        return load3(pixels, A_BASE * STRIDE + x, STRIDE)
    return vec.f32(mf[MF_BASE]), vec.f32(mf[MF_BASE + 1]), vec.f32(mf[MF_BASE + 2])


@inlined
def _write_pixels(job, pbr, direct, line, x, pixels, at, rgb):
    """Write eight finished pixels to the packed row, or for the layers to the rows A_BASE."""
    if direct:
        write(job, pbr, line, x, rgb[0], rgb[1], rgb[2])
    else:
        store3(pixels, A_BASE * STRIDE + at, STRIDE, rgb)


@device_function
def _shade_unlit(job, mf, varies, pixels, begin, count, line):
    """The colour of a surface is its base colour."""
    direct, pbr = job[S_MODE] == DIRECT, job[S_PBR] != 0
    for at in range(0, count, vec.LANES):
        _write_pixels(job, pbr, direct, line, begin + at, pixels, at, _base_color(varies, mf, pixels, at))


@inlined
def _headlight_cosine(pixels, at):
    """max(0, n . (0, 0, -1)): the headlight shines along the optical axis."""
    n = load3(pixels, A_NORMAL * STRIDE + at, STRIDE)
    return vec.maximum(-n[2] * scale_to(n, vec.f32(1.0)), vec.f32(0.0))


@device_function
def _shade_phong(job, mf, varies, pixels, begin, count, line):
    """Shade by base colour times ``_headlight_cosine`` (Lambert)."""
    direct = job[S_MODE] == DIRECT
    if varies:
        for at in range(0, count, vec.LANES):
            base = load3(pixels, A_BASE * STRIDE + at, STRIDE)
            _write_pixels(job, False, direct, line, begin + at, pixels, at, times(base, _headlight_cosine(pixels, at)))
        return
    base = _base_color(False, mf, pixels, np.int64(0))
    for at in range(0, count, vec.LANES):
        r, g, b = times(base, _headlight_cosine(pixels, at))
        write(job, False, line, begin + at, r, g, b)


@device_function
def _shade_pbr(job, segment, varies, begin, count, line):
    """Metallic-roughness as VTK evaluates it, occlusion and emission."""
    mi, mf = i64_at(segment[G_MATERIAL_INTEGERS]), f32_at(segment[G_MATERIAL_FLOATS])
    pixels, lens, columns = f32_at(segment[G_PIXELS]), f64_at(segment[G_LENS]), segment[G_COLUMNS]
    rough, emissive = mi[MI_METALLIC_ROUGHNESS] >= 0, mi[MI_EMISSIVE] >= 0
    direct = job[S_MODE] == DIRECT
    left, across = vec.f32(0.5 - lens[2]), vec.f32(1.0 / lens[0])
    dy = vec.f32((segment[G_Y] + 0.5 - lens[3]) / lens[1])
    roughness, metallic = vec.f32(mf[MF_ROUGHNESS]), vec.f32(mf[MF_METALLIC])
    # Two passes: each leaves a processor room to work on several pixels at a time.
    for at in range(0, count, vec.LANES):
        column = vec.i32(begin + at) + vec.iota()
        if columns != 0:
            column = vec.load(i32_at(columns), begin + at)
        n = load3(pixels, A_NORMAL * STRIDE + at, STRIDE)
        n_l, n_v, v_l = headlight_cosines(n, (vec.to_f32(column) + left) * across, dy)
        r = roughness
        if rough:
            r = r * vec.load(pixels, (A_ROUGH + 1) * STRIDE + at)
        n_l, specular = vtk_specular(n_l, n_v, v_l, r)
        store3(pixels, A_NORMAL * STRIDE + at, STRIDE, (n_l, specular, schlick(v_l)))
    emitted = vec.f32(mf[MF_EMISSIVE]), vec.f32(mf[MF_EMISSIVE + 1]), vec.f32(mf[MF_EMISSIVE + 2])
    for at in range(0, count, vec.LANES):
        n_l, specular, fresnel = load3(pixels, A_NORMAL * STRIDE + at, STRIDE)
        m = metallic
        if rough:
            m = m * vec.load(pixels, (A_ROUGH + 2) * STRIDE + at)
        diffuse, f0, grazing = vtk_colors(_base_color(varies, mf, pixels, at), m)
        ambient = ambient_share(mi, mf, pixels, at)
        e = emitted
        if emissive:
            texel = load3(pixels, A_EMISSIVE * STRIDE + at, STRIDE)
            e = emitted[0] * texel[0], emitted[1] * texel[1], emitted[2] * texel[2]
        rgb = (
            vtk_reflected(n_l, specular, fresnel, diffuse[0], f0[0], grazing[0]) * ambient + e[0],
            vtk_reflected(n_l, specular, fresnel, diffuse[1], f0[1], grazing[1]) * ambient + e[1],
            vtk_reflected(n_l, specular, fresnel, diffuse[2], f0[2], grazing[2]) * ambient + e[2],
        )
        _write_pixels(job, True, direct, line, begin + at, pixels, at, rgb)


@inlined
def is_uniform_phong(job, segment):
    """Return True if the colour of a segment depends on its normals only."""
    mi = i64_at(segment[G_MATERIAL_INTEGERS])
    return job[S_MODE] == DIRECT and job[S_PBR] == 0 and mi[MI_UNLIT] == 0 and not has_color_map(segment)


@device_function
def fill_spans(segment, span, last_span, line):
    """Write spans of ``is_uniform_phong`` whose normals are constant, after ``set_up_spans``.

    Walls, floors and meshes without normals.
    """
    mf, spans, starts = f32_at(segment[G_MATERIAL_FLOATS]), f32_at(segment[G_SPANS]), i32_at(segment[G_STARTS])
    own_pixels = np.empty(vec.LANES, np.int32)
    pixels = i32_at(np.int64(own_pixels.ctypes.data))
    for batch in range(span, last_span, vec.LANES):
        n = load3(spans, T_NORMAL * SPAN_ROOM + batch - span, SPAN_ROOM)
        light = vec.maximum(-n[2] * scale_to(n, vec.f32(1.0)), vec.f32(0.0))
        r, g, b = times(_base_color(False, mf, spans, np.int64(0)), light)
        vec.store(pixels, 0, packed(r, g, b))
        for k in range(min(last_span - batch, vec.LANES)):
            color = vec.i32(np.int64(pixels[k]))
            for x in range(starts[batch + k], starts[batch + k + 1], vec.LANES):
                vec.store(line, x, color)
    own_pixels[0] = 0  # the pointer above does not keep the array alive


@device_function
def shade(job, segment, begin, end, line):
    """Shade the pixels ``begin .. end``, at most PART, from the rows A_.

    In the mode ``DIRECT`` they are packed into the row that ``line`` points to, with up to seven further ones. In the
    other modes colour and alpha are put into the rows A_BASE.
    """
    mi, mf = i64_at(segment[G_MATERIAL_INTEGERS]), f32_at(segment[G_MATERIAL_FLOATS])
    pixels, count = f32_at(segment[G_PIXELS]), end - begin
    varies = has_color_map(segment) or job[S_MODE] != DIRECT
    if varies:
        put_base_color(job, segment, np.int64(0), count, job[S_MODE] != DIRECT)
    if mi[MI_UNLIT] != 0:
        _shade_unlit(job, mf, varies, pixels, begin, count, line)
    elif job[S_PBR] == 0:
        _shade_phong(job, mf, varies, pixels, begin, count, line)
    else:
        sample_maps(job, segment, np.int64(0), count)
        apply_normal_map(job, segment, np.int64(0), count)
        _shade_pbr(job, segment, varies, begin, count, line)
