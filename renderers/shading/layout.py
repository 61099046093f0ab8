"""Structs that the shading kernels of all looks and their callers share."""

from typing import Any, Final

from renderers.compiler.kernel_types import F32, F64, I32, I64, U32, Address, Pointer
from renderers.compiler.simd import LANES
from renderers.compiler.structs import Struct, inline

MAX_PART_PIXELS: Final = 256
"""Maximum number of pixels shaded at a time: their attributes stay in the first-level cache. A power of two."""
ROW_STRIDE: Final = MAX_PART_PIXELS + LANES
"""Values in a row of PartPixels or PartSpans. Vectors reach up to seven beyond a part's last pixel or span."""
UV_SET_ROWS: Final = 2 + 2
"""Rows of PartSpans for one set of texture coordinates: two values of u and two of v, such as start and change."""

TRIANGLE_VERTICES: Final = 3
"""Value of ``vertices_per_primitive`` for triangles."""

# Bits for the attributes that a mesh has.
HAS_NORMALS: Final = 1
HAS_UV0: Final = 2
HAS_UV1: Final = 4  # kernels compute it as HAS_UV0 << 1
HAS_COLORS: Final = 8
HAS_TANGENTS: Final = 16

# Values of ``lighting`` in ShadingMaterial.
UNLIT: Final = 0
LAMBERT: Final = 1
METALLIC_ROUGHNESS: Final = 2

# Columns of ``vertices`` in ShadingInstance: one vector of float32 per vertex.
VERTEX_POSITION: Final = 0  # 3 values
VERTEX_NORMAL: Final = 3  # 3 values
VERTEX_UV0: Final = 6  # 2 values
VERTEX_COLUMNS: Final = LANES  # as vec.load_rows needs
# Columns of ``extras`` in ShadingInstance, the attributes that few meshes have: one vector of float32 per vertex.
EXTRA_TANGENT: Final = 0  # 4 values
EXTRA_UV1: Final = 4  # 2 values
EXTRA_COLUMNS: Final = LANES


class ShadingInstance(Struct):
    vertices_per_primitive: I64  # a value of drawlist.Topology
    material_index: I64  # in ShadingInputs.materials
    indices: Pointer[U32]  # (M, vertices_per_primitive)
    vertices: Pointer[F32]  # (N, VERTEX_COLUMNS)
    colors: Pointer[F32]  # (N, 4); 0 if the mesh has none
    extras: Pointer[F32]  # (N, EXTRA_COLUMNS); 0 if the mesh has none of them
    attribute_bits: I64  # HAS_ bits of the mesh


class InstanceMatrices(Struct):
    """An instance's transforms of directions in the view of one camera."""

    normal: Pointer[F32] = inline(9)  # transforms normals to the optical frame, up to a positive factor
    tangent: Pointer[F32] = inline(9)  # transforms tangents to the optical frame, up to a positive factor
    mirror_sign: F32  # -1 if the instance's transform mirrors, else 1


class ShadingMaterial(Struct):
    alpha_mode: I64  # ALPHA_ constant of materials
    lighting: I64  # UNLIT, LAMBERT or METALLIC_ROUGHNESS
    encodes_gamma: I64  # 1: headlight looks encode the shaded colour, which is linear, by gamma; 0: they store it as is
    vertex_color_rule: I64  # COLORS_ constant of materials
    uv_sets: I64  # bit 0: a texture reads uv0; bit 1: a texture reads uv1
    reads_gradients: I64  # 1: shading reads uv_gradient
    # Indices of ShadingTextures; -1: none.
    base_color_texture: I64
    metallic_roughness_texture: I64
    normal_texture: I64
    occlusion_texture: I64
    emissive_texture: I64
    specular_texture: I64  # read by look studio only
    specular_color_texture: I64  # read by look studio only
    base_color: Pointer[F32] = inline(4)
    metallic: F32
    roughness: F32
    normal_scale: F32
    occlusion_strength: F32
    emissive: Pointer[F32] = inline(3)  # in look studio multiplied by the emissive strength
    alpha_cutoff: F32
    # Read by look studio only:
    reflectance: F32  # of the dielectric at normal incidence
    specular: F32
    specular_color: Pointer[F32] = inline(3)


