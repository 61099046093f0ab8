"""Structs that the kernels of the look ``studio`` and their callers share."""

from typing import Final

from renderers.compiler.device_function import device_function
from renderers.compiler.kernel_types import F32, F64, I32, I64, U8, Address, Pointer
from renderers.compiler.simd import LANES
from renderers.compiler.structs import Struct, inline
from renderers.shading.layout import ShadingInputs, inline_rows


class StudioLight(Struct):
    kind: I64  # lights.DIRECTIONAL, POINT or SPOT
    position: Pointer[F64] = inline(3)  # optical frame, metres
    direction: Pointer[F64] = inline(3)  # unit vector in which it shines, optical frame
    color: Pointer[F64] = inline(3)  # linear RGB times intensity
    inv_range_squared: F64  # 1 / range^2, 1/m^2; 0: unlimited range
    spot_scale: F64  # falloff of a spot: clamp(scale * cos(angle from the axis) + offset)^2
    spot_offset: F64
    shadow_map: I64  # index of a StudioShadowMap, -1: no shadows


class StudioShadowMap(Struct):
    X_light_camera: Pointer[F64] = inline(12)  # (3, 4), from the optical frame of the camera to that of the light
    focal_length: F64  # texels
    center: F64  # principal point in both directions, texels
    normal_offset: F64  # offset of receivers along their normal, metres per metre of distance from the light
    inv_z: Pointer[F32]  # (side, side), as in ShadowMap
    side: I64  # texels


class StudioLighting(Struct):
    """Light of an image."""

    lights: StudioLight
    light_count: I64
    shadow_maps: StudioShadowMap
    shadow_radius: I64  # texels
    has_environment: I64  # 0: environment_ and split_sum fields are not read
    environment_texels: Pointer[F32]  # Environment.texels
    environment_tables: Pointer[I32]  # Environment.tables
    split_sum: Pointer[F32]  # environment_map.split_sum
    split_sum_side: I64
    R_world_camera: Pointer[F64] = inline(9)  # (3, 3) rotation from the optical frame to the world
    exposure: F64
    tone: I64  # index into tone_mapping.TONES
    stop: I64  # address of a stop flag, see stop.StopFlag


class StudioOutput(Struct):
    """Image to which finished rows are written."""

    background: Pointer[F32] = inline(3)  # linear RGB
    srgb_cells: Pointer[I32]  # tone_mapping.SRGB_CELLS
    color: Pointer[U8]  # (H, W, 3)


class StudioInputs(Struct):
    shading: ShadingInputs
    lighting: StudioLighting
    mode: I64  # ADD, BENEATH, EDGES or WRITE_ALPHA of ``shade_rows``
    width: I64  # pixels
    # Accumulated rows of the image, (H, 4, channel_values(width)) float32; for WRITE_ALPHA, rows of alpha, (H,
    # channel_values(width)). 0: rows are finished and written to the output.
    target: Address
    output: StudioOutput  # read only without ``target``


class StudioSurfaces(Struct):
    """Surfaces gathered for lighting: rows of ROW_STRIDE float32, one value per pixel. Vectors: optical frame."""

    normal: Pointer[F32] = inline_rows(3)  # unit, on the visible side
    to_camera: Pointer[F32] = inline_rows(3)  # unit
    position: Pointer[F32] = inline_rows(3)  # metres
    flat_normal: Pointer[F32] = inline_rows(3)  # unit normal of the triangle, towards the camera
    base_color: Pointer[F32] = inline_rows(3)  # linear
    metallic: Pointer[F32] = inline_rows(1)
    roughness: Pointer[F32] = inline_rows(1)
    f0: Pointer[F32] = inline_rows(3)  # reflectance of the dielectric at normal incidence
    f90: Pointer[F32] = inline_rows(1)  # reflectance of the dielectric at grazing angles
    unoccluded: Pointer[F32] = inline_rows(1)  # share of the environment's light that occlusion leaves
    emitted: Pointer[F32] = inline_rows(3)  # radiance; of unlit surfaces their colour
    alpha: Pointer[F32] = inline_rows(1)
    color: Pointer[F32] = inline_rows(3)  # linear RGB of the lit surface, tone-mapped


def channel_values(width: int) -> int:
    """Return the number of float32 in one channel of an image row, padded since loops overrun by up to a vector."""
    return (width + LANES - 1) // LANES * LANES + LANES


channel_values_in_kernel: Final = device_function(channel_values)
"""``channel_values`` for kernels."""
