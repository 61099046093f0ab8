"""Deformable bodies. Every message has all their vertices."""

from __future__ import annotations

from gateway.drakeviewer.config import Limits
from gateway.drakeviewer.float_meshes import surface_of
from gateway.drakeviewer.link_paths import split_name
from gateway.drakeviewer.messages import Link, MessageError
from gateway.drakeviewer.robots import ROOT
from gateway.drakeviewer.shapes import color_of, transform_of
from gateway.scene.geometry import Part
from gateway.scene.materials import material
from gateway.scene.tree import Path


def read_deformables(link: Link, family: str, limits: Limits, warnings: list[str]) -> dict[Path, tuple[Part, ...]]:
    """Return the bodies of a message by path in the live tree. A body without drawable triangles has no parts.

    Args:
        link: the message; each of its geometries is a body.
        family: family of the channel.
        warnings: list to which the reason is added if a mesh is damaged or beyond a limit. That body has no parts.

    Raises:
        MessageError: A name is beyond a limit.
    """
    bodies: dict[Path, tuple[Part, ...]] = {}
    parent = (ROOT, family, *split_name(link.key[1], limits))
    for geometry in link.geometries:
        if len(geometry.text) > limits.name_bytes:  # string_data may be as long as a mesh in JSON
            raise MessageError(
                f"the name of a deformable body has {len(geometry.text)} characters, the limit is {limits.name_bytes}"
            )
        path = (*parent, *split_name(geometry.text, limits))
        parts = bodies.setdefault(path, ())
        try:
            surface = surface_of(geometry.floats, limits)
        except MessageError as error:
            warnings.append(str(error))
            continue
        if surface is not None:
            part = Part(surface, material(color_of(geometry)), transform_of(geometry), "mesh_data")
            bodies[path] = (*parts, part)
    return bodies