class ShadingTexture(Struct):
    wrap_s: I64  # WRAP_ constant of texture_table
    wrap_t: I64
    mag_linear: I64
    min_linear: I64
    mip_mode: I64  # MIPS_ constant of texture_table
    uv_set: I64
    srgb: I64  # 1: the colour channels are decoded to linear light
    texels: Pointer[I32]  # textures.texel_rows: RGBA, red in the lowest byte
    stride: I64  # texels from one row to the next
    last_level: I64  # index of the smallest mip level
    width: I64  # texels of level 0
    height: I64
    uv_transform: Pointer[F32] = inline(6)  # Texture.uv_transform


class ShadingInputs(Struct):
    """Inputs of the kernels for one image or layer. HeadlightInputs and StudioInputs refer to it."""

    instance_count: I64
    first_ids: Pointer[I64]  # (instance_count + 1), as in Visibility
    X_camera_mesh: Pointer[F64]  # (instance_count, 4, 4)
    matrices: InstanceMatrices  # (instance_count,)
    fx: F64  # camera intrinsics, pixels
    fy: F64
    cx: F64
    cy: F64
    area_filter: I64  # 1: textures are averaged over each pixel's area
    reads_positions: I64  # 1: shading reads positions
    reads_flat_normals: I64  # 1: shading reads flat normals; requires reads_positions
    # Tables of ShadingScene.
    instances: ShadingInstance
    materials: ShadingMaterial
    textures: ShadingTexture
    linear_from_byte: Pointer[F32]  # color.LINEAR_FROM_BYTE
    linear_from_gamma: Pointer[F32]  # gamma.LINEAR_FROM_GAMMA
    span_index_of_start_bits: Pointer[I32]  # spans.SPAN_INDEX_OF_START_BITS
    span_setup_kernel: Address  # span_setup.set_up_part_kernel
    sampling_kernel: Address  # sampling.sample_texture


def inline_rows(count: int) -> Any:
    """Return the type of a field that has this number of rows."""
    return inline(count * ROW_STRIDE)


class PartSpans(Struct):
    """Spans of a part: rows of ROW_STRIDE float32, one value per span. Those with rows
    n + n are linear along a span.

    Weighted sums are those of the vertices' attributes, each times the weight of the vertex (``span_weights``)."""

    first_column: Pointer[F32] = inline_rows(1)  # image column of the first pixel
    facing: Pointer[F32] = inline_rows(1)  # -1 where a back face is visible, else 1
    # Weighted sums at the span's first pixel, in as many rows as there are components; then their changes per pixel.
    weight_sum: Pointer[F32] = inline_rows(1 + 1)  # of the weights alone
    normal: Pointer[F32] = inline_rows(3 + 3)  # optical frame
    uv: Pointer[F32] = inline_rows(2 * UV_SET_ROWS)  # uv0: u, v, their changes; then uv1 likewise
    color: Pointer[F32] = inline_rows(4 + 4)
    tangent: Pointer[F32] = inline_rows(4 + 4)  # optical frame, and the sign of the bitangent
    # If ShadingInputs.reads_positions is 1: 1/z, 1/m, not weighted, and its change per pixel.
    inv_z: Pointer[F32] = inline_rows(1 + 1)
    # If ShadingInputs.reads_flat_normals is 1, or the mesh has no normals that the material reads: unit normal of the
    # triangle, towards the camera; 0 for lines and points.
    flat_normal: Pointer[F32] = inline_rows(3)
    # If ShadingMaterial.reads_gradients is 1: changes of the weighted sums per column of the image, then per row.
    weight_sum_gradient: Pointer[F32] = inline_rows(1 + 1)
    uv_gradient: Pointer[F32] = inline_rows(2 * UV_SET_ROWS)  # uv0: u, v per column, u, v per row; then uv1 likewise


