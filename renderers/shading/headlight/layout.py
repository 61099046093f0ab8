"""The job of the headlight looks' kernel."""

from __future__ import annotations

from typing import Final

from renderers.compiler.structs import F32, I32, I64, U8, Struct, pointer_to
from renderers.shading.layout import SHADING_JOB

DIRECT: Final = 0
"""Write the image."""
GATHER: Final = 1
"""Blend a translucent layer behind the layers gathered so far."""
UNDER: Final = 2
"""Write the image, blended behind the gathered layers."""

HEADLIGHT_JOB: Final = Struct(
    "HeadlightJob",
    {
        "shading": SHADING_JOB,
        "mode": I64,  # DIRECT, GATHER or UNDER
        "width": I64,  # pixels of the image
        "height": I64,
        "stride": I64,  # values from one row of primitive ids to the next
        "background": I64,  # RGB, red in the lowest byte
        "first_row": I64,  # row of the image that ``color``, ``columns`` and ``counts`` begin with
        "color": pointer_to(U8),  # (rows, width, 3)
        "gathered": pointer_to(F32),  # (4, height, width + 8), see output_merge
        "gamma_cells": pointer_to(I32),  # gamma.GAMMA_CELLS
        "gamma_from_linear": pointer_to(F32),  # gamma.GAMMA_FROM_LINEAR
        "columns": I64,  # address of (rows, stride) int32: image columns of the ids; 0: id k is in column k
        "counts": pointer_to(I32),  # (rows,), with ``columns``: number of ids of each row
    },
)
headlight_job_at: Final = HEADLIGHT_JOB.at
