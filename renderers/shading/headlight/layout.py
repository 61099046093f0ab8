"""Columns of the job of the headlight looks, after those of ``shading.layout``."""

from __future__ import annotations

from typing import Final

from renderers.shading.layout import S_COMMON

S_PBR: Final = S_COMMON  # 1: look ``pbr``; 0: ``phong`` or ``plain``
S_MODE: Final = S_COMMON + 1  # DIRECT, GATHER or UNDER
S_WIDTH: Final = S_COMMON + 2
S_HEIGHT: Final = S_COMMON + 3
S_STRIDE: Final = S_COMMON + 4  # values of a row of records
S_GAMMA: Final = S_COMMON + 5  # gamma.GAMMA_CELLS
S_ENCODED: Final = S_COMMON + 6  # gamma.ENCODED
S_BACKGROUND: Final = S_COMMON + 7  # red, green, blue, lowest byte first
S_GATHERED: Final = S_COMMON + 8  # (4, H, W + 8) float32, see output_merge
S_COLOR: Final = S_COMMON + 9  # (H, W, 3) uint8
S_PLACES: Final = S_COMMON + 10  # (H, S_STRIDE) int32: image columns of the records; 0: record k is in column k
S_COUNTS: Final = S_COMMON + 11  # (H,) int32, with S_PLACES: number of records of each row
S_COLUMNS: Final = S_COMMON + 12
