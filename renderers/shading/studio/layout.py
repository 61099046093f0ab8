"""Columns of the tables of the look ``studio``; the job's come after those of ``shading.layout``."""

from __future__ import annotations

from typing import Final

from renderers.compiler.device_function import device_function
from renderers.compiler.simd import LANES
from renderers.shading.layout import S_COMMON, STRIDE

# Job: addresses and sizes. S_LENS has further values: fx, fy, cx, cy, exposure, R_world_camera by rows.
J_LIGHTS: Final = S_COMMON
J_LIGHT_COUNT: Final = S_COMMON + 1
J_SHADOW_FLOATS: Final = S_COMMON + 2
J_SHADOW_INTEGERS: Final = S_COMMON + 3
J_SHADOW_RADIUS: Final = S_COMMON + 4
J_RADIANCE: Final = S_COMMON + 5  # Ambient.texels; 0: no environment
J_LEVELS: Final = S_COMMON + 6  # Ambient.places
J_SPLIT: Final = S_COMMON + 7  # environment_map.split_sum
J_SPLIT_SIDE: Final = S_COMMON + 8
J_TONE: Final = S_COMMON + 9  # index into tonemap.TONES
J_STOP: Final = S_COMMON + 10  # address of a stop flag, see stop.StopFlag
J_COLUMNS: Final = S_COMMON + 11

LENS_EXPOSURE: Final = 4
LENS_WORLD: Final = 5  # 9 values

# Finishing an image: addresses.
F_BEHIND: Final = 0  # (3,) float32, the linear background
F_CELLS: Final = 1  # tonemap.SRGB_CELLS
F_COLOR: Final = 2  # (H, W, 3) uint8
F_COLUMNS: Final = 3

# Surface at a pixel, ready to be lit: float32, one value per pixel; vectors in the optical frame.
R_NORMAL: Final = 0  # 3 rows: unit, on the side that is seen
R_VIEW: Final = 3  # 3 rows: unit, towards the camera
R_POINT: Final = 6  # 3 rows: metres
R_FLAT: Final = 9  # 3 rows: the triangle's own normal, towards the camera
R_BASE: Final = 12  # 3 rows: base colour, linear
R_METALLIC: Final = 15
R_ROUGHNESS: Final = 16
R_F0: Final = 17  # 3 rows: of the dielectric
R_F90: Final = 20
R_AMBIENT: Final = 21  # share of the environment's light that occlusion leaves
R_EMITTED: Final = 22  # 3 rows
R_ALPHA: Final = 25
R_LIGHT: Final = 26  # 3 rows: the result
R_ROWS: Final = 29
R_VALUES: Final = R_ROWS * STRIDE


def line_of(width: int) -> int:
    """Return the number of values of one channel of a row: whole vectors and one more, as loops may begin anywhere."""
    return (width + LANES - 1) // LANES * LANES + LANES


line_in_kernel: Final = device_function(line_of)
"""``line_of`` for kernels."""
