"""Texture coordinates of meshes with drawn materials."""

import numpy as np

from gateway.datasets.scenario.drawn_materials import with_material
from gateway.scene.tree.geometry import Part, Surface
from gateway.scene.tree.nodes import Node
from renderers.drawlist import Material, Mesh

SQUARE = np.array([(0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1)], np.float32)
FACES = np.array([(0, 1, 2), (0, 2, 3)], np.uint32)
PAINT = Material((0.5, 0.25, 0.125, 1.0))


def drawn(mesh: Mesh) -> Part:
    """Return the part of a mesh with a texture of 0.5 m, in a world that is as large as the tree."""
    parts = with_material(Node((Part(Surface(mesh), Material()),), np.eye(4)), PAINT, 0.5).parts
    assert parts is not None
    return parts[0]


def test_meshes_without_texture_coordinates_are_mapped_in_metres() -> None:
    part = drawn(Mesh(SQUARE, FACES))
    assert part.material is PAINT
    assert isinstance(part.shape, Surface)
    mesh = part.shape.mesh
    assert mesh.uv0 is not None
    np.testing.assert_allclose(mesh.uv0, mesh.positions[:, :2] / 0.5 * (1.0, -1.0), atol=1e-6)


def test_texture_coordinates_of_a_mesh_stay() -> None:
    uv = np.full((4, 2), 0.25, np.float32)
    part = drawn(Mesh(SQUARE, FACES, uv0=uv))
    assert isinstance(part.shape, Surface)
    assert part.shape.mesh.uv0 is uv