class PartPixels(Struct):
    """Attributes of a part's pixels, from which they are shaded: rows of ROW_STRIDE float32, one value per pixel."""

    normal: Pointer[F32] = inline_rows(3)  # optical frame, of the visible side, any length
    # If used_attribute_bits has HAS_TANGENTS: -1 where a back face is visible, else 1.
    facing: Pointer[F32] = inline_rows(1)
    uv: Pointer[F32] = inline_rows(2 * 2)  # uv0, uv1
    color: Pointer[F32] = inline_rows(4)  # vertex colour, RGBA
    tangent: Pointer[F32] = inline_rows(4)  # optical frame, any length; sign of the bitangent
    # If ShadingMaterial.reads_gradients is 1: du/dx, dv/dx, du/dy, dv/dy per pixel of the image, of uv0, then of uv1.
    uv_gradient: Pointer[F32] = inline_rows(2 * 4)
    flat_normal: Pointer[F32] = inline_rows(3)  # if ShadingInputs.reads_flat_normals is 1: as in PartSpans
    position: Pointer[F32] = inline_rows(3)  # if ShadingInputs.reads_positions is 1: optical frame, metres
    # ``material`` fills these. Maps are as sampled, without the material's factors:
    base_color: Pointer[F32] = inline_rows(4)  # and alpha
    metallic_roughness: Pointer[F32] = inline_rows(4)  # roughness is the second channel, metallic the third
    occlusion: Pointer[F32] = inline_rows(4)  # the first channel
    emissive: Pointer[F32] = inline_rows(4)
    scratch_color: Pointer[F32] = inline_rows(4)  # any other texture, or what ``camera_light`` adds
    # ``sampling`` fills and reads these for one texture after the other:
    level: Pointer[I32] = inline(ROW_STRIDE)  # mip level, or level_of_detail.MAGNIFIED
    next_level_weight: Pointer[F32] = inline_rows(1)  # 0 .. 1, of the next mip level
    sample_uv: Pointer[F32] = inline_rows(2)  # texture coordinates after uv_transform and ``texels.wrapped``
    # Two rows for the pixel's mip level, then two for the next level, which are filled if its weight is not 0.
    texel_offsets: Pointer[I32] = inline(2 * 2 * ROW_STRIDE)  # indices of upper and lower left texel in ``texels``
    texel_weights: Pointer[F32] = inline_rows(2 * 2)  # of the right and the lower texels


class ShadingContext(Struct):
    """What a thread shades a row with: the row's spans, the instance of a segment, and memory for one part of it."""

    inputs: ShadingInputs
    y: I64  # row of the image
    columns: Address  # the pixels' image columns, int32; 0: pixel k is in column k
    # Spans of the row.
    start_bits: Pointer[I64]  # one bit per pixel, set where a span begins
    span_starts: Pointer[I32]  # first pixel of each span; after the last span, the number of pixels
    span_primitive_ids: Pointer[I32]  # primitive id of each span
    padded_ids: Pointer[I32]  # working memory of spans.find_spans: primitive ids of the row's pixels
    # The part that is being shaded.
    part_spans: PartSpans
    pixels: PartPixels
    has_constant_normals: I64  # 1: the normal is constant along each of its spans
    # Set by spans.bind_next_segment.
    first_id: I64  # primitive id of the instance's first primitive
    end_id: I64  # after that of its last one
    instance: ShadingInstance
    material: ShadingMaterial
    matrices: InstanceMatrices
    X_camera_mesh: Pointer[F64]  # (4, 4)
    used_attribute_bits: I64  # HAS_ bits that the mesh has and the material reads
