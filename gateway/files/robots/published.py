"""Reads robot files that the client cannot read alone, for ``scenegate.robots``, which finds it by its entry point.

Meshes are sent as triangles, as viewers other than Scenegate require.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any, Final

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.files.robots.reader import read_robot
from gateway.files.robots.robot import Robot
from gateway.scene.draw.meshing import meshes_of
from gateway.scene.tree import geometry as scene
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.materials import mean_color
from gateway.scene.tree.transforms import is_rotation, quaternions_of
from renderers.color import srgb_colors_from_linear, srgb_from_linear
from renderers.drawlist import AlphaMode, Image, ImageError, Light, Material, Mesh, Texture
from renderers.encode import jpeg_rgb, png_pixels, png_rgb
from scenegate.messages.geometry import Geometry, MeshGeometry, PointCloud, Solid, Transform
from scenegate.robots import robot as client

_RIGID_TOLERANCE = 1e-9
"""Maximum deviation of an element of R^T R from the identity, for shapes that are published with a transform."""
MAX_IMAGE_SIDE: Final = 2048
"""Maximum width and height of a published texture, pixels. Larger ones are reduced: a message has at most 256 MiB."""
MAX_PNG_BYTES: Final = 1 << 20
"""Maximum size of the PNG file of an opaque texture. A larger texture, such as a photograph, is sent as JPEG."""
_JPEG_QUALITY: Final = 95


def read_published_robot(path: str | Path, *, textures: bool, **options: Any) -> client.Robot[Geometry]:
    """Read a robot file of any kind; ``options`` are those of ``read_robot``. See ``TreeViewer.robot``."""
    robot = read_robot(path, **options)
    images = PartImages() if textures else None
    parts = tuple(tuple(each for part in link for each in geometries_of(part, images)) for link in robot.parts)
    others = {field.name: getattr(robot, field.name) for field in fields(Robot) if field.name != "parts"}
    if count := sum(isinstance(part.shape, Light) for link in robot.parts for part in link):
        others["warnings"] = (*robot.warnings, f"{count} lights of glTF meshes are left out: only triangles are sent")
    return client.Robot(**others, parts=parts)


def geometries_of(part: Part, images: PartImages | None) -> Iterator[Geometry]:
    """Yield the geometry of a part, in the frame of its node and the colour of its material. Lines are left out.

    ``images`` encodes textures and vertex colours; None: meshes have the mean colour of their texture.
    """
    X, shape = part.X_node_part, part.shape
    if isinstance(shape, scene.PointCloud):
        points = shape.points @ X[:3, :3].T + X[:3, 3]
        yield PointCloud(points, colors=shape.channels.get("rgb"), color=_color(part.material))
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
        yield MeshGeometry(mesh.positions @ X_node_mesh[:3, :3].T + X_node_mesh[:3, 3], faces, color=color, **fields)


def _color(material: Material, *, with_texture: bool = True) -> NDArray[np.float64]:
    """Return a material's sRGB colour and opacity, (4,), times the mean colour of the texture if wanted."""
    red, green, blue, alpha = material.base_color
    if with_texture and material.base_color_texture is not None:
        mean = mean_color(material.base_color_texture.image)
        red, green, blue = (c * m for c, m in zip((red, green, blue), mean, strict=True))
    # colour factors of a file may exceed 1
    return np.clip((srgb_from_linear(red), srgb_from_linear(green), srgb_from_linear(blue), alpha), 0.0, 1.0)


class PartImages:
    """Encodes textures. An image that several parts use is encoded once."""

    def __init__(self) -> None:
        self._encoded: dict[tuple[Image, bool], bytes | None] = {}

    def fields(self, mesh: Mesh, material: Material) -> dict[str, Any]:
        """Return those of the fields ``colors``, ``uv`` and ``image`` for which the mesh and its material have data."""
        fields: dict[str, Any] = {}
        if mesh.colors is not None:
            fields["colors"] = np.clip(srgb_colors_from_linear(mesh.colors), 0.0, 1.0)
        texture = material.base_color_texture
        uv = _texture_coordinates(mesh, texture) if texture is not None else None
        if texture is not None and uv is not None:
            image = self._encode(texture.image, material.alpha_mode is not AlphaMode.OPAQUE)
            if image is not None:
                fields |= {"uv": uv, "image": image}
        return fields

    def _encode(self, image: Image, has_alpha: bool) -> bytes | None:
        """Return a PNG or JPEG file; None if the image cannot be decoded."""
        key = image, has_alpha
        if key not in self._encoded:
            try:
                self._encoded[key] = _encoded_file(image.decode(), has_alpha)
            except ImageError:
                self._encoded[key] = None
        return self._encoded[key]


def _texture_coordinates(mesh: Mesh, texture: Texture) -> NDArray[np.float32] | None:
    """Return the texture's coordinates, (N, 2) float32; None if the mesh has none."""
    uv = mesh.uv1 if texture.uv_set == 1 else mesh.uv0
    if uv is None or texture.uv_transform is None:
        return uv
    a, b, c, d, e, f = texture.uv_transform
    return np.stack((a * uv[:, 0] + b * uv[:, 1] + c, d * uv[:, 0] + e * uv[:, 1] + f), axis=1).astype(np.float32)


def _encoded_file(pixels: NDArray[np.uint8], has_alpha: bool) -> bytes:
    """Return a PNG or JPEG file of (H, W, 3 | 4) uint8 pixels."""
    longest = max(pixels.shape[:2])
    if longest > MAX_IMAGE_SIDE:
        size = [max(1, side * MAX_IMAGE_SIDE // longest) for side in (pixels.shape[1], pixels.shape[0])]
        pixels = np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), np.uint8)
    if has_alpha:
        return png_pixels(np.ascontiguousarray(pixels))
    rgb = np.ascontiguousarray(pixels[..., :3])
    png = png_rgb(rgb)
    return png if len(png) <= MAX_PNG_BYTES else jpeg_rgb(rgb, quality=_JPEG_QUALITY)
