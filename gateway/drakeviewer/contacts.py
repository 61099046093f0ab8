"""Contact forces as arrows, and contact surfaces coloured by their pressure, as Drake's own viewer draws them.

Thresholds, scales, radius and colours are Drake's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.drakeviewer.arrows import arrow
from gateway.drakeviewer.messages import Contacts, MessageError, SurfaceContact, Vector3
from gateway.drakeviewer.robots import ROOT
from gateway.scene.geometry import Part, Surface
from gateway.scene.materials import WHITE, Color, material
from gateway.scene.tree import Path, TreeEdit
from renderers.color import linear_colors_from_srgb
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
"""Colour map of pressures: sRGB at 0, 1/4, 1/2, 3/4 and 1 times the highest pressure, (5, 3)."""

ContactParts = dict[Path, tuple[Part, ...]]
"""Parts by path in the live tree. A path has all contacts between two bodies."""


def read_contacts(contacts: Contacts) -> ContactParts:
    """Return the arrows and surfaces of a message. A surface without a force or moment to show is left out.

    Raises:
        MessageError: A contact surface is damaged.
    """
    parts: ContactParts = {}
    for contact in contacts.points:
        path = (ROOT, CONTACTS, "point", "+".join(contact.bodies))
        arrows = _arrow(contact.point, contact.force, NEWTONS_PER_METRE, POINT_COLOR, centred=True)
        if arrows:
            parts[path] = parts.get(path, ()) + arrows
    for surface in contacts.surfaces:
        path = (ROOT, CONTACTS, "hydroelastic", "+".join(surface.bodies))
        force = _arrow(surface.centroid, surface.force, NEWTONS_PER_METRE, FORCE_COLOR, centred=False)
        moment = _arrow(surface.centroid, surface.moment, NEWTON_METRES_PER_METRE, MOMENT_COLOR, centred=False)
        arrows = force + moment
        if arrows:
            parts[path] = parts.get(path, ()) + arrows + _pressure_surface(surface)
    return parts


def _arrow(origin: Vector3, vector: Vector3, per_metre: float, color: Color, *, centred: bool) -> tuple[Part, ...]:
    """Return the parts of an arrow; none for vectors that are too small or not finite.

    Args:
        per_metre: norm of the vector for an arrow of 1 m.
    """
    norm = math.hypot(*vector)
    if not (MIN_FORCE <= norm < math.inf and all(map(math.isfinite, origin))):
        return ()
    return arrow(origin, vector, min(norm / per_metre, MAX_LENGTH), RADIUS, color, centred=centred)


def _pressure_surface(contact: SurfaceContact) -> tuple[Part, ...]:
    """Return the contact surface, coloured by its pressure; nothing if no triangle has finite vertices."""
    triangles = triangles_of(contact.polygons, len(contact.vertices))
    finite = np.asarray(np.isfinite(contact.vertices).all(axis=1))
    triangles = triangles[finite[triangles].all(axis=1)]
    if not len(triangles):
        return ()
    positions = np.where(finite[:, None], contact.vertices, 0.0).astype(np.float32)
    mesh = Mesh(positions, np.ascontiguousarray(triangles), colors=flame_colors(contact.pressure))
    return (Part(Surface(mesh), material(WHITE), kind="contact_surface"),)


def flame_colors(pressure: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the colour of each pressure relative to the highest one, (N, 4) float32 linear RGBA."""
    pressure = np.nan_to_num(pressure, posinf=0.0, neginf=0.0)
    highest = max(float(pressure.max(initial=0.0)), 1e-300)
    relative = np.clip(pressure / highest, 0.0, 1.0)
    srgb = np.ones((len(pressure), 4), np.float32)
    for channel in range(3):
        srgb[:, channel] = np.interp(relative, np.linspace(0.0, 1.0, len(FLAME)), FLAME[:, channel])
    return linear_colors_from_srgb(srgb)


def triangles_of(polygons: NDArray[np.int32], vertex_count: int) -> NDArray[np.uint32]:
    """Return the triangles of convex polygons, (M, 3) uint32: fans around the first vertex of each.

    Args:
        polygons: (N,) int32, for each polygon its number of vertices, then their indices.
        vertex_count: number of vertices that exist.

    Raises:
        MessageError: A polygon is cut off, or refers to a vertex that does not exist.
    """
    triangles: list[NDArray[np.int32]] = []
    start = 0
    total = len(polygons)
    while start < total:
        sides = int(polygons[start])
        corners = polygons[start + 1 : start + 1 + sides]
        if sides < 0 or len(corners) != sides:
            raise MessageError(
                f"a contact surface has a polygon of {sides} vertices, {total - start - 1} numbers follow"
            )
        if sides >= 3:
            fan = np.empty((sides - 2, 3), np.int32)
            fan[:, 0], fan[:, 1], fan[:, 2] = corners[0], corners[1:-1], corners[2:]
            triangles.append(fan)
        start += 1 + sides
    if not triangles:
        return np.zeros((0, 3), np.uint32)
    joined = np.concatenate(triangles)
    if joined.min() < 0 or joined.max() >= vertex_count:
        raise MessageError(f"a contact surface refers to vertex {joined.max()} of {vertex_count}")
    return joined.astype(np.uint32)


@dataclass(slots=True, eq=False)
class ContactChannel:
    """The contacts that are in the live tree."""

    shown: frozenset[Path] = frozenset()
    """Paths of the contacts in the live tree."""

    def apply(self, parts: ContactParts, edit: TreeEdit) -> None:
        """Replace the contacts, and delete those that are no longer in the message."""
        for path in self.shown - parts.keys():
            edit.delete(path)
        for path, parts_of_pair in parts.items():
            edit.set_parts(path, parts_of_pair)
        self.shown = frozenset(parts)
