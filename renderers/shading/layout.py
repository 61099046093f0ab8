"""Structs that the shading kernels of both looks and their callers share."""

from __future__ import annotations

from typing import Any, Final

from renderers.compiler.simd import LANES
from renderers.compiler.structs import F32, F64, I32, I64, U32, Struct, array_of, pointer_to

PART: Final = 256
"""Maximum number of pixels shaded at a time: their attributes stay in the first-level cache. A multiple of 64."""
STRIDE: Final = PART + LANES
"""Number of values in a row of PIXELS. Loops over pixels overrun by up to seven."""
SPAN_STRIDE: Final = PART + 2 * LANES
"""Number of values in a row of SPANS. A part has at most PART spans, and loops read beyond them."""

# Bits for the attributes that a mesh has.
HAS_NORMALS: Final = 1
HAS_UV0: Final = 2
HAS_UV1: Final = 4  # must be the bit after HAS_UV0
HAS_COLORS: Final = 8
HAS_TANGENTS: Final = 16

# Values of ``lighting`` in MATERIAL.
UNLIT: Final = 0
LAMBERT: Final = 1
METALLIC_ROUGHNESS: Final = 2

# Columns of ``vertices`` in INSTANCE: one vector of float32 per vertex.
V_POSITION: Final = 0  # 3 values
V_NORMAL: Final = 3  # 3 values
V_UV0: Final = 6  # 2 values
V_COLUMNS: Final = 8
# Columns of ``extras`` in INSTANCE, the attributes that few meshes have: one vector of float32 per vertex.
E_TANGENT: Final = 0  # 4 values
E_UV1: Final = 4  # 2 values
E_COLUMNS: Final = 8

INSTANCE: Final = Struct(
    "ShadingInstance",
    {
        "topology": I64,  # number of vertices of a primitive, see drawlist.Topology
        "material": I64,  # index of its MATERIAL
        "indices": pointer_to(U32),  # (M, topology)
        "vertices": pointer_to(F32),  # (N, V_COLUMNS)
        "colors": pointer_to(F32),  # (N, 4); null if the mesh has none
        "extras": pointer_to(F32),  # (N, E_COLUMNS); null if the mesh has none of them
        "attributes": I64,  # HAS_ bits of the mesh
    },
)
INSTANCE_MATRICES: Final = Struct(
    "InstanceMatrices",
    {
        "normal": array_of(F32, 9),  # transforms normals to the optical frame, up to a positive factor
        "tangent": array_of(F32, 9),  # transforms tangents to the optical frame, up to a positive factor
        "mirror": F32,  # -1 if the instance's transform mirrors, else 1
    },
)
"""An instance's transforms of directions in the view of one camera."""
MATERIAL: Final = Struct(
    "ShadingMaterial",
    {
        "alpha_mode": I64,  # ALPHA_ constant of materials
        "lighting": I64,  # UNLIT, LAMBERT or METALLIC_ROUGHNESS
        "gamma": I64,  # headlight looks: 1 if the colour is linear and stored by gamma; 0 if it is stored as it is
        "vertex_colors": I64,  # COLORS_ constant of materials
        "uv_sets": I64,  # bit 0: a texture reads uv0; bit 1: a texture reads uv1
        "has_gradients": I64,  # 1: shading reads uv_gradient
        "has_surface": I64,  # 1: shading reads positions and flat normals
        # Indices of TEXTUREs; -1: none.
        "base_color_texture": I64,
        "metallic_roughness_texture": I64,
        "normal_texture": I64,
        "occlusion_texture": I64,
        "emissive_texture": I64,
        "specular_texture": I64,  # look studio only, as specular_color_texture
        "specular_color_texture": I64,
        "base_color": array_of(F32, 4),
        "metallic": F32,
        "roughness": F32,
        "normal_scale": F32,
        "occlusion_strength": F32,
        "emissive": array_of(F32, 3),  # look studio: times the strength
        "alpha_cutoff": F32,
        "reflectance": F32,  # of the dielectric at normal incidence; this and the next two: look studio only
        "specular": F32,
        "specular_color": array_of(F32, 3),
    },
)
TEXTURE: Final = Struct(
    "ShadingTexture",
    {
        "wrap_s": I64,  # WRAP_ constant of texture_table
        "wrap_t": I64,
        "mag_linear": I64,
        "min_linear": I64,
        "mips": I64,  # MIPS_ constant of texture_table
        "uv_set": I64,
        "srgb": I64,  # 1: the colour channels are decoded to linear light
        "texels": pointer_to(I32),  # textures.texel_rows: RGBA, red in the lowest byte
        "stride": I64,  # texels from one row to the next
        "last_level": I64,  # index of the smallest mip level
        "width": I64,  # texels of level 0
        "height": I64,
        "uv_transform": array_of(F32, 6),  # Texture.uv_transform
    },
)
SHADING_JOB: Final = Struct(
    "ShadingJob",
    {
        "instance_count": I64,
        "first_ids": pointer_to(I64),  # (instance_count + 1), as in Visibility
        "X_camera_mesh": pointer_to(F64),  # (instance_count, 4, 4)
        "matrices": INSTANCE_MATRICES,  # (instance_count,)
        "fx": F64,  # camera intrinsics, pixels
        "fy": F64,
        "cx": F64,
        "cy": F64,
        "area_filter": I64,  # 1: Look.area_filter
        # Tables of ShadingScene.
        "instances": INSTANCE,
        "materials": MATERIAL,
        "textures": TEXTURE,
        "linear_from_byte": pointer_to(F32),  # color.LINEAR_FROM_BYTE
        "linear_from_gamma": pointer_to(F32),  # gamma.LINEAR_FROM_GAMMA
        "span_offsets": pointer_to(I32),  # spans.SPAN_OFFSETS
        "span_setup_kernel": I64,  # address of span_setup.set_up_part
        "sampling_kernel": I64,  # address of sampling.sample_texture
    },
)
"""Inputs of the kernels for one image or layer. HEADLIGHT_JOB and STUDIO_JOB refer to it."""


