"""Writes a scene tree as one binary glTF 2.0 file (``.glb``): nodes named as in the tree, meshes with textures, lights.

The tree is Z-up and glTF is Y-up, so all nodes are below a root that is rotated by -90 degrees about X. A ``Mesh`` or
``Image`` object with several uses is written once, and so are equal materials. Vertex colours of point clouds and
triads are converted from sRGB to linear colours, as glTF requires (3.7.2.1); those of meshes are already linear in
the tree. Hidden subtrees are left out, and so are nodes whose transform is not finite, which JSON cannot express.
"""

import math
from typing import Any, Final

import numpy as np

from gateway.files.gltf.export.glb_document import (
    INDEX_TARGET,
    MAX_BYTES,
    VERTEX_TARGET,
    GltfDocument,
    column_major,
    is_writable,
)
from gateway.files.gltf.export.material_writer import MaterialWriter
from gateway.files.gltf.lights import EXTENSION as LIGHTS
from gateway.scene.draw.meshing import meshes_of
from gateway.scene.tree.materials import faded
from gateway.scene.tree.nodes import Node, json_element
from gateway.scene.tree.transforms import IDENTITY, Y_UP_TO_Z_UP, Matrix
from renderers.camera import OPENGL_FROM_OPTICAL, Camera
from renderers.drawlist import Light, LightKind, Material, Mesh, Topology
from renderers.stop import check_stop

GENERATOR: Final = "Scenegate"
"""``asset.generator`` of the files. Our reader takes only files of Drake's generators as Z-up."""
_MODES: Final = {Topology.POINTS: 0, Topology.LINES: 1, Topology.TRIANGLES: 4}
"""``primitive.mode`` by topology."""


def export_glb(root: Node, *, camera: Camera | None = None, max_bytes: int = MAX_BYTES) -> bytes:
    """Return a committed tree, Z up, as a ``.glb`` file with at most one camera.

    Its principal point is lost: glTF puts it into the centre. Raises FileTooLargeError if the binary part would be
    larger than ``max_bytes``.
    """
    return GlbWriter(max_bytes).write(root, camera)


