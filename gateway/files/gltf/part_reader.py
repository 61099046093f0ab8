"""Reads the primitives of the meshes in use as parts."""

from collections.abc import Mapping
from typing import TypeAlias

from gateway.files.gltf.deformation import REST, MeshPose
from gateway.files.gltf.gltf_errors import GltfError, GltfLimitError, as_warning, checked_item
from gateway.files.gltf.limits import GltfLimits
from gateway.files.gltf.material_reader import Materials, missing_coordinates, multiplied
from gateway.files.gltf.meshes import Meshes
from gateway.files.gltf.nodes import SceneNodes
from gateway.files.gltf.schema import Document, GltfMesh
from gateway.scene.tree.geometry import Part, Surface
from renderers.drawlist import Material
from scenegate.warning_text import joined_warnings

Parts: TypeAlias = tuple[Part, ...]


class PartReader:
    """Reads the primitives of the meshes in use as parts. What is invalid is left out with a warning."""

    def __init__(
        self, document: Document, meshes: Meshes, materials: Materials, limits: GltfLimits, warnings: list[str]
    ) -> None:
        self._document = document
        self._meshes = meshes
        self._materials = materials
        self._limits = limits
        self._warnings = warnings
        self._primitive_count = 0
        self._any_valid = False
        """True once a primitive has been read, even if it has nothing to draw."""
        self._colored: dict[tuple[int, tuple[float, ...]], Material] = {}
        """Materials of instances, by that of the mesh and the instance's colour."""
        self._left_out: list[str] = []
        """Sentences about primitives that are left out."""

    def read(self, nodes: SceneNodes, poses: Mapping[int, MeshPose]) -> tuple[dict[int, Parts], dict[int, Parts]]:
        """Return the parts of each mesh in use, by mesh index, and those of nodes with a pose of their own, by
        position.

        Sentences about nodes whose mesh is missing are appended to ``nodes.warnings``: they do not hold for a document
        with other nodes. Raises GltfError if a limit is exceeded, or nothing can be drawn.
        """
        parts_of_mesh: dict[int, Parts] = {}
        posed_parts: dict[int, Parts] = {}
        read: dict[tuple[int, MeshPose | None], Parts] = {}  # the instances of a node share a pose
        missing: list[str] = []
        for position, (node_index, mesh_index) in enumerate(zip(nodes.indices, nodes.meshes, strict=True)):
            if mesh_index is None:
                continue
            pose = poses.get(position)
            if (mesh_index, pose) not in read:
                read[mesh_index, pose] = self._read_mesh(mesh_index, f"nodes[{node_index}].mesh", pose, missing)
            if pose is None:
                parts_of_mesh[mesh_index] = read[mesh_index, pose]
            else:
                posed_parts[position] = read[mesh_index, pose]
        if not self._any_valid and (missing or self._left_out):
            raise GltfError(f"nothing can be drawn: {joined_warnings(missing + self._left_out)}")
        self._warnings += self._left_out
        nodes.warnings.extend(missing)
        return parts_of_mesh, posed_parts

    def _read_mesh(self, index: int, path: str, pose: MeshPose | None, missing: list[str]) -> Parts:
        """Return the parts of ``meshes[index]`` in a pose; None: the stored one.

        A sentence is appended to ``missing`` if there is no such mesh, or nothing in it.
        """
        with as_warning(missing, "the node has no mesh"):
            mesh = checked_item(self._document.meshes, index, "meshes", path)
            if not mesh.primitives:
                raise GltfError(f"meshes[{index}].primitives: there are none")
            self._primitive_count += len(mesh.primitives)
            if self._primitive_count > self._limits.max_primitives:
                limit = self._limits.max_primitives
                raise GltfLimitError(f"meshes[{index}]: more primitives than max_primitives = {limit}")
            if pose is None:
                pose = REST if self._document.merged_by_drake else MeshPose(tuple(mesh.weights or ()))
            parts = [self._read_primitive(mesh, index, number, pose) for number in range(len(mesh.primitives))]
            return tuple([part for part in parts if part is not None])
        return ()

    def _read_primitive(self, mesh: GltfMesh, mesh_index: int, number: int, pose: MeshPose) -> Part | None:
        """Return the part of a primitive; None if it is left out or has nothing to draw."""
        path = f"meshes[{mesh_index}].primitives[{number}]"
        with as_warning(self._left_out, f"{path} is left out"):
            primitive = checked_item(mesh.primitives, number, "primitives", path)
            smooth = self._materials.is_from_vtk(primitive)
            surface = self._meshes.read(primitive, path, pose, smooth=smooth)
            self._any_valid = True
            if surface is None:
                return None
            material = self._materials.get(primitive, path)
            if missing := missing_coordinates(material, surface):
                self._warnings.append(f"{path}: textures have the colour of their corner, as it has no {missing[0]}")
            if pose.color is not None:
                material = self._colored.setdefault((id(material), pose.color), multiplied(material, pose.color))
            return Part(Surface(surface), material)
        return None


def count_elements(parts: Parts) -> int:
    """Return the number of elements (triangles, lines and points; a primitive of glTF is a mesh of them)."""
    return sum(len(part.shape.mesh.elements) for part in parts if isinstance(part.shape, Surface))
