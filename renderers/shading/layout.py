"""Columns of the tables that the shading kernels read and write.

Each look appends columns of its own to the job: see ``headlight.layout`` and ``studio.layout``.
"""

from __future__ import annotations

from typing import Final

from renderers.compiler.simd import LANES

# Job: int64 values, mostly addresses. One per image and layer.
S_FIRST: Final = 0  # (I + 1,) int64, first record of every instance
S_COUNT: Final = 1  # I
S_POINTS: Final = 2  # (I, 4, 4) float64, mesh to optical frame
S_MAPS: Final = 3  # (I, P_COLUMNS) float32
S_LENS: Final = 4  # (4,) float64: fx, fy, cx, cy
S_INSTANCES: Final = 5  # the tables of ShadingScene
S_MATERIAL_INTEGERS: Final = 6
S_MATERIAL_FLOATS: Final = 7
S_TEXTURES: Final = 8
S_TEXTURE_FLOATS: Final = 9
S_BYTE_VALUES: Final = 10  # color.LINEAR_FROM_BYTE
S_DECODED: Final = 11  # gamma.DECODED
S_LANES: Final = 12  # spans.LANE_TABLES
S_COMMON: Final = 13  # first column of a look

# Instance and view, float32.
P_NORMAL: Final = 0  # (3, 3) map of normals to the optical frame, any length
P_TANGENT: Final = 9  # (3, 3) map of tangents, any length
P_MIRROR: Final = 18  # -1 where the map of points mirrors, else 1
P_COLUMNS: Final = 20

# Instance, int64.
II_TOPOLOGY: Final = 0
II_MATERIAL: Final = 1
II_ELEMENTS: Final = 2  # address of (M, II_TOPOLOGY) uint32
II_VERTICES: Final = 3  # address of (N, V_COLUMNS) float32
II_EXTRAS: Final = 4  # address of (N, E_COLUMNS) float32, or 0
II_HAS: Final = 5  # HAS_ bits of the mesh
II_COLUMNS: Final = 6

HAS_NORMALS: Final = 1
HAS_UV0: Final = 2
HAS_UV1: Final = 4
HAS_COLORS: Final = 8
HAS_TANGENTS: Final = 16

# Vertex: one vector of float32.
V_POSITION: Final = 0  # 3 values
V_NORMAL: Final = 3  # 3 values
V_UV0: Final = 6  # 2 values
V_COLUMNS: Final = 8
# Rare attributes of a vertex: two vectors of float32.
E_COLOR: Final = 0  # 4 values
E_UV1: Final = 4  # 2 values
E_TANGENT: Final = 8  # 4 values
E_COLUMNS: Final = 16

# Segment: neighbouring pixels of a row that see one instance. int64 values, see spans.select_instance.
G_Y: Final = 0  # row of the image
G_COLUMNS: Final = 1  # address of the pixels' image columns, int32; 0: pixel k is in column k
G_STARTS: Final = 2  # address of the spans' first pixels, int32
G_RECORDS: Final = 3  # address of the spans' records, int32
G_MASKS: Final = 4  # address of one bit per pixel, set where a span begins
G_SPANS: Final = 5  # address of T_ROWS rows of SPAN_ROOM float32
G_PIXELS: Final = 6  # address of A_ROWS rows of STRIDE float32
G_FIRST: Final = 7  # first record of the instance
G_TOPOLOGY: Final = 8
G_ELEMENTS: Final = 9
G_VERTICES: Final = 10
G_EXTRAS: Final = 11
G_HAS: Final = 12  # HAS_ bits that the mesh has and the material reads
G_POINTS: Final = 13  # address of the (4, 4) float64 of the instance
G_MAPS: Final = 14  # address of the P_COLUMNS float32 of the instance
G_MATERIAL_INTEGERS: Final = 15
G_MATERIAL_FLOATS: Final = 16
G_LENS: Final = 17
G_SURFACE: Final = 18  # 1: the look also reads A_GRADIENT0, A_GRADIENT1, A_FLAT and A_POINT
G_LANES: Final = 19  # address of spans.LANE_TABLES
G_VALUES: Final = 20

PART: Final = 256
"""Maximum number of pixels shaded at a time: their attributes stay in the first-level cache. A multiple of 64."""
STRIDE: Final = PART + LANES
"""Values of a row of attributes. Loops over pixels overrun by up to seven."""
SPAN_ROOM: Final = PART + 2 * LANES
"""Values of a row of spans. A part has at most PART spans; eight pixels read up to eight further ones."""

# Span: values that are linear along it, float32. Every T_ row has one value per span.
T_BEGIN: Final = 0  # image column of the first pixel
T_FACING: Final = 1  # -1 where a back face is seen, else 1
T_TOTAL: Final = 2  # 2 rows: sum of the weights at the first pixel, and its change per pixel
T_NORMAL: Final = 4  # 3 + 3 rows: weighted sum at the first pixel, and its change per pixel; in the optical frame
T_UV0: Final = 10  # 2 + 2
T_UV1: Final = 14  # 2 + 2
T_COLOR: Final = 18  # 4 + 4
T_TANGENT: Final = 26  # 4 + 4; in the optical frame, and the sign of the bitangent
# Only with G_SURFACE:
T_DEPTH: Final = 34  # depth at the first pixel, metres
T_FLAT: Final = 35  # 3 rows: unit normal of the triangle, towards the camera
T_TOTAL_GRADIENT: Final = 38  # 2 rows: change of the sum of the weights per image column and row
T_UV0_GRADIENT: Final = 40  # 2 + 2 rows: change of the weighted sums per image column and row
T_UV1_GRADIENT: Final = 44  # 2 + 2
T_ROWS: Final = 48

# Pixel: attributes, float32. Every A_ row has one value per pixel.
A_NORMAL: Final = 0  # 3 rows: on the side that is seen, optical frame, any length
A_FACING: Final = 3  # -1 where a back face is seen, else 1
A_UV0: Final = 4  # 2 rows
A_UV1: Final = 6  # 2 rows
A_COLOR: Final = 8  # 4 rows: RGBA of the vertices
A_TANGENT: Final = 12  # 4 rows: optical frame, any length; sign of the bitangent
# Only with G_SURFACE:
A_GRADIENT0: Final = 16  # 4 rows: du/dx, dv/dx, du/dy, dv/dy of the first set, per pixel
A_GRADIENT1: Final = 20  # 4 rows
A_FLAT: Final = 24  # 3 rows: unit normal of the triangle, towards the camera
A_POINT: Final = 27  # 3 rows: the visible point in the optical frame, metres
# Filled by the material:
A_BASE: Final = 30  # 4 rows: base colour and alpha
A_ROUGH: Final = 34  # 4 rows: metallic-roughness texture; roughness is the second, metallic the third
A_OCCLUSION: Final = 38  # 4 rows: occlusion texture, the first
A_EMISSIVE: Final = 42  # 4 rows: emissive texture
A_TEXEL: Final = 46  # 4 rows: any other texture
A_ROWS: Final = 50
