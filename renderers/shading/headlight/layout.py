"""The job of the headlight looks' kernel."""

from typing import Final

from renderers.compiler.kernel_types import F32, I32, I64, U8, Pointer
from renderers.compiler.structs import Struct
from renderers.shading.camera_light import CameraLightInputs
from renderers.shading.layout import ShadingInputs

DIRECT: Final = 0
"""Write the image."""
GATHER: Final = 1
"""Blend a translucent layer under the layers gathered so far."""
UNDER: Final = 2
"""Write the image, blended under the gathered layers."""


class HeadlightInputs(Struct):
    shading: ShadingInputs
    mode: I64  # DIRECT, GATHER or UNDER
    width: I64  # pixels of the image
    height: I64
    stride: I64  # values from one row of primitive ids to the next
    background: I64  # RGB, red in the lowest byte
    first_row: I64  # row of the image that ``color``, ``columns`` and ``counts`` begin with
    color: Pointer[U8]  # (rows, width, 3)
    has_roots: I64  # 1: ``color`` is (rows, width + 8) uint32, see Frame.roots
    gathered: Pointer[F32]  # (4, height, width + 8), see output_merge
    gamma_cells: Pointer[I32]  # gamma.GAMMA_CELLS
    gamma_from_linear: Pointer[F32]  # gamma.GAMMA_FROM_LINEAR
    has_camera_light: I64  # 1: ``camera_light`` replaces the headlight on metallic-roughness materials
    camera_light: CameraLightInputs
    lamp_share: Pointer[F32]  # (height, width + 8), see Frame; 0: not wanted
    key_factor: Pointer[F32]  # likewise
    light: Pointer[F32]  # likewise
    columns: I64  # address of (rows, stride) int32: image columns of the ids; 0: id k is in column k
    counts: Pointer[I32]  # (rows,), with ``columns``: number of ids of each row
