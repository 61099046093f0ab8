"""From shaded pixels to the picture: bytes, translucent layers, background."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.pointers import f32_at, u8_at
from renderers.shading.gamma import encode_gamma, gamma_pixels, plain_byte
from renderers.shading.layout import (
    A_BASE,
    S_BACKGROUND,
    S_COLOR,
    S_ENCODED,
    S_GAMMA,
    S_GATHERED,
    S_HEIGHT,
    S_MODE,
    S_PBR,
    S_WIDTH,
)
from renderers.shading.materials import ALPHA_BLEND, ALPHA_MASK

DIRECT: Final = 0
"""Write the picture."""
GATHER: Final = 1
"""Add a translucent layer behind those gathered so far."""
UNDER: Final = 2
"""Write the picture beneath the gathered layers."""
_AHEAD: Final = 1024
"""Pixels of the picture that are on their way to the cache before they are written: it follows row upon row."""


@inlined
def packed(r, g, b):
    """Eight colours (f32x8 each) that are stored as they are, as i32x8: red in the lowest byte, then green, blue."""
    return plain_byte(r) | (plain_byte(g) << vec.i32(8)) | (plain_byte(b) << vec.i32(16))


@inlined
def write(job, pbr, line, x, r, g, b):
    """Eight shaded pixels (f32x8 each), packed, to the row that ``line`` points to."""
    if pbr:
        vec.store(line, x, gamma_pixels(r, g, b, job[S_GAMMA]))
    else:
        vec.store(line, x, packed(r, g, b))


@inlined
def _shown(job, c):
    """What ``write`` rounds to a byte, 0 .. 1, f32x8."""
    if job[S_PBR] != 0:
        return encode_gamma(c, job[S_ENCODED])
    return vec.least(vec.most(c, vec.f32(0.0)), vec.f32(1.0))


@inlined
def _layers(job, y):
    """Pointer to the layers gathered in a row: red, green, blue and how much of what is behind is seen, each
    ``_plane`` values behind the one before."""
    return f32_at(job[S_GATHERED] + 4 * (job[S_WIDTH] + vec.LANES) * y)


@inlined
def _plane(job):
    return (job[S_WIDTH] + vec.LANES) * job[S_HEIGHT]


@inner
def gather(job, alpha_mode, cutoff, y, begin, end, rows, stride):
    """Adds a segment behind the layers gathered so far, in the space of the stored picture, as VTK does."""
    layers, plane = _layers(job, y), _plane(job)
    zero, one, lane = vec.f32(0.0), vec.f32(1.0), vec.iota()
    for x in range(begin, end, vec.LANES):
        through = vec.load_again(layers, 3 * plane + x)
        alpha = vec.load(rows, (A_BASE + 3) * stride + x)
        if alpha_mode == ALPHA_BLEND:
            alpha = vec.select(alpha == alpha, vec.least(vec.most(alpha, zero), one), one)
        elif alpha_mode == ALPHA_MASK:
            alpha = vec.select(alpha < vec.f32(cutoff), zero, one)
        else:
            alpha = one
        share = through * alpha
        adding = (lane < vec.i32(end - x)) & (share > zero)
        for k in range(3):
            before = vec.load_again(layers, k * plane + x)
            shown = _shown(job, vec.load(rows, (A_BASE + k) * stride + x))
            vec.store(layers, k * plane + x, vec.select(adding, before + share * shown, before))
        vec.store(layers, 3 * plane + x, vec.select(adding, through * (one - alpha), through))


@inlined
def _beneath(layers, plane, x, r, g, b):
    """Packed pixels: what is shown (f32x8 each) beneath the layers."""
    through = vec.load(layers, 3 * plane + x)
    return packed(
        vec.load(layers, x) + through * r,
        vec.load(layers, plane + x) + through * g,
        vec.load(layers, 2 * plane + x) + through * b,
    )


@inner
def write_under(job, y, begin, end, rows, stride, line):
    """A segment beneath the gathered layers."""
    layers, plane = _layers(job, y), _plane(job)
    for x in range(begin, end, vec.LANES):
        at = A_BASE * stride + x
        r, g, b = (
            _shown(job, vec.load(rows, at)),
            _shown(job, vec.load(rows, at + stride)),
            vec.load(rows, at + 2 * stride),
        )
        vec.store(line, x, _beneath(layers, plane, x, r, g, _shown(job, b)))


@inlined
def _channel(background, k):
    return vec.f32(np.float32((background >> (8 * k)) & 255) / np.float32(255.0))


@inner
def write_background(job, y, begin, end, line):
    """Pixels that see nothing."""
    background = job[S_BACKGROUND]
    if job[S_MODE] == DIRECT:
        pixels = vec.i32(background)
        for x in range(begin, end, vec.LANES):
            vec.store(line, x, pixels)
    elif job[S_MODE] == UNDER:
        layers, plane = _layers(job, y), _plane(job)
        r, g, b = _channel(background, 0), _channel(background, 1), _channel(background, 2)
        for x in range(begin, end, vec.LANES):
            vec.store(line, x, _beneath(layers, plane, x, r, g, b))


@inner
def put_line(job, y, width, line):
    """The first ``width`` packed pixels of a finished row to the bytes of the picture."""
    color = u8_at(job[S_COLOR] + 3 * y * job[S_WIDTH])
    # What is written behind eight pixels, up to four bytes, must be overwritten by the next ones of the same row.
    whole = max(width - 2, 0) // vec.LANES * vec.LANES
    for x in range(0, whole, vec.LANES):
        vec.prefetch(color, 3 * (x + _AHEAD))
        vec.store_rgb(color, 3 * x, vec.load(line, x))
    for x in range(whole, width):
        for k in range(3):
            color[3 * x + k] = line[x] >> (8 * k)
