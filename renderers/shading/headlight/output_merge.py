"""From shaded pixels to the image: bytes, translucent layers, background."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import f32_at, u8_at
from renderers.shading.gamma import encode_gamma, gamma_pixels, plain_byte
from renderers.shading.headlight.layout import (
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
from renderers.shading.layout import A_BASE, STRIDE
from renderers.shading.materials import ALPHA_BLEND, ALPHA_MASK
from renderers.shading.vec3 import load3

DIRECT: Final = 0
"""Write the image."""
GATHER: Final = 1
"""Add a translucent layer behind those gathered so far."""
UNDER: Final = 2
"""Write the image beneath the gathered layers."""
_PREFETCH: Final = 1024
"""Pixels by which the image is prefetched ahead of writing."""


@inlined
def packed(r, g, b):
    """Return eight colours in 0 .. 1 (f32x8 each) as packed pixels (i32x8), red in the lowest byte."""
    return plain_byte(r) | (plain_byte(g) << vec.i32(8)) | (plain_byte(b) << vec.i32(16))


@inlined
def write(job, pbr, line, x, r, g, b):
    """Pack eight shaded pixels (f32x8 each) into the row that ``line`` points to."""
    if pbr:
        vec.store(line, x, gamma_pixels(r, g, b, job[S_GAMMA]))
    else:
        vec.store(line, x, packed(r, g, b))


@inlined
def _shown(job, c):
    """Return the value that ``write`` would round to a byte, 0 .. 1, f32x8."""
    if job[S_PBR] != 0:
        return encode_gamma(c, job[S_ENCODED])
    return vec.minimum(vec.maximum(c, vec.f32(0.0)), vec.f32(1.0))


@inlined
def _layers(job, y):
    """Return a pointer to the layers gathered in a row: red, green, blue and transmittance, ``_plane`` values apart."""
    return f32_at(job[S_GATHERED] + 4 * (job[S_WIDTH] + vec.LANES) * y)


@inlined
def _plane(job):
    return (job[S_WIDTH] + vec.LANES) * job[S_HEIGHT]


@device_function
def gather(job, alpha_mode, cutoff, y, begin, end, pixels):
    """Add pixels behind the layers gathered so far, in the colour space of the stored image, as VTK does."""
    layers, plane = _layers(job, y), _plane(job)
    zero, one, lane = vec.f32(0.0), vec.f32(1.0), vec.iota()
    for x in range(begin, end, vec.LANES):
        through = vec.load_volatile(layers, 3 * plane + x)
        alpha = vec.load(pixels, (A_BASE + 3) * STRIDE + x - begin)
        if alpha_mode == ALPHA_BLEND:
            alpha = vec.select(alpha == alpha, vec.minimum(vec.maximum(alpha, zero), one), one)
        elif alpha_mode == ALPHA_MASK:
            alpha = vec.select(alpha < vec.f32(cutoff), zero, one)
        else:
            alpha = one
        share = through * alpha
        adding = (lane < vec.i32(end - x)) & (share > zero)
        for k in range(3):
            before = vec.load_volatile(layers, k * plane + x)
            shown = _shown(job, vec.load(pixels, (A_BASE + k) * STRIDE + x - begin))
            vec.store(layers, k * plane + x, vec.select(adding, before + share * shown, before))
        vec.store(layers, 3 * plane + x, vec.select(adding, through * (one - alpha), through))


@inlined
def _beneath(layers, plane, x, r, g, b):
    """Return packed pixels of colours (f32x8 each) beneath the layers."""
    through = vec.load(layers, 3 * plane + x)
    return packed(
        vec.load(layers, x) + through * r,
        vec.load(layers, plane + x) + through * g,
        vec.load(layers, 2 * plane + x) + through * b,
    )


@device_function
def write_under(job, y, begin, end, pixels, line):
    """Write pixels beneath the gathered layers."""
    layers, plane = _layers(job, y), _plane(job)
    for x in range(begin, end, vec.LANES):
        r, g, b = load3(pixels, A_BASE * STRIDE + x - begin, STRIDE)
        vec.store(line, x, _beneath(layers, plane, x, _shown(job, r), _shown(job, g), _shown(job, b)))


@inlined
def _channel(background, k):
    return vec.f32(np.float32((background >> (8 * k)) & 255) / np.float32(255.0))


@device_function
def write_background(job, y, begin, end, line):
    """Write pixels without a surface."""
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


@device_function
def put_line(job, y, width, line):
    """Write the first ``width`` packed pixels of a finished row to the image."""
    color = u8_at(job[S_COLOR] + 3 * y * job[S_WIDTH])
    # A vector store overruns by up to four bytes, which the next one of the same row must overwrite.
    whole = max(width - 2, 0) // vec.LANES * vec.LANES
    for x in range(0, whole, vec.LANES):
        vec.prefetch(color, 3 * (x + _PREFETCH))
        vec.store_rgb(color, 3 * x, vec.load(line, x))
    for x in range(whole, width):
        for k in range(3):
            color[3 * x + k] = line[x] >> (8 * k)
