"""Replaces materials of trees by drawn ones, with texture coordinates for meshes that have none."""

from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from gateway.datasets.scenario.choices import MaterialChoice
from gateway.scene.draw.meshing import meshes_of
from gateway.scene.tree.geometry import Part, Surface
from gateway.scene.tree.nodes import Node
from renderers.cache import Cache
from renderers.color import linear_from_srgb
from renderers.drawlist import Image, Material, Mesh, Texture, Topology, name_image_errors
from renderers.images import image_from_bytes
from scenegate.regular_files import read_regular

MAX_IMAGE_BYTES: Final = 64 << 20
"""Maximum size of an image file of a scenario."""
_images: Final[Cache[tuple[Path, int, int], Image]] = Cache("scenario_images")
_mapped: Final[Cache[tuple[Mesh, tuple[float, ...], float], Mesh]] = Cache("scenario_mapped_meshes")


def read_image(path: Path) -> Image:
    """Return the image in a file, cached while it has not changed. Raises OSError or ImageError with its name."""
    status = path.stat()
    key = (path, status.st_mtime_ns, status.st_size)
    image = _images.get(key)
    if image is None:
        data = read_regular(path, MAX_IMAGE_BYTES)
        with name_image_errors(str(path)):
            image = image_from_bytes(data)
        _images.put(key, image, len(data))
    return image


def material_of(choice: MaterialChoice, folder: Path) -> Material:
    """Return the material of a choice, whose texture is in a folder; raises as ``read_image`` does."""
    red, green, blue = map(linear_from_srgb, choice.color)
    texture = None
    if choice.texture:
        texture = Texture(read_image(folder / choice.texture), name=choice.texture)
    return Material(
        base_color=(red, green, blue, 1.0),
        base_color_texture=texture,
        metallic=choice.metallic,
        roughness=choice.roughness,
        double_sided=True,
    )


def with_material(root: Node, material: Material | None, texture_size: float | None, scale: float = 1.0) -> Node:
    """Return a tree with another material on all triangles; None: its own, so that equal models have equal meshes.

    ``texture_size``: side of a texture in metres, for meshes without texture coordinates; None: they stay. ``scale``:
    that of the tree in the world.
    """
    parts = root.parts
    if parts is not None:
        size_in_tree = None if texture_size is None else texture_size / scale
        parts = tuple(mesh_part for part in parts for mesh_part in _mesh_parts(part, material, size_in_tree))
    children = {name: with_material(child, material, texture_size, scale) for name, child in root.children.items()}
    node = Node(parts, root.matrix, children)
    node.visible, node.opacity = root.visible, root.opacity
    return node


def _mesh_parts(part: Part, material: Material | None, texture_size: float | None) -> list[Part]:
    """Return the meshes of a part with the material; those without triangles keep theirs."""
    parts: list[Part] = []
    for mesh, own_material, X_part_mesh in meshes_of(part.shape, part.material):
        X_node_mesh = part.X_node_part @ X_part_mesh
        has_triangles = mesh.topology is Topology.TRIANGLES
        if has_triangles and mesh.uv0 is None and texture_size is not None:
            scale = tuple(np.linalg.norm(X_node_mesh[:3, :3], axis=0).tolist())
            mesh = _box_mapped(mesh, scale, texture_size)
        new_material = material if has_triangles and material is not None else own_material
        parts.append(msgspec.structs.replace(part, shape=Surface(mesh), material=new_material, X_node_part=X_node_mesh))
    return parts


def _box_mapped(mesh: Mesh, scale: tuple[float, ...], texture_size: float) -> Mesh:
    """Return a mesh with texture coordinates: each triangle sees the texture along the axis that it faces most.

    ``scale`` is that of the mesh along its axes, and ``texture_size`` the side of the texture in metres.
    """
    key = (mesh, scale, texture_size)
    mapped = _mapped.get(key)
    if mapped is None:
        vertices = mesh.elements.reshape(-1)
        corners = mesh.positions[vertices].reshape(-1, 3, 3) * np.array(scale, np.float32)  # (triangle, corner, axis)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        facing_axis = np.abs(normals).argmax(axis=1)
        u_and_v_axes = np.array(((1, 2), (0, 2), (0, 1)))[facing_axis]
        uv = np.take_along_axis(corners, u_and_v_axes[:, None, :], axis=2).reshape(-1, 2) / texture_size
        mapped = Mesh(
            np.ascontiguousarray(mesh.positions[vertices]),
            np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3),
            normals=None if mesh.normals is None else np.ascontiguousarray(mesh.normals[vertices]),
            uv0=np.ascontiguousarray(uv * (1.0, -1.0), np.float32),
            colors=None if mesh.colors is None else np.ascontiguousarray(mesh.colors[vertices]),
        )
        _mapped.put(key, mapped, mapped.nbytes)
    return mapped
