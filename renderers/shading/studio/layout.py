"""Tables that the shading kernels of this look read: what is at which place."""

from __future__ import annotations

from typing import Final

from renderers.compiler.device_function import inner
from renderers.compiler.simd import LANES

# Columns of the job: addresses and sizes.
J_INSTANCES: Final = 0
J_MATERIAL_INTEGERS: Final = 1
J_MATERIAL_FLOATS: Final = 2
J_TEXTURE_INTEGERS: Final = 3
J_TEXTURE_FLOATS: Final = 4
J_VALUES: Final = 5  # ``BYTE_VALUES``
J_X: Final = 6
J_N: Final = 7
J_LIGHTS: Final = 8
J_LIGHT_COUNT: Final = 9
J_SHADOW_FLOATS: Final = 10
J_SHADOW_INTEGERS: Final = 11
J_SHADOW_RADIUS: Final = 12
J_RADIANCE: Final = 13  # ``Ambient.texels``; 0: no surroundings
J_LEVELS: Final = 14  # ``Ambient.places``
J_SPLIT: Final = 15
J_SPLIT_SIDE: Final = 16
J_LENS: Final = 17  # fx, fy, cx, cy, exposure, R_world_camera by rows, 1 / fx, 1 / fy
J_TONE: Final = 18  # number of the tone curve, of ``tonemap.TONES``
J_FIRST: Final = 19  # (J_COUNT + 1,) int64: the first record of every instance
J_COUNT: Final = 20
J_STOP: Final = 21  # address of an int64, not 0 when the picture is not wanted any more, see ``stop.StopFlag``
J_COLUMNS: Final = 22

# What finishes a picture: addresses.
F_BEHIND: Final = 0  # (3,) float32, the linear background
F_CELLS: Final = 1  # ``SRGB_CELLS``
F_COLOR: Final = 2  # (H, W, 3) uint8
F_COLUMNS: Final = 3

# Rows of what is to be lit, float32, one value per pixel; vectors in the optical frame.
G_NORMAL: Final = 0  # 3 rows: unit, on the side that is seen
G_VIEW: Final = 3  # 3 rows: unit, towards the camera
G_POINT: Final = 6  # 3 rows: metres
G_FLAT: Final = 9  # 3 rows: the triangle's own normal, towards the camera
G_BASE: Final = 12  # 3 rows: base colour, linear
G_METALLIC: Final = 15
G_ROUGHNESS: Final = 16
G_F0: Final = 17  # 3 rows: of the dielectric
G_F90: Final = 20
G_KEPT: Final = 21  # of the light of the surroundings, by occlusion
G_EMITTED: Final = 22  # 3 rows
G_ALPHA: Final = 25
G_LIGHT: Final = 26  # 3 rows: the result
G_ROWS: Final = 29

PART: Final = 256
"""Pixels lit at a time: their rows stay in the first-level cache."""
STRIDE: Final = PART + 8
"""Values of a row: loops run over the last pixel by up to seven."""


def line_of(width: int) -> int:
    """Values of one channel of a row: whole vectors, and one more, as loops may begin anywhere."""
    return (width + LANES - 1) // LANES * LANES + LANES


line_in_kernel: Final = inner(line_of)
"""The same for kernels: who calls it from Python compiles it."""
