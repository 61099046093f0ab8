"""Read the geometry types that Scenegate adds to Director's: images, heightmaps, text, camera frustums, and meshes
with textures or vertex colours.

``geometry`` calls these readers. Each returns parts of the scene, in metres in the geometry's frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.scene.crease_normals import smooth_vertices, with_creases
from gateway.scene.fonts import font_for
from gateway.scene.geometry import Part, Surface
from gateway.scene.image_meshes import frustum_edges, heightmap_mesh, rectangle
from gateway.scene.materials import Color, material, textured
from gateway.scene.text_images import text_image
from gateway.scene.transforms import translation
from gateway.treeviewer import fields
from gateway.treeviewer.array_geometry import MAX_DISTANCE_F32, per_vertex, triangles, vertex_colors
from gateway.treeviewer.context import ReadContext
from gateway.treeviewer.fields import CommandError, show
from gateway.treeviewer.images import CheckedImage, drawn_image, read_image
from gateway.treeviewer.packed_arrays import ArrayError
from renderers.drawlist import AlphaMode, Material, Mesh

MAX_UV: Final = np.float32(1e4)
"""Texture coordinates beyond this are clamped: float32 still resolves a thousandth of the image there."""

Params = Mapping[str, Any]
"""Fields of a decoded geometry, by name."""


def mesh(params: Params, rgba: Color, context: ReadContext) -> tuple[Part, ...]:
    """Return a triangle mesh with vertex colours, a texture, or both. Each of them multiplies ``rgba``."""
    vertices, faces = triangles(params, context)
    colors = vertex_colors(params, len(vertices), context)
    checked = read_image(params, context)
    uv = None
    if checked is not None:
        if params.get("uv") is None:
            raise CommandError("uv is missing, which an image needs")
        uv = per_vertex(params, "uv", (2,), len(vertices), context)
        uv = np.clip(np.nan_to_num(uv), -MAX_UV, MAX_UV)
    if not len(faces):
        return ()
    return (Part(Surface(_smooth_mesh(vertices, faces, uv, colors)), _material(rgba, checked, colors)),)


def _smooth_mesh(
    vertices: NDArray[np.float32],
    faces: NDArray[np.uint32],
    uv: NDArray[np.float32] | None,
    colors: NDArray[np.float32] | None,
) -> Mesh:
    """Return a mesh with smooth normals and creases.

    With ``uv``, vertices at equal positions are merged, so that normals are smooth across the seams of the texture.
    Other meshes, as in ``mesh_data``, are smooth only where faces share a vertex: merging takes five times as long.

    Args:
        vertices: (N, 3) metres.
        faces: (M, 3) indices.
        uv: (N, 2) texture coordinates or None.
        colors: (N, 4) linear RGBA or None.
    """
    if uv is not None:
        return with_creases(vertices, faces, uv=uv, colors=colors)
    source_vertex, smooth_faces, normals = smooth_vertices(vertices, faces)
    colors = None if colors is None else colors[source_vertex]
    return Mesh(vertices[source_vertex], smooth_faces, normals, colors=colors)


def image(params: Params, rgba: Color, context: ReadContext) -> tuple[Part, ...]:
    """Return an image on a rectangle in the plane z = 0. It is not lit."""
    checked = _required_image(params, context)
    return (Part(Surface(rectangle(*_image_size(params, checked))), _unlit(rgba, checked)),)


def heightmap(params: Params, rgba: Color, context: ReadContext) -> tuple[Part, ...]:
    """Return a surface z(x, y) over a rectangle, with vertex colours, a texture, or both."""
    if params.get("heights") is None:
        raise CommandError("heights is missing")
    try:
        heights = context.arrays.grid(params["heights"], context.limits.heights)
    except ArrayError as error:
        raise CommandError(f"heights {error}") from None
    if min(heights.shape) < 2:
        raise CommandError(f"heights has {heights.shape[0]} rows of {heights.shape[1]} numbers, 2 rows of 2 are needed")
    x, y = (fields.drawable(value, "lengths") for value in fields.numbers(params.get("lengths"), "lengths", 2))
    if min(x, y) <= 0.0:
        raise CommandError(f"lengths must be above 0, not {min(x, y):g}")
    colors = vertex_colors(params, heights.size, context)
    checked = read_image(params, context)
    undrawable = int((~(np.abs(heights) <= MAX_DISTANCE_F32)).sum())
    if undrawable:
        heights[~(np.abs(heights) <= MAX_DISTANCE_F32)] = np.nan
        context.warnings.append(f"{undrawable} heights are not finite; the surface has holes there")
    surface = heightmap_mesh(heights, (x, y), colors)
    return () if surface is None else (Part(Surface(surface), _material(rgba, checked, colors, repeats=False)),)


def text(params: Params, rgba: Color, context: ReadContext) -> tuple[Part, ...]:
    """Return text on a rectangle in the plane z = 0. It is not lit."""
    value = params.get("text")
    if not isinstance(value, str):
        raise CommandError("text is missing" if value is None else f"text must be a string, not {show(value)}")
    if len(value) > context.limits.text_chars:
        raise CommandError(f"text has {len(value)} characters, the limit is {context.limits.text_chars}")
    context.text_labels += 1
    if context.text_labels > context.limits.text_labels:
        raise CommandError(
            f"text is label {context.text_labels} of the request, the limit is {context.limits.text_labels}"
        )
    line_height = 0.1 if params.get("size") is None else fields.positive(params, "size")
    background = fields.color(params, context.warnings, "background", (0.0, 0.0, 0.0, 0.0))
    printable = "".join(char if char.isprintable() or char == "\n" else " " for char in value)
    if not printable.strip():
        raise fields.NothingToDraw("text is empty, so nothing is drawn")
    font = font_for(printable)
    if font.missing:
        context.warnings.append(f"no font has the characters {show(font.missing)}; boxes stand for them")
    pixels, lines = text_image(printable, font, rgba, background)
    checked = drawn_image(pixels)
    height = line_height * lines
    width = fields.drawable(height * checked.width / checked.height, "size")
    label_rectangle = rectangle(width, fields.drawable(height, "size"))
    return (Part(Surface(label_rectangle), _unlit((1.0, 1.0, 1.0, 1.0), checked)),)


def camera_frustum(params: Params, rgba: Color, context: ReadContext) -> tuple[Part, ...]:
    """Return the edges of a camera's frustum in its optical frame, and its image, if any, on the image plane."""
    width, height = fields.positive(params, "width"), fields.positive(params, "height")
    fx = fields.positive(params, "fx")
    fy = fx if params.get("fy") is None else fields.positive(params, "fy")
    cx = width / 2.0 if params.get("cx") is None else fields.required(params, "cx")
    cy = height / 2.0 if params.get("cy") is None else fields.required(params, "cy")
    depth = 0.3 if params.get("depth") is None else fields.positive(params, "depth")
    checked = read_image(params, context)
    edges, corners = frustum_edges(width, height, (fx, fy), (cx, cy), depth)
    if not (np.abs(corners) <= fields.MAX_DISTANCE).all():
        raise fields.NothingToDraw("the image plane is too large, so nothing is drawn")
    lines = material(rgba, line_width=fields.pixels(params, "line_width", 1.0))
    parts = [Part(Surface(edges), lines)]
    if checked is not None:
        parts.append(_image_plane(corners, _unlit((1.0, 1.0, 1.0, rgba[3]), checked)))
    return tuple(parts)


