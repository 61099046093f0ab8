"""Converts parts of a scene to geometry of the tree viewer's protocol.

Unlike the other modules of this package, it imports the server's scene and renderer.
"""

from __future__ import annotations

from collections.abc import Iterator

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.robots.part_images import PartImages
from gateway.scene import geometry as scene
from gateway.scene.geometry import Part
from gateway.scene.materials import mean_color
from gateway.scene.meshing import meshes_of
from gateway.scene.transforms import is_rotation, quaternions_of
from renderers.color import srgb_from_linear
from renderers.drawlist import Material
from scenegate.messages.geometry import Geometry, Mesh, PointCloud, Solid, Transform

_RIGID_TOLERANCE = 1e-9
"""Maximum deviation of an element of R^T R from the identity, for shapes that are published with a transform."""


def geometries_of(part: Part, images: PartImages | None) -> Iterator[Geometry]:
    """Yield the geometry of a part, in the frame of its node and the colour of its material. Lines are left out.

    Args:
        images: Encodes textures and vertex colours of meshes; None: meshes have the mean colour of their texture.
    """
    X, shape = part.X_node_part, part.shape
    if isinstance(shape, scene.PointCloud):
        points = shape.points @ X[:3, :3].T + X[:3, 3]
        yield PointCloud(points, rgb=shape.channels.get("rgb"), color=_color(part.material))
        return
    if isinstance(shape, Solid) and is_rotation(X[:3, :3], _RIGID_TOLERANCE):
        transform = Transform(X[:3, 3].tolist(), quaternions_of(X[None, :3, :3])[0].tolist())
        yield msgspec.structs.replace(shape, color=_color(part.material), transform=transform)
        return
    for mesh, _, X_part_mesh in meshes_of(shape, part.material):
        if mesh.elements.shape[1] != 3:
            continue
        X_node_mesh = X @ X_part_mesh
        mirrored = np.linalg.det(X_node_mesh[:3, :3]) < 0
        faces = mesh.elements[:, ::-1] if mirrored else mesh.elements
        fields = {} if images is None else images.fields(mesh, part.material)
        color = _color(part.material, with_texture="image" not in fields)
        yield Mesh(mesh.positions @ X_node_mesh[:3, :3].T + X_node_mesh[:3, 3], faces, color=color, **fields)


def _color(material: Material, *, with_texture: bool = True) -> NDArray[np.float64]:
    """Return a material's sRGB colour and opacity, (4,).

    Args:
        with_texture: True: multiply the colour by the mean colour of the texture.
    """
    red, green, blue, alpha = material.base_color
    if with_texture and material.base_color_texture is not None:
        mean = mean_color(material.base_color_texture.image)
        red, green, blue = (c * m for c, m in zip((red, green, blue), mean, strict=True))
    # colour factors of a file may exceed 1
    return np.clip((srgb_from_linear(red), srgb_from_linear(green), srgb_from_linear(blue), alpha), 0.0, 1.0)
