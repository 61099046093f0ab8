"""A segment as bytes of the picture."""

from __future__ import annotations

from numba import njit

from tests.renderers.shading.scalar.resolve import A_BASE
from tests.renderers.shading.scalar.transfer import gamma_byte, plain_byte


@njit(nogil=True, error_model="numpy")
def write(pbr, y, begin, end, a, thresholds, guesses, color):
    """The rows A_BASE of a segment as bytes of the picture."""
    for x in range(begin, end):
        for k in range(3):
            c = a[A_BASE + k, x]
            color[y, x, k] = gamma_byte(c, thresholds, guesses) if pbr else plain_byte(c)