def _spans(rows: int) -> Any:
    """Return the type of a field of SPANS with this number of rows."""
    return array_of(F32, rows * SPAN_STRIDE)


def _pixels(rows: int) -> Any:
    """Return the type of a field of PIXELS with this number of rows."""
    return array_of(F32, rows * STRIDE)


SPANS: Final = Struct(
    "Spans",
    {
        "begin": _spans(1),  # image column of the first pixel
        "facing": _spans(1),  # -1 where a back face is visible, else 1
        # Weighted sums of the vertices' attributes. The first half of the rows holds them at the first pixel of the
        # span, the second half their change per pixel.
        "weight_sum": _spans(1 + 1),
        "normal": _spans(3 + 3),  # optical frame
        "uv": _spans(2 * (2 + 2)),  # of the set uv0, then of uv1
        "color": _spans(4 + 4),
        "tangent": _spans(4 + 4),  # optical frame, and the sign of the bitangent
        # Filled only if the MATERIAL has has_surface:
        "depth": _spans(1),  # depth in metres times the sum of the weights: constant along a span
        "flat_normal": _spans(3),  # unit normal of the triangle, towards the camera
        # Filled only if the MATERIAL has has_gradients. The first half of the rows holds the changes of the sums per
        # column of the image, the second half those per row.
        "weight_sum_gradient": _spans(1 + 1),
        "uv_gradient": _spans(2 * (2 + 2)),  # of the set uv0, then of uv1
    },
)
"""Values that are linear along a span: rows of SPAN_STRIDE float32, one value per span."""

PIXELS: Final = Struct(
    "ShadedPixels",
    {
        "normal": _pixels(3),  # on the visible side, optical frame, any length
        "facing": _pixels(1),  # -1 where a back face is visible, else 1
        "uv": _pixels(2 * 2),  # uv0, uv1
        "color": _pixels(4),  # vertex colour, RGBA
        "tangent": _pixels(4),  # optical frame, any length; sign of the bitangent
        # Filled only if the MATERIAL has has_gradients:
        "uv_gradient": _pixels(2 * 4),  # of uv0, then of uv1: du/dx, dv/dx, du/dy, dv/dy per pixel of the image
        # Filled only if it has has_surface:
        "flat_normal": _pixels(3),  # unit normal of the triangle, towards the camera
        "point": _pixels(3),  # the visible point in the optical frame, metres
        # Filled by ``material``:
        "base_color": _pixels(4),  # and alpha
        "metallic_roughness": _pixels(4),  # texture: roughness is the second channel, metallic the third
        "occlusion": _pixels(4),  # texture: the first channel
        "emissive": _pixels(4),  # texture
        "texel": _pixels(4),  # any other texture
        # Filled and read by ``sampling``, one texture after the other:
        "level": array_of(I32, STRIDE),  # mip level; mip_levels.MAGNIFIED
        "next_weight": _pixels(1),  # weight of the next mip level
        "sample_uv": _pixels(2),  # texture coordinates, transformed and texels.wrapped
        # For the pixel's mip level, then for the next one where its weight is not 0:
        "texel_offsets": array_of(I32, 2 * 2 * STRIDE),  # index in TEXTURE.texels of the upper and the lower left texel
        "texel_weights": _pixels(2 * 2),  # of the right and the lower texels
    },
)
"""Attributes of pixels: rows of STRIDE float32, one value per pixel."""

SEGMENT: Final = Struct(
    "Segment",
    {
        "job": SHADING_JOB,
        "y": I64,  # row of the image
        "columns": I64,  # address of the pixels' image columns, int32; 0: pixel k is in column k
        # Spans of the row.
        "masks": pointer_to(I64),  # one bit per pixel, set where a span begins
        "starts": pointer_to(I32),  # first pixel of each span; after the last span, the number of pixels
        "ids": pointer_to(I32),  # primitive id of each span
        "row_ids": pointer_to(I32),  # working memory of spans.find_spans
        # The part that is being shaded.
        "spans": SPANS,
        "pixels": PIXELS,
        "has_constant_normals": I64,  # 1: the normal is constant along each of its spans
        # Set by spans.next_segment.
        "first_id": I64,  # primitive id of the instance's first primitive
        "instance": INSTANCE,
        "material": MATERIAL,
        "matrices": INSTANCE_MATRICES,
        "X_camera_mesh": pointer_to(F64),  # (4, 4)
        "attributes": I64,  # HAS_ bits that the mesh has and the material reads
    },
)
"""Neighbouring pixels of a row that see one instance, and the memory in which they are shaded."""
