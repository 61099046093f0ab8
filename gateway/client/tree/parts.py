"""Converts parts of a scene to geometry of the tree viewer's protocol, which has no textures and no vertex colours.

Unlike the other modules of this package, it imports the server's scene and renderer.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from gateway.client.tree.geometry import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    Geometry,
    Mesh,
    PointCloud,
    Sphere,
    Transform,
)
from gateway.scene import geometry as scene
from gateway.scene.geometry import Part
from gateway.scene.meshing import meshes_of
from gateway.scene.transforms import quaternions_of
from renderers.color import linear_from_srgb, srgb_from_linear
from renderers.drawlist import ImageError, Material

_RIGID_TOLERANCE = 1e-9
"""Maximum deviation of an element of R^T R from the identity, for shapes that are published with a transform."""


def has_textures(part: Part) -> bool:
    """Return True if a part has a texture or vertex colours, which are not published."""
    colored = isinstance(part.shape, scene.Surface) and part.shape.mesh.colors is not None
    return colored or part.material.base_color_texture is not None


def geometries_of(part: Part) -> Iterator[Geometry]:
    """Yield the geometry of a part, in the frame of its node and the colour of its material."""
    X, color, shape = part.X_node_part, _color(part.material), part.shape
    if isinstance(shape, scene.PointCloud):
        points = shape.points @ X[:3, :3].T + X[:3, 3]
        yield PointCloud(points, rgb=shape.channels.get("rgb"), color=color)
        return
    primitive = _primitive(shape, X, color)
    if primitive is not None:
        yield primitive
        return
    for mesh, _, X_part_mesh in meshes_of(shape, part.material):
        if mesh.elements.shape[1] != 3:
            continue
        X_node_mesh = X @ X_part_mesh
        mirrored = np.linalg.det(X_node_mesh[:3, :3]) < 0
        faces = mesh.elements[:, ::-1] if mirrored else mesh.elements
        yield Mesh(mesh.positions @ X_node_mesh[:3, :3].T + X_node_mesh[:3, 3], faces, color=color)


def _primitive(shape: scene.Shape, X: NDArray[np.float64], color: NDArray[np.float64]) -> Geometry | None:
    """Return a shape that the protocol has, too; None for another one, or with a scale or shear."""
    R = X[:3, :3]
    if not np.allclose(R.T @ R, np.eye(3), rtol=0.0, atol=_RIGID_TOLERANCE) or np.linalg.det(R) < 0.0:
        return None
    transform = Transform(X[:3, 3].tolist(), quaternions_of(R[None])[0].tolist())
    if isinstance(shape, scene.Box):
        return Box(shape.lengths, color=color, transform=transform)
    if isinstance(shape, scene.Sphere):
        return Sphere(shape.radius, color=color, transform=transform)
    if isinstance(shape, scene.Ellipsoid):
        return Ellipsoid(shape.radii, color=color, transform=transform)
    if isinstance(shape, scene.Capsule):
        return Capsule(shape.radius, shape.length, color=color, transform=transform)
    if isinstance(shape, scene.Cylinder):
        return Cylinder(shape.radius, shape.length, color=color, transform=transform)
    return None


def _color(material: Material) -> NDArray[np.float64]:
    """Return a material's sRGB colour and opacity, (4,); with a texture, its mean colour."""
    red, green, blue, alpha = material.base_color
    if material.base_color_texture is not None:
        try:
            pixels = material.base_color_texture.image.decode()[..., :3].reshape(-1, 3)
        except ImageError:
            pixels = np.full((1, 3), 255, np.uint8)
        mean = pixels.mean(axis=0) / 255.0
        red, green, blue = (c * linear_from_srgb(m) for c, m in zip((red, green, blue), mean.tolist(), strict=True))
    # colour factors of a file may exceed 1
    return np.clip((srgb_from_linear(red), srgb_from_linear(green), srgb_from_linear(blue), alpha), 0.0, 1.0)
