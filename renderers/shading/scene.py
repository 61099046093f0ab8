"""A draw list as tables that kernels read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.color import BYTE_VALUES
from renderers.compiler.jit import kernel
from renderers.compiler.pointers import address_of, f32_at, f64_at
from renderers.drawlist import Image, Instance, Material, Topology
from renderers.interface import LookName
from renderers.scene_tables import SceneTables, lets_through
from renderers.shading.gamma import DECODED, ENCODED, GAMMA_CELLS
from renderers.shading.layout import II_COLUMNS, P_COLUMNS, P_MIRROR, P_NORMAL, P_TANGENT
from renderers.shading.materials import MaterialRows, as_tables, material_rows
from renderers.shading.textures import Parallel, Texels, TextureTable, texels_of
from renderers.shading.vertices import VertexRecords, records_of
from renderers.stop import check_stop


@dataclass(frozen=True, slots=True, eq=False)
class ShadingScene(SceneTables):
    """What the kernels read of a draw list under one look. What it keeps are not the meshes, so that whoever keeps this
    does not keep them."""

    look: LookName
    culls: bool
    """Whether ``cull_back`` holds of any."""
    cull_at: int
    """Address of ``cull_back``."""
    translucent: bool
    """Whether a picture may need more than one layer."""
    job: tuple[int, ...]
    """S_INSTANCES to S_ENCODED of a picture's job."""

    @property
    def nbytes(self) -> int:
        """Bytes of what the addresses point into, textures above all."""
        return sum(
            each.rows.nbytes if isinstance(each, Texels) else each.nbytes
            for each in self.keep
            if isinstance(each, (Texels, VertexRecords))
        )


def _opaque(image: Image) -> bool:
    return texels_of(image).opaque


def prepare(instances: Sequence[Instance], look: LookName, parallel: Parallel | None = None) -> ShadingScene:
    """Tables of a draw list's instances, in their order; decodes the images that the look needs.

    Args:
        parallel: for several images at the same time; None: one after the other.

    Raises:
        ImageError: an image cannot be decoded.
        ValueError, TypeError: a mesh's arrays are not what ``Mesh`` says.
    """
    textures = TextureTable()
    known: dict[tuple[int, bool], int] = {}
    materials: list[Material] = []
    rows: list[MaterialRows] = []
    geometry: dict[tuple[int, int], tuple[int, ...]] = {}
    keep: list[Any] = []
    table = np.zeros((max(len(instances), 1), II_COLUMNS), dtype=np.int64)
    for i, instance in enumerate(instances):
        check_stop()
        mesh, material = instance.mesh, instance.material
        topology = mesh.elements.shape[1]
        lit = topology == Topology.TRIANGLES
        material_row = known.get((id(material), lit))
        if material_row is None:
            material_row = known[id(material), lit] = len(rows)
            rows.append(material_rows(material, look, lit, textures))
            materials.append(material)
        # The set of coordinates that tangents must follow, -1 where there is no normal map.
        texture = material.normal_texture
        tangent_set = texture.uv_set if texture is not None and rows[material_row].needs_tangents else -1
        columns = geometry.get((id(mesh), tangent_set))
        if columns is None:
            records = records_of(mesh, tangent_set)
            keep.append(records)
            columns = geometry[id(mesh), tangent_set] = records.columns
        table[i] = (topology, material_row, *columns)
    check_stop()
    integers, floats = as_tables(rows)
    check_stop()
    texture_integers, texture_floats = textures.as_tables(parallel)
    cull_back = np.array([not instance.material.double_sided for instance in instances], dtype=np.bool_)
    check_stop()
    layered = np.array([lets_through(instance, _opaque) for instance in instances], dtype=np.bool_)
    return ShadingScene(
        look=look,
        instances=table,
        material_integers=integers,
        material_floats=floats,
        texture_integers=texture_integers,
        texture_floats=texture_floats,
        cull_back=cull_back,
        layered=layered,
        culls=bool(cull_back.any()),
        cull_at=address_of(cull_back, np.bool_),
        translucent=bool(layered.any()),
        job=_job(table, integers, floats, texture_integers, texture_floats),
        keep=(*keep, *materials, *textures.keep),
    )


def _job(
    instances: NDArray[np.int64],
    material_integers: NDArray[np.int64],
    material_floats: NDArray[np.float32],
    texture_integers: NDArray[np.int64],
    texture_floats: NDArray[np.float32],
) -> tuple[int, ...]:
    """``ShadingScene.job``."""
    return (
        address_of(instances, np.int64),
        address_of(material_integers, np.int64),
        address_of(material_floats, np.float32),
        address_of(texture_integers, np.int64),
        address_of(texture_floats, np.float32),
        address_of(BYTE_VALUES, np.float32),
        address_of(DECODED, np.float32),
        address_of(GAMMA_CELLS, np.int32),
        address_of(ENCODED, np.float32),
    )


@kernel("void(int64, int64, int64)", releases_gil=False)
def map_instances(points_at, maps_at, count):
    """Maps of normals, the inverse transpose up to a positive factor (defined for flat scales, too), maps of tangents
    up to a positive factor, and whether X mirrors.

    Args:
        points_at: address of (count, 4, 4) float64, camera from mesh. maps_at: of (count, P_COLUMNS) float32.
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
