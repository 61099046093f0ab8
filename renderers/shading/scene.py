"""Conversion of draw lists to the tables that the shading kernels read."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.color import LINEAR_FROM_BYTE
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import kernel_address
from renderers.compiler.kernel_types import I64, Address
from renderers.compiler.pointers import address_of, advance, f64_at
from renderers.drawlist import AlphaMode, Instance, Material, Mesh, Topology
from renderers.interface import VTK_LOOKS, LookName, Parallel
from renderers.shading.gamma import LINEAR_FROM_GAMMA
from renderers.shading.layout import InstanceMatrices, ShadingInputs, ShadingInstance, ShadingMaterial, ShadingTexture
from renderers.shading.materials import MaterialTable, drawn_material
from renderers.shading.mesh_buffers import MeshBuffers, buffers_of
from renderers.shading.sampling import sample_texture
from renderers.shading.span_setup import set_up_part_kernel
from renderers.shading.spans import SPAN_INDEX_OF_START_BITS
from renderers.shading.texture_table import TextureTable
from renderers.shading.textures import texels_of
from renderers.shading.vec3 import cofactor, determinant
from renderers.stop import check_stop


@dataclass(frozen=True, slots=True, eq=False)
class ShadingScene:
    """Tables of a draw list under one look. Independent of the camera, shared between threads.

    It holds no references to the meshes, so that it does not keep them alive.
    """

    look: LookName
    instances: NDArray[Any]
    """(n,) ShadingInstance; at least one."""
    materials: NDArray[Any]
    """(m,) ShadingMaterial; at least one."""
    textures: NDArray[Any]
    """(t,) ShadingTexture; at least one."""
    cull_back: NDArray[np.bool_] | None
    """(n,) True for instances whose back faces are not shaded; None if there are none."""
    transparent: NDArray[np.bool_]
    """(n,) True for instances that are not opaque everywhere. They are blended or cut out after all others."""
    blended_in_place: NDArray[np.bool_]
    """(n,) True for other instances that are not opaque everywhere, in the looks of VTK. They are blended with the
    surfaces drawn before them, opaque ones included, and hide those behind them that are drawn later."""
    has_transparency: bool
    """True if ``transparent`` or ``blended_in_place`` is set for any instance: an image may need several layers."""
    tables: dict[str, int]
    """The fields of ShadingInputs that are addresses of tables."""
    keep: tuple[Any, ...]
    """Objects that the addresses in the tables point into."""

    @property
    def nbytes(self) -> int:
        """Bytes of vertices and textures. Textures of one image share its arrays."""
        arrays = {id(each): each for each in self.keep if isinstance(each, (np.ndarray, MeshBuffers))}
        return sum(each.nbytes for each in arrays.values())


def _is_transparent(material: Material, mesh: Mesh, look: LookName) -> bool:
    """Return True if surfaces behind an instance may be visible through it, in whatever order they are drawn.

    VTK treats a surface as transparent if its base colour factor or a vertex colour has an alpha below 1. For materials
    written by its own exporter, a translucent texture counts as well.
    """
    if look in VTK_LOOKS:
        texture, colors = material.base_color_texture, mesh.colors
        return (
            material.base_color[3] < 1.0
            or (colors is not None and bool((colors[:, 3] < 1.0).any()))
            or (material.vtk_export and texture is not None and texels_of(texture.image).translucent)
        )
    if material.alpha_mode is AlphaMode.OPAQUE:
        return False
    texture = material.base_color_texture
    has_uniform_alpha = mesh.colors is None and (texture is None or texels_of(texture.image).opaque)
    opaque_alpha = material.alpha_cutoff if material.alpha_mode is AlphaMode.MASK else 1.0
    return not (has_uniform_alpha and material.base_color[3] >= opaque_alpha)


def _has_alpha(material: Material) -> bool:
    """Return True if the base colour texture is not opaque."""
    texture = material.base_color_texture
    return texture is not None and not texels_of(texture.image).opaque


def prepare(instances: Sequence[Instance], look: LookName, parallel: Parallel | None = None) -> ShadingScene:
    """Return the tables of a draw list's instances, in their order. Decodes images that the look needs, in parallel.

    Raises:
        ImageError: an image cannot be decoded.
        ValueError, TypeError: the arrays of a mesh are not as documented in ``Mesh``.
    """
    textures = TextureTable()
    materials = MaterialTable(look, textures)
    buffer_fields: dict[tuple[int, int], tuple[int, ...]] = {}
    keep: list[Any] = []
    rows: list[tuple[int, ...]] = []
    for instance in instances:
        check_stop()
        mesh, vertices_per_primitive = instance.mesh, instance.mesh.elements.shape[1]
        material = materials.index_of(instance.material, vertices_per_primitive == Topology.TRIANGLES)
        # Set of texture coordinates from which missing tangents are generated.
        texture = instance.material.normal_texture
        tangent_set = texture.uv_set if texture is not None and materials.has_normal_map(material) else -1
        fields = buffer_fields.get((id(mesh), tangent_set))
        if fields is None:
            srgb_colors = look == "plain" and mesh.colors is not None
            buffers = buffers_of(mesh, tangent_set, srgb_colors=srgb_colors)
            keep.append(buffers)
            fields = buffer_fields[id(mesh), tangent_set] = buffers.fields
        rows.append((vertices_per_primitive, material, *fields))
    table = np.array(rows, ShadingInstance.dtype) if rows else np.zeros(1, ShadingInstance.dtype)
    material_structs, texture_structs = materials.structs(), textures.structs(parallel)
    drawn = [drawn_material(instance.material, look) for instance in instances]
    cull_back = np.array([not material.double_sided for material in drawn], np.bool_)
    is_transparent = [
        _is_transparent(material, each.mesh, look) for material, each in zip(drawn, instances, strict=True)
    ]
    transparent = np.array(is_transparent, np.bool_)
    blended_in_place = np.array([look in VTK_LOOKS and _has_alpha(material) for material in drawn], np.bool_)
    blended_in_place &= ~transparent
    return ShadingScene(
        look=look,
        instances=table,
        materials=material_structs,
        textures=texture_structs,
        cull_back=cull_back if cull_back.any() else None,
        transparent=transparent,
        blended_in_place=blended_in_place,
        has_transparency=bool(transparent.any() or blended_in_place.any()),
        tables={
            "instances": address_of(table, ShadingInstance.dtype),
            "materials": address_of(material_structs, ShadingMaterial.dtype),
            "textures": address_of(texture_structs, ShadingTexture.dtype),
            "linear_from_byte": address_of(LINEAR_FROM_BYTE, np.float32),
            "linear_from_gamma": address_of(LINEAR_FROM_GAMMA, np.float32),
            "span_index_of_start_bits": address_of(SPAN_INDEX_OF_START_BITS, np.int32),
        },
        keep=(*keep, *materials.materials, *textures.keep),
    )


class ShadingJob:
    """A ShadingInputs for one image or layer, and the memory that it points into. Immutable, thread-safe."""

    def __init__(
        self,
        shading: ShadingScene,
        camera: Camera,
        first_ids: int,
        X_camera_mesh: int,
        *,
        area_filter: bool = False,
        reads_positions: bool = False,
        reads_flat_normals: bool = False,
    ) -> None:
        """
        Args:
            first_ids, X_camera_mesh: addresses of the arrays of these names in ``Visibility``.
        """
        count = len(shading.transparent)
        matrices, job = np.empty(len(shading.instances), InstanceMatrices.dtype), np.empty(1, ShadingInputs.dtype)
        matrices_address = address_of(matrices, InstanceMatrices.dtype)
        compute_instance_matrices(X_camera_mesh, matrices_address, count, int(shading.look in VTK_LOOKS))
        job[0] = ShadingInputs.record(
            instance_count=count,
            first_ids=first_ids,
            X_camera_mesh=X_camera_mesh,
            matrices=matrices_address,
            fx=camera.fx,
            fy=camera.fy,
            cx=camera.cx,
            cy=camera.cy,
            area_filter=area_filter,
            reads_positions=reads_positions,
            reads_flat_normals=reads_flat_normals,
            span_setup_kernel=kernel_address(set_up_part_kernel),
            sampling_kernel=kernel_address(sample_texture),
            **shading.tables,
        )
        self.address = address_of(job, ShadingInputs.dtype)
        """Valid while this object is alive."""
        self._keep = (shading, matrices, job)


@kernel(releases_gil=False)
def compute_instance_matrices(
    X_camera_mesh_address: Address, matrices_address: Address, count: I64, inverts_mirrored: I64
) -> None:
    """Fill ``count`` InstanceMatrices, each matrix up to a positive factor.

    The matrix of normals is the inverse transpose, as a matrix of cofactors: it is defined for scales of 0, too.

    Args:
        inverts_mirrored: not 0: invert the normals of mirrored instances, so that no light reaches them. VTK treats
            their front faces as back faces.
    """
    all_matrices = InstanceMatrices(matrices_address)
    for k in range(count):
        X, matrices = advance(f64_at(X_camera_mesh_address), 16 * k), all_matrices[k]
        max_cofactor, max_value = 0.0, 0.0
        for row in range(3):
            for column in range(3):
                max_cofactor = max(max_cofactor, abs(cofactor(X, row, column)))
                max_value = max(max_value, abs(X[4 * row + column]))
        mirror_sign = -1.0 if determinant(X) < 0.0 else 1.0
        matrices.mirror_sign = 1.0 if inverts_mirrored != 0 else mirror_sign
        # cofactor(A) = det(A) A^-T: remove the determinant's sign (mirrored instances) and its magnitude.
        scale = mirror_sign / max_cofactor if max_cofactor > 0.0 else mirror_sign
        for row in range(3):
            for column in range(3):
                matrices.normal[3 * row + column] = cofactor(X, row, column) * scale
                value = X[4 * row + column]
                matrices.tangent[3 * row + column] = value / max_value if max_value > 0.0 else 0.0
