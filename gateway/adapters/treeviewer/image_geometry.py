"""Make parts of the geometry types that Scenegate adds to Director's: images, heightmaps, text, camera frustums, and
meshes with textures or vertex colours. ``geometry_reader`` calls these functions.
"""

from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.treeviewer.array_geometry import (
    MAX_DISTANCE_F32,
    check_row_count,
    drawable_triangles,
    vertex_colors,
)
from gateway.adapters.treeviewer.context import ReadContext
from gateway.adapters.treeviewer.images import CheckedImage, drawn_image
from gateway.scene.draw.crease_normals import smooth_vertices, with_creases
from gateway.scene.draw.fonts import font_for, text_image
from gateway.scene.draw.image_meshes import frustum_edges, heightmap_mesh, rectangle
from gateway.scene.tree.geometry import Part, Surface
from gateway.scene.tree.materials import WHITE, Color, material, textured
from gateway.scene.tree.transforms import translation
from renderers.drawlist import AlphaMode, Material, Mesh
from scenegate.messages.field_kinds import MAX_DISTANCE, CommandError, NothingToDraw, drawable, show
from scenegate.warning_text import NOTHING_DRAWN

MAX_UV: Final = np.float32(1e4)
"""Texture coordinates beyond this are clamped: float32 still resolves a thousandth of the image there."""


def mesh(
    rgba: Color,
    context: ReadContext,
    *,
    vertices: NDArray[np.float32],
    faces: Any,
    colors: NDArray[np.float32] | None,
    uv: Any,
    image: CheckedImage | None,
) -> tuple[Part, ...]:
    """Return a triangle mesh with vertex colours, a texture, or both. Each of them multiplies ``rgba``."""
    triangle_indices = drawable_triangles(vertices, faces, context)
    linear_colors = vertex_colors(colors, len(vertices))
    coordinates = None
    if image is not None:
        if uv is None:
            raise CommandError("uv is missing, which an image needs")
        coordinates = context.rows(uv, "uv", (2,), "vertices")
        check_row_count("uv", coordinates, len(vertices))
        coordinates = np.clip(np.nan_to_num(coordinates), -MAX_UV, MAX_UV)
    if not len(triangle_indices):
        return ()
    if coordinates is not None:  # vertices at equal positions are merged: normals are smooth across a texture's seams
        smooth = with_creases(vertices, triangle_indices, uv=coordinates, colors=linear_colors)
    else:  # as in ``mesh_data``: smooth where faces share a vertex
        source_vertex, smooth_faces, normals = smooth_vertices(vertices, triangle_indices)
        source_colors = None if linear_colors is None else linear_colors[source_vertex]
        smooth = Mesh(vertices[source_vertex], smooth_faces, normals, colors=source_colors)
    return (Part(Surface(smooth), _material(rgba, image, linear_colors)),)


def image(
    rgba: Color, _: ReadContext, *, image: CheckedImage, width: float | None, height: float | None
) -> tuple[Part, ...]:
    """Return an image on a rectangle in the plane z = 0, not lit. A missing extent is computed for square pixels."""
    if width is None and height is None:
        raise CommandError("width or height is missing")
    if width is None:
        assert height is not None
        width = drawable(height * image.width / image.height, "width")
    elif height is None:
        height = drawable(width * image.height / image.width, "height")
    return (Part(Surface(rectangle(width, height)), _unlit(rgba, image)),)


def heightmap(
    rgba: Color,
    context: ReadContext,
    *,
    heights: NDArray[np.float32],
    lengths: tuple[float, float],
    colors: NDArray[np.float32] | None,
    image: CheckedImage | None,
) -> tuple[Part, ...]:
    """Return a surface z(x, y) over a rectangle, with vertex colours, a texture, or both."""
    if min(heights.shape) < 2:
        raise CommandError(f"heights has {heights.shape[0]} rows of {heights.shape[1]} numbers, 2 rows of 2 are needed")
    linear_colors = vertex_colors(colors, heights.size)
    undrawable = ~(np.abs(heights) <= MAX_DISTANCE_F32)
    if undrawable.any():
        heights[undrawable] = np.nan
        context.warnings.append(f"{int(undrawable.sum())} heights are not finite; the surface has holes there")
    surface = heightmap_mesh(heights, lengths, linear_colors)
    return () if surface is None else (Part(Surface(surface), _material(rgba, image, linear_colors, repeats=False)),)


def text(rgba: Color, context: ReadContext, *, text: str, size: float, background: Color | None) -> tuple[Part, ...]:
    """Return text on a rectangle in the plane z = 0. It is not lit. ``size`` is the height of a line."""
    printable = "".join(char if char.isprintable() or char == "\n" else " " for char in text)
    if not printable.strip():
        raise NothingToDraw(f"text is empty, {NOTHING_DRAWN}")
    font = font_for(printable)
    if font.missing:
        context.warnings.append(f"no font has the characters {show(font.missing)}; boxes stand for them")
    pixels, lines = text_image(printable, font, rgba, background or (0.0, 0.0, 0.0, 0.0))
    checked = drawn_image(pixels)
    height = size * lines
    width = drawable(height * checked.width / checked.height, "size")
    label_rectangle = rectangle(width, drawable(height, "size"))
    return (Part(Surface(label_rectangle), _unlit(WHITE, checked)),)


def camera_frustum(
    rgba: Color,
    _: ReadContext,
    *,
    width: float,
    height: float,
    fx: float,
    fy: float | None,
    cx: float | None,
    cy: float | None,
    depth: float,
    image: CheckedImage | None,
    line_width: float | None,
) -> tuple[Part, ...]:
    """Return the edges of a camera's frustum in its optical frame, and its image, if any, on the image plane."""
    focal_lengths = (fx, fx if fy is None else fy)
    principal_point = (width / 2.0 if cx is None else cx, height / 2.0 if cy is None else cy)
    edges, corners = frustum_edges(width, height, focal_lengths, principal_point, depth)
    if not (np.abs(corners) <= MAX_DISTANCE).all():
        raise NothingToDraw(f"the image plane is too large, {NOTHING_DRAWN}")
    parts = [Part(Surface(edges), material(rgba, line_width=line_width or 1.0))]
    if image is not None:
        plane_width, plane_height, _ = (corners[2] - corners[0]).tolist()
        X_camera_image = translation(*(0.5 * (corners[0] + corners[2])).tolist())
        X_camera_image[1, 1] = X_camera_image[2, 2] = -1.0  # +y is down in the optical frame
        plane = Surface(rectangle(plane_width, plane_height))
        parts.append(Part(plane, _unlit((1.0, 1.0, 1.0, rgba[3]), image), X_camera_image))
    return tuple(parts)


def _unlit(rgba: Color, checked: CheckedImage) -> Material:
    return textured(rgba, checked.image, has_alpha=checked.has_alpha, repeats=False, unlit=True)


def _material(
    rgba: Color, checked: CheckedImage | None, colors: NDArray[np.float32] | None, *, repeats: bool = True
) -> Material:
    """Return the material of a lit surface with a texture, which may repeat, and (N, 4) vertex colours, or None."""
    has_alpha = colors is not None and bool((colors[:, 3] < 1.0).any())
    if checked is not None:
        result = textured(rgba, checked.image, has_alpha=has_alpha or checked.has_alpha, repeats=repeats)
    else:
        result = material(rgba)
        result = replace(result, alpha_mode=AlphaMode.BLEND) if has_alpha else result
    return result if colors is None else replace(result, decodes_vertex_colors=False)
