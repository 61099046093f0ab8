"""Contact forces as arrows, and contact surfaces coloured by their pressure, as Drake's own viewer draws them."""

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
"""Node below ``ROOT``, of which ``point`` and ``hydroelastic`` are children."""
MIN_FORCE: Final = 0.01
"""Smaller forces (newtons) and moments (newton metres) are not shown. These constants are Drake's."""
NEWTONS_PER_METRE: Final = 10.0
"""Force of an arrow of one metre."""
NEWTON_METRES_PER_METRE: Final = 3.0
"""Moment of an arrow of one metre."""
RADIUS: Final = 0.002
"""Radius of arrows, metres."""
MAX_LENGTH: Final = 100.0
"""Maximum length of an arrow, metres: contacts that penetrate deeply have forces of meganewtons."""
POINT_COLOR: Final[Color] = (0.0, 1.0, 0.0, 1.0)
FORCE_COLOR: Final[Color] = (1.0, 0.0, 0.0, 1.0)
MOMENT_COLOR: Final[Color] = (0.0, 0.0, 1.0, 1.0)
FLAME: Final = np.array(((0, 0, 0), (0, 0, 1), (1, 0, 0), (1, 1, 0), (1, 1, 1)), np.float64)
"""Colours of the pressures 0, 1/4, 1/2, 3/4 and 1 of the highest pressure, sRGB."""

ContactParts = dict[Path, tuple[Part, ...]]
"""Parts of the contacts between two bodies, by path in the live tree."""


def read_contacts(contacts: Contacts) -> ContactParts:
    """Return the arrows and surfaces of a message.

    Raises:
        MessageError: A contact surface is damaged.
    """
    parts: ContactParts = {}
    for contact in contacts.points:
        path = (ROOT, CONTACTS, "point", "+".join(contact.bodies))
        shown = _vector(contact.point, contact.force, NEWTONS_PER_METRE, POINT_COLOR, centred=True)
        if shown:
            parts[path] = parts.get(path, ()) + shown
    for surface in contacts.surfaces:
        path = (ROOT, CONTACTS, "hydroelastic", "+".join(surface.bodies))
        force = _vector(surface.centroid, surface.force, NEWTONS_PER_METRE, FORCE_COLOR, centred=False)
        moment = _vector(surface.centroid, surface.moment, NEWTON_METRES_PER_METRE, MOMENT_COLOR, centred=False)
        shown = force + moment
        if shown:
            parts[path] = parts.get(path, ()) + shown + _pressure_surface(surface)
    return parts


def _vector(origin: Vector3, vector: Vector3, per_metre: float, color: Color, *, centred: bool) -> tuple[Part, ...]:
    """Return an arrow; nothing for vectors that are too small or not finite."""
    norm = math.hypot(*vector)
    if not (MIN_FORCE <= norm < math.inf and all(map(math.isfinite, origin))):
        return ()
    return arrow(origin, vector, min(norm / per_metre, MAX_LENGTH), RADIUS, color, centred=centred)


def _pressure_surface(contact: SurfaceContact) -> tuple[Part, ...]:
    """Return the contact surface, coloured by its pressure; nothing without vertices."""
    triangles = triangles_of(contact.polygons, len(contact.vertices))
    with np.errstate(over="ignore"):
        positions = contact.vertices.astype(np.float32)
    finite = np.asarray(np.isfinite(positions).all(axis=1))
    triangles = triangles[finite[triangles].all(axis=1)]
    if not len(triangles):
        return ()
    positions[~finite] = 0.0
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

    def apply(self, parts: ContactParts, edit: TreeEdit) -> None:
        """Replace the contacts, and delete those that have ended."""
        for path in self.shown - parts.keys():
            edit.delete(path)
        for path, shown in parts.items():
            edit.set_parts(path, shown)
        self.shown = frozenset(parts)