def _image_plane(corners: NDArray[np.float64], plane_material: Material) -> Part:
    """Return the rectangle of a frustum's image plane.

    Args:
        corners: (4, 3) metres in the optical frame, as ``frustum_edges`` returns them.
        plane_material: material with the image.
    """
    extent = corners[2] - corners[0]
    X_camera_image = translation(*(0.5 * (corners[0] + corners[2])).tolist())
    X_camera_image[1, 1] = X_camera_image[2, 2] = -1.0  # +y is down in the optical frame
    return Part(Surface(rectangle(float(extent[0]), float(extent[1]))), plane_material, X_camera_image)


def _required_image(params: Params, context: ReadContext) -> CheckedImage:
    checked = read_image(params, context)
    if checked is None:
        raise CommandError("image is missing")
    return checked


def _image_size(params: Params, checked: CheckedImage) -> tuple[float, float]:
    """Return width and height of an image plane in metres. A missing one is computed for square pixels.

    Raises:
        CommandError: both are missing, or one is not a positive number.
        NothingToDraw: the computed one is too large.
    """
    has_width, has_height = params.get("width") is not None, params.get("height") is not None
    if not has_width and not has_height:
        raise CommandError("width or height is missing")
    width = fields.positive(params, "width") if has_width else None
    height = fields.positive(params, "height") if has_height else None
    if width is None:
        assert height is not None
        return fields.drawable(height * checked.width / checked.height, "width"), height
    if height is None:
        height = fields.drawable(width * checked.height / checked.width, "height")
    return width, height


def _unlit(rgba: Color, checked: CheckedImage) -> Material:
    return textured(rgba, checked.image, has_alpha=checked.has_alpha, repeats=False, unlit=True)


def _material(
    rgba: Color, checked: CheckedImage | None, colors: NDArray[np.float32] | None, *, repeats: bool = True
) -> Material:
    """Return the material of a lit surface.

    Args:
        rgba: colour that multiplies the texture and the vertex colours.
        checked: texture; None: none.
        colors: (N, 4) vertex colours; None: none.
        repeats: True if the texture repeats outside of 0 to 1.
    """
    has_alpha = colors is not None and bool((colors[:, 3] < 1.0).any())
    if checked is not None:
        result = textured(rgba, checked.image, has_alpha=has_alpha or checked.has_alpha, repeats=repeats)
    else:
        result = material(rgba)
        result = replace(result, alpha_mode=AlphaMode.BLEND) if has_alpha else result
    return result if colors is None else replace(result, decodes_vertex_colors=False)
