"""Convert parts, draws and materials to JSON, for the header of an update."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from gateway.scene.geometry import Part, PointCloud
from gateway.scene.meshing import meshes_of
from gateway.viewer.resources import Resources
from renderers.color import srgb_from_linear
from renderers.drawlist import AlphaMode, Material, Texture

_IDENTITY: Final = np.eye(4)


def part_json(part: Part, resources: Resources) -> dict[str, Any]:
    """Return a part's kind, draws and, if it has one, source.

    A draw is a mesh with a material and a matrix. A point cloud also has ``points`` and ``channels``. Text has
    ``facesCamera``: the page turns it towards the camera.
    """
    draws: list[dict[str, Any]] = []
    for mesh, material, X_part_mesh in meshes_of(part.shape, part.material):
        draw: dict[str, Any] = {"mesh": resources.mesh_id(mesh), "material": _material_json(material, resources)}
        matrix = part.X_node_part @ X_part_mesh
        if not np.array_equal(matrix, _IDENTITY):
            # JSON has no infinity or NaN, so the matrix is null. Like the rasterizer, the page does not draw the mesh.
            draw["matrix"] = matrix.T.ravel().tolist() if np.isfinite(matrix).all() else None
        draws.append(draw)
    fields: dict[str, Any] = {"kind": part.kind or type(part.shape).__name__.lower(), "draws": draws}
    if isinstance(part.shape, PointCloud):
        for draw in draws:
            resources.add_cloud(draw["mesh"], part.shape)
        fields["points"] = len(part.shape.points)
        fields["channels"] = _channel_widths(part.shape)
    if part.source:
        fields["source"] = part.source
    if part.kind == "text":
        fields["facesCamera"] = True
    return fields


def _channel_widths(cloud: PointCloud) -> dict[str, int]:
    """Return the number of values per point of each channel. Channels without a row for every point are left out."""
    point_count = len(cloud.points)
    return {
        name: values.size // point_count
        for name, values in cloud.channels.items()
        if point_count and values.ndim <= 2 and len(values) == point_count and values.size
    }


def _material_json(material: Material, resources: Resources) -> dict[str, Any]:
    """Return a material's colour, and the properties that differ from the page's defaults. Colours are in sRGB."""
    fields: dict[str, Any] = {"color": [*map(srgb_from_linear, material.base_color[:3]), material.base_color[3]]}
    if material.alpha_mode is not AlphaMode.OPAQUE:
        fields["alpha"] = material.alpha_mode.value.lower()
    if material.alpha_mode is AlphaMode.MASK and material.alpha_cutoff != 0.5:
        fields["cutoff"] = material.alpha_cutoff
    optional = (
        ("metallic", material.metallic, 0.0),
        ("roughness", material.roughness, 1.0),
        ("emissive", tuple(map(srgb_from_linear, material.emissive)), (0.0, 0.0, 0.0)),
        ("doubleSided", material.double_sided, False),
        ("unlit", material.unlit, False),
        ("pointSize", material.point_size, 1.0),
        ("lineWidth", material.line_width, 1.0),
        ("normalScale", material.normal_scale, 1.0),
        ("occlusionStrength", material.occlusion_strength, 1.0),
        ("emissiveStrength", material.emissive_strength, 1.0),
    )
    fields.update({name: value for name, value, default in optional if value != default})
    textures = (
        ("texture", material.base_color_texture),
        ("metallicRoughnessTexture", material.metallic_roughness_texture),
        ("normalTexture", material.normal_texture),
        ("occlusionTexture", material.occlusion_texture),
        ("emissiveTexture", material.emissive_texture),
    )
    fields.update({name: _texture_json(texture, resources) for name, texture in textures if texture is not None})
    return fields


def _texture_json(texture: Texture, resources: Resources) -> dict[str, Any]:
    """Return a texture's image id, wrap modes, filter, texture coordinate set and transform."""
    fields: dict[str, Any] = {
        "image": resources.image_id(texture.image),
        "wrap": [texture.sampler.wrap_s.value, texture.sampler.wrap_t.value],
        "linear": texture.sampler.mag_linear,
    }
    if texture.uv_set:
        fields["set"] = texture.uv_set
    if texture.uv_transform is not None:
        fields["transform"] = texture.uv_transform
    return fields
