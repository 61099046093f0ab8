"""Tables that the shading kernels read: what is at which place."""

from __future__ import annotations

from typing import Final

# The job: int64 values, mostly addresses.
S_PBR: Final = 0  # the look
S_MODE: Final = 1  # DIRECT, GATHER or UNDER
S_WIDTH: Final = 2
S_HEIGHT: Final = 3
S_STRIDE: Final = 4  # values of a row of records
S_FIRST: Final = 5  # (I + 1,) int64, first record of every instance
S_COUNT: Final = 6  # I
S_POINTS: Final = 7  # (I, 4, 4) float64, mesh to optical frame
S_MAPS: Final = 8  # (I, P_COLUMNS) float32
S_LENS: Final = 9  # (4,) float64: fx, fy, cx, cy
S_INSTANCES: Final = 10  # the tables of ShadingScene
S_MATERIAL_INTEGERS: Final = 11
S_MATERIAL_FLOATS: Final = 12
S_TEXTURES: Final = 13
S_TEXTURE_FLOATS: Final = 14
S_BYTE_VALUES: Final = 15  # BYTE_VALUES
S_DECODED: Final = 16  # DECODED
S_GAMMA: Final = 17  # GAMMA_CELLS
S_ENCODED: Final = 18  # ENCODED
S_BACKGROUND: Final = 19  # red, green, blue, lowest byte first
S_GATHERED: Final = 20  # (4, H, W + 8) float32, see compose
S_COLOR: Final = 21  # (H, W, 3) uint8
S_PLACES: Final = 22  # (H, S_STRIDE) int32: the columns of the picture that records belong to; 0: where they lie
S_COUNTS: Final = 23  # (H,) int32, with S_PLACES: records of each row
S_COLUMNS: Final = 24


# Per instance and view, float32.
P_NORMAL: Final = 0  # (3, 3) map of normals to the optical frame, any length
P_TANGENT: Final = 9  # (3, 3) map of tangents, any length
P_MIRROR: Final = 18  # -1 where the map of points mirrors, else 1
P_COLUMNS: Final = 20

# Columns of the instance table, int64.
II_TOPOLOGY: Final = 0
II_MATERIAL: Final = 1
II_ELEMENTS: Final = 2  # address of (M, II_TOPOLOGY) uint32
II_VERTICES: Final = 3  # address of (N, V_COLUMNS) float32
II_EXTRAS: Final = 4  # address of (N, E_COLUMNS) float32; 0: none of them
II_HAS: Final = 5  # HAS_ bits
II_COLUMNS: Final = 6

HAS_NORMALS: Final = 1
HAS_UV0: Final = 2
HAS_UV1: Final = 4
HAS_COLORS: Final = 8
HAS_TANGENTS: Final = 16

# A vertex: one vector register.
V_POSITION: Final = 0  # 3 values
V_NORMAL: Final = 3  # 3 values
V_UV0: Final = 6  # 2 values
V_COLUMNS: Final = 8
# What few meshes have: two registers.
E_COLOR: Final = 0  # 4 values
E_UV1: Final = 4  # 2 values
E_TANGENT: Final = 8  # 4 values
E_COLUMNS: Final = 16

# Rows of a row's attributes, float32: one value per pixel.
A_NORMAL: Final = 0  # 3 rows: normal; in the mesh's frame, or for meshes without normals in the optical frame
A_FACING: Final = 3  # 1 row: -1 where a back face is seen
A_UV0: Final = 4  # 2 rows
A_UV1: Final = 6  # 2 rows
A_COLOR: Final = 8  # 4 rows: RGBA as the mesh has them
A_TANGENT: Final = 12  # 4 rows: tangent in the mesh's frame; sign of the bitangent
# Filled by shading, as far as a material needs them.
A_LIGHT: Final = A_FACING  # 1 row, instead: what the head light leaves of a colour
A_PLACE: Final = A_NORMAL  # 2 rows, instead, int32: column and row among a texture's texels, see sampling.FINE
A_SHARE: Final = A_UV1  # 1 row, instead, int32: what the head light leaves, see mixing.WHOLE
A_INDEX: Final = A_UV1 + 1  # 1 row, instead, int32: the number of a texel
A_RUN: Final = A_TANGENT  # 4 rows, instead: one value per run, see texel_planes
A_BASE: Final = 16  # 4 rows: base colour and alpha where they vary; the shaded colour where it is not written at once
A_TEXEL: Final = 20  # 4 rows: what a texture has at the pixels
A_ROUGH: Final = 24  # 4 rows: metallic-roughness texture: roughness is the second, metallic the third
A_OCCLUSION: Final = 28  # 4 rows: occlusion is the first
A_EMISSIVE: Final = 32  # 4 rows
A_ROWS: Final = 36
