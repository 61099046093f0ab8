"""A draw list as tables that the kernels of this look read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from renderers.drawlist import AlphaMode, Image, Instance, Material, Texture, Topology
from renderers.scene_tables import SceneTables, lets_through
from renderers.shading.materials import look_material
from renderers.shading.studio.mipmaps import MipTable, mip_chain
from renderers.shading.vertices import records_of
from renderers.stop import check_stop

# Columns of the instance table.
II_TOPOLOGY: Final = 0
II_MATERIAL: Final = 1
II_ELEMENTS: Final = 2  # and the next three: ``VertexRecords.columns``
II_VERTICES: Final = 3
II_EXTRAS: Final = 4
II_HAS: Final = 5
II_COLUMNS: Final = 6

# Columns of the materials' integer table: rows of the texture table or -1.
MI_ALPHA: Final = 0  # 0 opaque, 1 mask, 2 blend
MI_UNLIT: Final = 1
MI_BASE: Final = 2
MI_METALLIC_ROUGHNESS: Final = 3
MI_NORMAL: Final = 4
MI_OCCLUSION: Final = 5
MI_EMISSIVE: Final = 6
MI_SPECULAR: Final = 7
MI_SPECULAR_COLOR: Final = 8
MI_UV: Final = 9  # bit 0, 1: the first, second set of coordinates is read
MI_COLUMNS: Final = 10

# Columns of the materials' float table.
MF_BASE: Final = 0  # 4
MF_METALLIC: Final = 4
MF_ROUGHNESS: Final = 5
MF_NORMAL_SCALE: Final = 6
MF_OCCLUSION: Final = 7
MF_EMISSIVE: Final = 8  # 3, with the strength
MF_CUTOFF: Final = 11
MF_REFLECTANCE: Final = 12  # of the dielectric, seen from the front
MF_SPECULAR: Final = 13
MF_SPECULAR_COLOR: Final = 14  # 3
MF_COLUMNS: Final = 17

_ALPHA: Final = {AlphaMode.OPAQUE: 0, AlphaMode.MASK: 1, AlphaMode.BLEND: 2}


@dataclass(frozen=True, slots=True, eq=False)
class StudioScene(SceneTables):
    """What the kernels read of a draw list; independent of the rig, too."""

    @property
    def nbytes(self) -> int:
        """Bytes of what was made for this look."""
        return sum(each.nbytes for each in self.keep if each is not None and not isinstance(each, Material))


def reflectance(ior: float) -> float:
    """Of a dielectric in air seen from the front (KHR_materials_ior); 0 stands for total reflection."""
    return 1.0 if ior == 0.0 else ((ior - 1.0) / (ior + 1.0)) ** 2


def _material_rows(material: Material, lit: bool, textures: MipTable) -> tuple[list[int], list[float]]:
    seen = look_material(material, "pbr")
    unlit = seen.unlit or not lit
    shiny = seen.metallic < 1.0 or seen.metallic_roughness_texture is not None

    uv = 0

    def row(texture: Texture | None, wanted: bool, srgb: bool = False) -> int:
        nonlocal uv
        if texture is None or not wanted:
            return -1
        uv |= 2 if texture.uv_set == 1 else 1
        return textures.row(texture, srgb)

    integers = [
        _ALPHA[seen.alpha_mode],
        int(unlit),
        row(seen.base_color_texture, True, True),
        row(seen.metallic_roughness_texture, not unlit),
        row(seen.normal_texture, not unlit),
        row(seen.occlusion_texture, not unlit and seen.occlusion_strength != 0.0),
        row(seen.emissive_texture, not unlit and any(seen.emissive), True),
        row(seen.specular_texture, not unlit and shiny),
        row(seen.specular_color_texture, not unlit and shiny, True),
    ]
    integers.append(uv)
    floats = [
        *seen.base_color,
        seen.metallic,
        seen.roughness,
        seen.normal_scale,
        seen.occlusion_strength,
        *(value * seen.emissive_strength for value in seen.emissive),
        seen.alpha_cutoff,
        reflectance(seen.ior),
        seen.specular,
        *seen.specular_color,
    ]
    return integers, floats


def _opaque(image: Image) -> bool:
    return bool((mip_chain(image, True).levels[0][..., 3] == 255).all())


def prepare(instances: Sequence[Instance]) -> StudioScene:
    """Tables of a draw list's instances, in their order; decodes the images that they need.

    Raises:
        ImageError: an image cannot be decoded.
        ValueError, TypeError: a mesh's arrays are not what ``Mesh`` says.
    """
    textures = MipTable()
    rows: dict[tuple[int, bool], int] = {}
    integers: list[list[int]] = []
    floats: list[list[float]] = []
    keep: list[Any] = []
    geometry: dict[tuple[int, int], tuple[int, ...]] = {}
    table = np.zeros((max(len(instances), 1), II_COLUMNS), np.int64)
    for i, instance in enumerate(instances):
        check_stop()
        mesh, material = instance.mesh, instance.material
        lit = mesh.topology is Topology.TRIANGLES
        row = rows.get((id(material), lit))
        if row is None:
            row = rows[id(material), lit] = len(integers)
            keep.append(material)
            for rows_of, made in zip((integers, floats), _material_rows(material, lit, textures), strict=True):
                rows_of.append(made)  # type: ignore[attr-defined]  # integers and floats, each in its list
        mapped = material.normal_texture if integers[row][MI_NORMAL] >= 0 else None
        tangent_set = -1 if mapped is None else mapped.uv_set
        columns = geometry.get((id(mesh), tangent_set))
        if columns is None:
            records = records_of(mesh, tangent_set)
            keep.append(records)
            columns = geometry[id(mesh), tangent_set] = records.columns
        table[i] = (mesh.elements.shape[1], row, *columns)
    texture_integers, texture_floats = textures.as_tables()
    with np.errstate(over="ignore"):  # a posted factor beyond float32 is infinite
        float_table = np.array(floats or [[0.0] * MF_COLUMNS], np.float32)
    return StudioScene(
        instances=table,
        material_integers=np.array(integers or [[-1] * MI_COLUMNS], np.int64),
        material_floats=float_table,
        texture_integers=texture_integers,
        texture_floats=texture_floats,
        cull_back=np.array([not instance.material.double_sided for instance in instances], np.bool_),
        layered=np.array([lets_through(instance, _opaque) for instance in instances], np.bool_),
        keep=(*keep, *textures.keep),
    )


def normal_matrices(X_camera_mesh: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3, 3) float64: maps of normals, the inverse transpose up to a positive factor; defined for flat scales, too.

    Args:
        X_camera_mesh: (n, 4, 4) float64.
    """
    a = X_camera_mesh[:, :3, :3]
    with np.errstate(all="ignore"):  # instances that are not finite draw nothing
        cofactors = np.stack(
            (np.cross(a[:, 1], a[:, 2]), np.cross(a[:, 2], a[:, 0]), np.cross(a[:, 0], a[:, 1])),
            axis=1,
        )
        # cofactor(A) = det(A) A^-T: undo the determinant's sign (mirrored instances) and its size.
        size = np.abs(cofactors).max(axis=(1, 2), keepdims=True)
        sign = np.where(np.linalg.det(a) < 0.0, -1.0, 1.0)[:, None, None]
        result: NDArray[np.float64] = np.ascontiguousarray(cofactors * sign / np.where(size > 0.0, size, 1.0))
    return result
