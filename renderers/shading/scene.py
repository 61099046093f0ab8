"""A draw list as tables that the shading kernels read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.color import LINEAR_FROM_BYTE
from renderers.compiler.jit import kernel
from renderers.compiler.pointers import address_of, f32_at, f64_at
from renderers.drawlist import AlphaMode, Instance, Material, Topology
from renderers.interface import LookName
from renderers.shading.gamma import DECODED
from renderers.shading.layout import II_COLUMNS, P_COLUMNS, P_MIRROR, P_NORMAL, P_TANGENT
from renderers.shading.materials import MaterialRows, as_tables, material_rows
from renderers.shading.spans import LANE_TABLES
from renderers.shading.texture_table import Parallel, TextureTable, is_opaque
from renderers.shading.vertices import VertexRecords, records_of
from renderers.stop import check_stop


@dataclass(frozen=True, slots=True, eq=False)
class ShadingScene:
    """Tables of a draw list under one look. Independent of the camera, shared between threads.

    Does not refer to the meshes, so keeping it does not keep them alive.
    """

    look: LookName
    instances: NDArray[np.int64]
    """(n, II_COLUMNS)."""
    material_integers: NDArray[np.int64]
    """(m, MI_COLUMNS)."""
    material_floats: NDArray[np.float32]
    """(m, MF_COLUMNS)."""
    texture_integers: NDArray[np.int64]
    """(t, TI_COLUMNS)."""
    texture_floats: NDArray[np.float32]
    """(t, TF_COLUMNS)."""
    cull_back: NDArray[np.bool_]
    """(n,) instances whose back faces are not shaded."""
    transparent: NDArray[np.bool_]
    """(n,) instances that are blended or cut out, and not opaque everywhere."""
    culls: bool
    """True if ``cull_back`` is set for any instance."""
    cull_at: int
    """Address of ``cull_back``."""
    has_transparency: bool
    """True if ``transparent`` is set for any instance: an image may need more than one layer."""
    job: tuple[int, ...]
    """Columns S_INSTANCES to S_LANES of an image's job."""
    keep: tuple[Any, ...]
    """Objects that the addresses in the tables point into."""

    @property
    def nbytes(self) -> int:
        """Bytes of vertices and textures."""
        return sum(each.nbytes for each in self.keep if isinstance(each, (np.ndarray, VertexRecords)))


def is_transparent(instance: Instance) -> bool:
    """Return True if something behind the instance may be visible through it."""
    material = instance.material
    if material.alpha_mode is AlphaMode.OPAQUE:
        return False
    texture = material.base_color_texture
    uniform = instance.mesh.colors is None and (texture is None or is_opaque(texture.image))
    opaque_alpha = material.alpha_cutoff if material.alpha_mode is AlphaMode.MASK else 1.0
    return not (uniform and material.base_color[3] >= opaque_alpha)


def prepare(instances: Sequence[Instance], look: LookName, parallel: Parallel | None = None) -> ShadingScene:
    """Return the tables of a draw list's instances, in their order. Decodes the images that the look needs.

    Args:
        parallel: decodes several images at a time; None: one after the other.

    Raises:
        ImageError: an image cannot be decoded.
        ValueError, TypeError: a mesh's arrays are not what ``Mesh`` says.
    """
    textures = TextureTable(mipmaps=look == "studio")
    material_numbers: dict[tuple[int, bool], int] = {}
    materials: list[Material] = []
    rows: list[MaterialRows] = []
    geometry: dict[tuple[int, int], tuple[int, ...]] = {}
    keep: list[Any] = []
    table = np.zeros((max(len(instances), 1), II_COLUMNS), np.int64)
    for i, instance in enumerate(instances):
        check_stop()
        mesh, material = instance.mesh, instance.material
        topology = mesh.elements.shape[1]
        lit = topology == Topology.TRIANGLES
        number = material_numbers.get((id(material), lit))
        if number is None:
            number = material_numbers[id(material), lit] = len(rows)
            rows.append(material_rows(material, look, lit, textures))
            materials.append(material)
        # The set of texture coordinates that generated tangents follow.
        texture = material.normal_texture
        tangent_set = texture.uv_set if texture is not None and rows[number].has_normal_map else -1
        columns = geometry.get((id(mesh), tangent_set))
        if columns is None:
            records = records_of(mesh, tangent_set)
            keep.append(records)
            columns = geometry[id(mesh), tangent_set] = records.columns
        table[i] = (topology, number, *columns)
    check_stop()
    integers, floats = as_tables(rows)
    texture_integers, texture_floats = textures.as_tables(parallel)
    cull_back = np.array([not instance.material.double_sided for instance in instances], np.bool_)
    check_stop()
    transparent = np.array([is_transparent(instance) for instance in instances], np.bool_)
    return ShadingScene(
        look=look,
        instances=table,
        material_integers=integers,
        material_floats=floats,
        texture_integers=texture_integers,
        texture_floats=texture_floats,
        cull_back=cull_back,
        transparent=transparent,
        culls=bool(cull_back.any()),
        cull_at=address_of(cull_back, np.bool_),
        has_transparency=bool(transparent.any()),
        job=(
            address_of(table, np.int64),
            address_of(integers, np.int64),
            address_of(floats, np.float32),
            address_of(texture_integers, np.int64),
            address_of(texture_floats, np.float32),
            address_of(LINEAR_FROM_BYTE, np.float32),
            address_of(DECODED, np.float32),
            address_of(LANE_TABLES, np.int32),
        ),
        keep=(*keep, *materials, *textures.keep),
    )


@kernel("void(int64, int64, int64)", releases_gil=False)
def map_instances(points_at, maps_at, count):
    """Fill the instances' maps of normals and tangents, each up to a positive factor, and their handedness.

    The map of normals is the inverse transpose, defined for flat scales, too.

    Args:
        points_at: address of (count, 4, 4) float64, camera from mesh.
        maps_at: address of (count, P_COLUMNS) float32.
    """
    points, maps = f64_at(points_at), f32_at(maps_at)
    for instance in range(count):
        m, out = 16 * instance, P_COLUMNS * instance
        size, largest = 0.0, 0.0
        for axis in range(3):
            i, j = m + 4 * ((axis + 1) % 3), m + 4 * ((axis + 2) % 3)
            for k in range(3):
                p, q = (k + 1) % 3, (k + 2) % 3
                size = max(size, abs(points[i + p] * points[j + q] - points[i + q] * points[j + p]))
                largest = max(largest, abs(points[m + 4 * axis + k]))
        determinant = (
            points[m] * (points[m + 5] * points[m + 10] - points[m + 6] * points[m + 9])
            - points[m + 1] * (points[m + 4] * points[m + 10] - points[m + 6] * points[m + 8])
            + points[m + 2] * (points[m + 4] * points[m + 9] - points[m + 5] * points[m + 8])
        )
        mirror = -1.0 if determinant < 0.0 else 1.0
        maps[out + P_MIRROR] = mirror
        # cofactor(A) = det(A) A^-T: undo the determinant's sign (mirrored instances) and its size.
        scale = mirror / size if size > 0.0 else mirror
        for axis in range(3):
            i, j = m + 4 * ((axis + 1) % 3), m + 4 * ((axis + 2) % 3)
            for k in range(3):
                p, q = (k + 1) % 3, (k + 2) % 3
                cofactor = points[i + p] * points[j + q] - points[i + q] * points[j + p]
                maps[out + P_NORMAL + 3 * axis + k] = cofactor * scale
                tangent = points[m + 4 * axis + k]
                maps[out + P_TANGENT + 3 * axis + k] = tangent / largest if largest > 0.0 else 0.0
