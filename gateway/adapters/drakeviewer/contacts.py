"""Contact forces as arrows, and contact surfaces coloured by their pressure, as Drake's own viewer draws them."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.drakeviewer.arrows import arrows
from gateway.adapters.drakeviewer.robots import ROOT
from gateway.adapters.drakeviewer.shapes import drawable_triangles
from gateway.adapters.drakeviewer.wire import Contacts, MessageError, SurfaceContact
from gateway.scene.tree.geometry import Part, Surface
from gateway.scene.tree.materials import WHITE, Color, material
from gateway.scene.tree.nodes import Path
from renderers.color import linear_values_from_srgb
from renderers.drawlist import Mesh

CONTACTS: Final = "contacts"
"""Name of the node below ``ROOT`` with the children ``point`` and ``hydroelastic``."""
MIN_FORCE: Final = 0.01
"""Minimum force in newtons, and minimum moment in newton metres, that is shown."""
NEWTONS_PER_METRE: Final = 10.0
"""Scale of force arrows."""
NEWTON_METRES_PER_METRE: Final = 3.0
"""Scale of moment arrows."""
RADIUS: Final = 0.002
"""Radius of arrows, metres."""
MAX_LENGTH: Final = 100.0
"""Maximum length of an arrow, metres: contacts that penetrate deeply have forces of meganewtons."""
POINT_COLOR: Final[Color] = (0.0, 1.0, 0.0, 1.0)
FORCE_COLOR: Final[Color] = (1.0, 0.0, 0.0, 1.0)
MOMENT_COLOR: Final[Color] = (0.0, 0.0, 1.0, 1.0)
FLAME: Final = np.array(((0, 0, 0), (0, 0, 1), (1, 0, 0), (1, 1, 0), (1, 1, 1)), np.float64)
"""Colour map of pressures: sRGB at ``FLAME_STOPS``, (5, 3)."""
FLAME_STOPS: Final = np.linspace(0.0, 1.0, 5)
"""Multiples of the highest pressure, (5,)."""


def read_contacts(contacts: Contacts, warnings: list[str]) -> dict[Path, tuple[Part, ...]]:
    """Return the arrows and surfaces of a message, by path in the live tree: a path has all contacts of two bodies.

    A surface without a force or moment is left out. A warning is added for arrows that are not finite, and for surfaces
    that cannot be shown completely.
    """
    parts: dict[Path, list[Part]] = {}
    colors = [POINT_COLOR] * len(contacts.points)
    point_arrows = _arrows(contacts.points, contacts.forces, NEWTONS_PER_METRE, colors, warnings, centred=True)
    for bodies, arrow in zip(contacts.point_bodies, point_arrows, strict=True):
        if arrow:
            parts.setdefault((ROOT, CONTACTS, "point", "+".join(bodies)), []).extend(arrow)
    surfaces = contacts.surfaces
    count = len(surfaces)
    centroids = np.array([surface.centroid for surface in surfaces] * 2).reshape(-1, 3)
    vectors = [surface.force for surface in surfaces] + [surface.moment for surface in surfaces]
    per_metre = np.repeat((NEWTONS_PER_METRE, NEWTON_METRES_PER_METRE), count)
    colors = [FORCE_COLOR] * count + [MOMENT_COLOR] * count
    surface_arrows = _arrows(centroids, np.array(vectors).reshape(-1, 3), per_metre, colors, warnings, centred=False)
    force_arrows, moment_arrows = surface_arrows[:count], surface_arrows[count:]
    for surface, force_arrow, moment_arrow in zip(surfaces, force_arrows, moment_arrows, strict=True):
        if force_arrow or moment_arrow:
            path = (ROOT, CONTACTS, "hydroelastic", "+".join(surface.bodies))
            parts.setdefault(path, []).extend((*force_arrow, *moment_arrow))
            try:
                parts[path] += _pressure_surface(surface, warnings)
            except MessageError as error:
                warnings.append(f"a contact surface is not shown: {error}")
    return {path: tuple(of_path) for path, of_path in parts.items()}


def _arrows(
    origins: NDArray[np.float64],
    vectors: NDArray[np.float64],
    per_metre: NDArray[np.float64] | float,
    colors: Sequence[Color],
    warnings: list[str],
    *,
    centred: bool,
) -> list[tuple[Part, ...]]:
    """Return the parts of N arrows; none for vectors that are too small, or not finite, which a warning counts.

    ``per_metre``: norm of a vector for an arrow of 1 m, (N,) or one for all.
    """
    parts_by_arrow: list[tuple[Part, ...]] = [()] * len(vectors)
    if not parts_by_arrow:
        return parts_by_arrow
    with np.errstate(over="ignore", invalid="ignore"):
        norms = np.sqrt((vectors * vectors).sum(axis=1))  # np.linalg.norm takes three times as long for few vectors
        finite = (norms < np.inf) & np.isfinite(origins).all(axis=1)
        shown = np.flatnonzero(finite & (norms >= MIN_FORCE))
        lengths = np.minimum(norms / per_metre, MAX_LENGTH)[shown]
    if not finite.all():
        kind = "point contacts" if centred else "forces and moments of contact surfaces"
        warnings.append(f"{np.count_nonzero(~finite)} of {len(finite)} {kind} are not finite; they have no arrow")
    if len(shown):
        indices = shown.tolist()
        shown_colors = [colors[index] for index in indices]
        shown_arrows = arrows(origins[shown], vectors[shown], lengths, RADIUS, shown_colors, centred=centred)
        for index, parts in zip(indices, shown_arrows, strict=True):
            parts_by_arrow[index] = parts
    return parts_by_arrow


def _pressure_surface(contact: SurfaceContact, warnings: list[str]) -> tuple[Part, ...]:
    """Return the contact surface, coloured by its pressure; nothing if no triangle has finite vertices."""
    with np.errstate(over="ignore"):
        positions = contact.vertices.astype(np.float32)
    triangles = drawable_triangles(positions, triangles_of(contact.polygons), warnings)
    if not len(triangles):
        return ()
    mesh = Mesh(positions, triangles, colors=flame_colors(contact.pressure))
    return (Part(Surface(mesh), material(WHITE), kind="contact_surface"),)


def flame_colors(pressure: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the colour of each pressure relative to the highest one, (N, 4) float32 linear RGBA."""
    pressure = np.where(np.isfinite(pressure), pressure, 0.0)
    relative = pressure / max(float(pressure.max(initial=0.0)), 1e-300)  # interp clips it to 0 .. 1
    srgb = np.empty((3, len(pressure)), np.float32)
    for channel, values in enumerate(FLAME.T):
        srgb[channel] = np.interp(relative, FLAME_STOPS, values)
    colors = np.ones((len(pressure), 4), np.float32)
    colors[:, :3] = linear_values_from_srgb(srgb).T
    return colors


def triangles_of(polygons: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the triangles of convex polygons, (M, 3): fans around the first vertex of each.

    ``polygons``, (N,): the number of vertices of each, then their indices. Raises MessageError if one is cut off.
    """
    counts: list[int] = []
    numbers, position = polygons.tolist(), 0
    while position < len(numbers):
        count = numbers[position]
        if not 0 <= count < len(numbers) - position:
            raise MessageError(f"a polygon has {count} vertices, which are not there")
        counts.append(count)
        position += 1 + count
    vertex_counts = np.array(counts, np.int64)
    triangle_counts = np.maximum(vertex_counts - 2, 0)
    first_vertices = np.cumsum(vertex_counts + 1) - vertex_counts  # position in ``polygons`` of each one's first vertex
    first_triangles = np.cumsum(triangle_counts) - triangle_counts
    first = np.repeat(first_vertices, triangle_counts)
    index_in_polygon = np.arange(len(first)) - np.repeat(first_triangles, triangle_counts)
    second = first + 1 + index_in_polygon
    triangles: NDArray[np.int32] = polygons[np.stack((first, second, second + 1), axis=1)]
    return triangles
