"""From shaded segments to the picture: bytes, translucent layers, background."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from renderers.shading.materials import ALPHA_BLEND, ALPHA_MASK
from renderers.shading.resolve import A_BASE
from renderers.shading.transfer import GAMMA, gamma_byte, plain_byte

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
def write(pbr, y, begin, end, a, thresholds, guesses, color):  # type: ignore[no-untyped-def]
    """The rows A_BASE of a segment as bytes of the picture."""
    for x in range(begin, end):
        for k in range(3):
            c = a[A_BASE + k, x]
            color[y, x, k] = gamma_byte(c, thresholds, guesses) if pbr else plain_byte(c)


@njit(nogil=True, error_model="numpy")
def _shown(c, pbr):  # type: ignore[no-untyped-def]
    """What ``write`` rounds to a byte, 0 .. 1."""
    if not (c > _ZERO):
        return _ZERO
    c = min(c, _ONE)
    return np.float32(np.float64(c) ** _INVERSE_GAMMA) if pbr else c


@njit(nogil=True, error_model="numpy")
def gather(pbr, alpha_mode, cutoff, y, begin, end, a, gathered):  # type: ignore[no-untyped-def]
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
def write_under(pbr, y, begin, end, a, gathered, color):  # type: ignore[no-untyped-def]
    for x in range(begin, end):
        through = gathered[y, x, 3]
        for k in range(3):
            color[y, x, k] = plain_byte(gathered[y, x, k] + through * _shown(a[A_BASE + k, x], pbr))


@njit(nogil=True, error_model="numpy")
def write_background(mode, background, y, begin, end, gathered, color):  # type: ignore[no-untyped-def]
    if mode == DIRECT:
        for x in range(begin, end):
            for k in range(3):
                color[y, x, k] = background[k]
    elif mode == UNDER:
        for x in range(begin, end):
            for k in range(3):
                behind = np.float32(background[k]) / np.float32(255.0)
                color[y, x, k] = plain_byte(gathered[y, x, k] + gathered[y, x, 3] * behind)