class GlbWriter:
    """Writes one file."""

    def __init__(self, max_bytes: int) -> None:
        self._document = GltfDocument(GENERATOR, max_bytes)
        self._materials = MaterialWriter(self._document)

    def write(self, root: Node, camera: Camera | None) -> bytes:
        json_root: dict[str, Any] = {"name": "Z up to Y up", "matrix": column_major(Y_UP_TO_Z_UP.T)}
        root_index = self._document.add("nodes", json_root)
        self._add_nodes(root, json_root)
        if camera is not None:
            self._add_camera(camera, json_root)
        return self._document.glb(root_index)

    def _add_nodes(self, root: Node, json_root: dict[str, Any]) -> None:
        """Add ``root`` and its descendants below the JSON node ``json_root``."""
        stack: list[tuple[str, Node, dict[str, Any], float]] = [("", root, json_root, 1.0)]
        while stack:
            check_stop()
            name, node, json_parent, parent_opacity = stack.pop()
            opacity = parent_opacity * node.opacity
            if not node.visible or not is_writable(node.matrix):
                continue
            json_node: dict[str, Any] = {"name": name} if name else {}
            if node.matrix is not IDENTITY and not np.array_equal(node.matrix, IDENTITY):
                json_node["matrix"] = column_major(node.matrix)
            index = self._document.add("nodes", json_node)
            json_parent.setdefault("children", []).append(index)
            self._add_geometry(node, json_node, opacity)
            children = reversed(node.children.items())
            stack.extend((str(json_element(key)), child, json_node, opacity) for key, child in children)

    def _add_camera(self, camera: Camera, json_parent: dict[str, Any]) -> None:
        """Add a perspective camera (glTF 2.0, 3.10.3) below a JSON node."""
        perspective = {
            "yfov": 2.0 * math.atan(0.5 * camera.height / camera.fy),
            "aspectRatio": (camera.width / camera.fx) / (camera.height / camera.fy),
            "znear": camera.near,
            **({"zfar": camera.far} if math.isfinite(camera.far) else {}),
        }
        index = self._document.add("cameras", {"type": "perspective", "perspective": perspective})
        pose = camera.X_world_camera @ OPENGL_FROM_OPTICAL
        node = self._document.add("nodes", {"name": "camera", "camera": index, "matrix": column_major(pose)})
        json_parent.setdefault("children", []).append(node)

    def _add_geometry(self, node: Node, json_node: dict[str, Any], opacity: float) -> None:
        """Add a node's meshes and lights. ``json_node`` gets the first mesh without a transform, child nodes others."""
        for part in node.parts or ():
            if isinstance(part.shape, Light) and is_writable(part.X_node_part):
                self._add_light(part.shape, part.X_node_part, json_node)
            for mesh, material, X_part_mesh in meshes_of(part.shape, part.material):
                with np.errstate(all="ignore"):
                    X = part.X_node_part @ X_part_mesh
                if not is_writable(X):
                    continue
                if opacity != 1.0:
                    material = faded(material, opacity)
                index = self._mesh(mesh, material)
                if index is None:
                    continue
                if "mesh" not in json_node and np.array_equal(X, IDENTITY):
                    json_node["mesh"] = index
                    continue
                child: dict[str, Any] = {"mesh": index}
                if not np.array_equal(X, IDENTITY):
                    child["matrix"] = column_major(X)
                json_node.setdefault("children", []).append(self._document.add("nodes", child))

    def _add_light(self, light: Light, X_node_light: Matrix, json_node: dict[str, Any]) -> None:
        """Add a child with a light that shines along its -Z."""
        item: dict[str, Any] = {"type": light.kind.value, "color": light.color, "intensity": light.intensity}
        if light.range is not None:
            item["range"] = light.range
        if light.kind is LightKind.SPOT:
            item["spot"] = {"innerConeAngle": light.inner_cone, "outerConeAngle": light.outer_cone}
        self._document.extensions.add(LIGHTS)
        child = {"extensions": {LIGHTS: {"light": len(self._document.lights)}}, "matrix": column_major(X_node_light)}
        self._document.lights.append(item)
        json_node.setdefault("children", []).append(self._document.add("nodes", child))

    def _mesh(self, mesh: Mesh, material: Material) -> int | None:
        """Return the index of a glTF mesh with one primitive; None if it draws nothing or is not finite."""
        primitive = self._document.get_or_add("primitive", mesh, lambda: self._primitive(mesh))
        if primitive is None:
            return None
        mesh_json = {"primitives": [{**primitive, "material": self._materials.material(material)}]}
        return self._document.get_or_add("mesh", (mesh, material), lambda: self._document.add("meshes", mesh_json))

    def _primitive(self, mesh: Mesh) -> dict[str, Any] | None:
        """Write a mesh's arrays, and return the JSON of its primitive without material; None as for ``_mesh``."""
        if not mesh.elements.size or not np.isfinite(mesh.positions).all():
            return None
        attributes = {"POSITION": self._document.add_accessor(mesh.positions, VERTEX_TARGET, bounds=True)}
        for name, array in (
            ("NORMAL", mesh.normals),
            ("TANGENT", mesh.tangents),
            ("TEXCOORD_0", mesh.uv0),
            ("TEXCOORD_1", mesh.uv1),
            ("COLOR_0", mesh.colors),
        ):
            if array is not None and np.isfinite(array).all():
                attributes[name] = self._document.add_accessor(array, VERTEX_TARGET)
        fits_uint16 = len(mesh.positions) < 0xFFFF  # 0xFFFF itself is the primitive restart value
        indices = mesh.elements.ravel().astype(np.uint16 if fits_uint16 else np.uint32)
        return {
            "attributes": attributes,
            "indices": self._document.add_accessor(indices[:, None], INDEX_TARGET),
            "mode": _MODES[mesh.topology],
        }
