"""Reads the primitives of the meshes in use as parts."""

from __future__ import annotations

from collections.abc import Mapping

from gateway.gltf.deformation import REST, Pose
from gateway.gltf.document_cache import DocumentContent
from gateway.gltf.errors import GltfError, GltfLimitError, add_warning, as_warning, checked_item
from gateway.gltf.limits import GltfLimits
from gateway.gltf.materials import Materials
from gateway.gltf.meshes import Meshes
from gateway.gltf.nodes import SceneNodes
from gateway.gltf.schema import Document, Light, Mesh
from gateway.scene.geometry import Part, Surface
from scenegate.warning_text import joined_warnings


class PartReader:
    """Reads the primitives of the meshes in use as parts. What is invalid is left out with a warning."""

    def __init__(self, document: Document, meshes: Meshes, materials: Materials, limits: GltfLimits) -> None:
        self._document = document
        self._meshes = meshes
        self._materials = materials
        self._limits = limits
        self._primitive_count = 0
        self._any_read = False
        self._left_out: list[str] = []
        """Sentences about primitives that are left out."""

    def read(
        self,
        nodes: SceneNodes,
        poses: Mapping[int, Pose],
        mesh_names: Mapping[int, str],
        lights: list[Light | None],
        warnings: list[str],
    ) -> DocumentContent:
        """Return everything but the nodes.

        Args:
            poses: Poses of the nodes with parts of their own, by index in ``nodes``.
            mesh_names: Names of the meshes in use, by mesh index.
            warnings: Warnings so far; those about primitives that are left out are appended to this list.

        Raises:
            GltfError: A limit is exceeded, or nothing can be drawn.
        """
        parts, posed_parts = self._parts(nodes, poses)
        warnings += self._left_out
        meshes = self._document.meshes or ()
        return DocumentContent(
            generator=self._document.generator,
            cameras=self._document.cameras or [],
            lights=lights,
            parts=parts,
            posed_parts=posed_parts,
            mesh_names=mesh_names,
            element_counts={mesh: count_elements(mesh_parts) for mesh, mesh_parts in parts.items()},
            morphed_mesh_count=sum(isinstance(mesh, Mesh) and any(mesh.weights or ()) for mesh in meshes),
            warnings=tuple(warnings),
            mesh_bytes=self._meshes.nbytes,
        )

    def _parts(
        self, nodes: SceneNodes, poses: Mapping[int, Pose]
    ) -> tuple[dict[int, tuple[Part, ...]], dict[int, tuple[Part, ...]]]:
        """Return the parts by mesh index, and those of nodes with a pose of their own by index in ``nodes``."""
        parts: dict[int, tuple[Part, ...]] = {}
        posed_parts: dict[int, tuple[Part, ...]] = {}
        parts_in_pose: dict[tuple[int, Pose], tuple[Part, ...]] = {}  # the instances of a node share a pose
        missing: list[str] = []
        for scene_index, mesh_index in enumerate(nodes.meshes):
            pose = poses.get(scene_index)
            if mesh_index is None or (pose is None and mesh_index in parts):
                continue
            if pose is not None and (mesh_index, pose) in parts_in_pose:
                posed_parts[scene_index] = parts_in_pose[mesh_index, pose]
                continue
            mesh = Mesh()
            with as_warning(missing, "the node has no mesh"):
                path = f"nodes[{nodes.indices[scene_index]}].mesh"
                mesh = checked_item(self._document.meshes, mesh_index, "meshes", path)
                if not mesh.primitives:
                    raise GltfError(f"meshes[{mesh_index}].primitives: there are none")
            if pose is None:
                at_rest = REST if self._document.merged_by_drake else Pose(tuple(mesh.weights or ()))
                parts[mesh_index] = self._parts_of(mesh, mesh_index, at_rest)
            else:
                posed_parts[scene_index] = parts_in_pose[mesh_index, pose] = self._parts_of(mesh, mesh_index, pose)
        if not self._any_read and (missing or self._left_out):
            raise GltfError(f"nothing can be drawn: {joined_warnings(missing + self._left_out)}")
        nodes.warnings.extend(missing)
        return parts, posed_parts

    def _parts_of(self, mesh: Mesh, index: int, pose: Pose) -> tuple[Part, ...]:
        """Return the parts of ``meshes[index]`` in a pose."""
        primitives, parts = mesh.primitives or [], []
        self._primitive_count += len(primitives)
        if self._primitive_count > self._limits.max_primitives:
            limit = self._limits.max_primitives
            raise GltfLimitError(f"meshes[{index}]: more primitives than max_primitives = {limit}")
        for number in range(len(primitives)):
            name = f"meshes[{index}].primitives[{number}]"
            try:
                primitive = checked_item(primitives, number, "primitives", name)
                smooth = self._materials.is_from_vtk(primitive)
                if (surface := self._meshes.read(primitive, name, pose, smooth=smooth)) is not None:
                    parts.append(Part(Surface(surface), self._materials.get(primitive, name)))
                self._any_read = True
            except GltfLimitError:
                raise
            except GltfError as error:
                add_warning(self._left_out, error, f"{name} is left out")
        return tuple(parts)


def count_elements(parts: tuple[Part, ...]) -> int:
    """Return the number of elements (triangles, lines and points; a primitive of glTF is a mesh of them)."""
    return sum(len(part.shape.mesh.elements) for part in parts if isinstance(part.shape, Surface))
