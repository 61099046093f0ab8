"""Convert parts, draws and materials to those of messages."""

from typing import Any, Final

import msgspec
import numpy as np

from gateway.adapters.viewer import messages
from gateway.adapters.viewer.resources import Resources
from gateway.scene.draw.meshing import meshes_of
from gateway.scene.tree.geometry import Part, PointCloud
from renderers.color import srgb_from_linear
from renderers.drawlist import AlphaMode, Material, Texture

_IDENTITY: Final = np.eye(4)
_MATERIAL_DEFAULTS: Final = {each.name: each.default for each in msgspec.structs.fields(messages.PageMaterial)}
_ALPHA: Final = {AlphaMode.OPAQUE: None, AlphaMode.MASK: "mask", AlphaMode.BLEND: "blend"}


def part_message(part: Part, resources: Resources) -> messages.PagePart:
    """Return a part with its draws: meshes with a material and a matrix."""
    draws: list[messages.Draw] = []
    for mesh, material, X_part_mesh in meshes_of(part.shape, part.material):
        draw = messages.Draw(mesh=resources.mesh_id(mesh), material=_material_message(material, resources))
        matrix = part.X_node_part @ X_part_mesh
        if not np.array_equal(matrix, _IDENTITY):
            # JSON has no infinity or NaN, so the matrix is null. Like the rasterizer, the page does not draw the mesh.
            draw.matrix = matrix.T.ravel().tolist() if np.isfinite(matrix).all() else None
        draws.append(draw)
    kind = part.kind or type(part.shape).__name__.lower()
    message = messages.PagePart(kind=kind, draws=draws, source=part.source or "", faces_camera=part.kind == "text")
    if isinstance(part.shape, PointCloud):
        for draw in draws:
            resources.clouds[draw.mesh] = part.shape
        message.points = len(part.shape.points)
        message.channels = _channel_widths(part.shape)
    return message


def _channel_widths(cloud: PointCloud) -> dict[str, int]:
    """Return the number of values per point of each channel. Channels without a row for every point are left out."""
    point_count = len(cloud.points)
    return {
        name: values.size // point_count
        for name, values in cloud.channels.items()
        if point_count and values.ndim <= 2 and len(values) == point_count and values.size
    }


def _material_message(material: Material, resources: Resources) -> messages.PageMaterial:
    fields: dict[str, Any] = {
        "alpha": _ALPHA[material.alpha_mode],
        "cutoff": material.alpha_cutoff if material.alpha_mode is AlphaMode.MASK else 0.5,
        "metallic": material.metallic,
        "roughness": material.roughness,
        "emissive": tuple(map(srgb_from_linear, material.emissive)),
        "double_sided": material.double_sided,
        "unlit": material.unlit,
        "point_size": material.point_size,
        "line_width": material.line_width,
        "casts_shadow": material.casts_shadow,
        "texture": _texture_message(material.base_color_texture, resources),
        "metallic_roughness_texture": _texture_message(material.metallic_roughness_texture, resources),
        "normal_texture": _texture_message(material.normal_texture, resources),
        "normal_scale": material.normal_scale,
        "occlusion_texture": _texture_message(material.occlusion_texture, resources),
        "occlusion_strength": material.occlusion_strength,
        "emissive_texture": _texture_message(material.emissive_texture, resources),
        "emissive_strength": material.emissive_strength,
    }
    # Equal numbers are different objects: msgspec leaves out a default only if it is the same object.
    changed = {name: value for name, value in fields.items() if value != _MATERIAL_DEFAULTS[name]}
    red, green, blue = map(srgb_from_linear, material.base_color[:3])
    return messages.PageMaterial(color=(red, green, blue, material.base_color[3]), **changed)


def _texture_message(texture: Texture | None, resources: Resources) -> messages.TextureUse | None:
    if texture is None:
        return None
    return messages.TextureUse(
        image=resources.image_id(texture.image),
        wrap=(texture.sampler.wrap_s.value, texture.sampler.wrap_t.value),
        linear=texture.sampler.mag_linear,
        set=texture.uv_set or msgspec.UNSET,
        transform=texture.uv_transform,
    )
