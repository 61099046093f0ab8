"""KHR_lights_punctual: the document's lights, placed where its nodes carry them.

Nothing here is an error: lights change the looks only that use them, and Drake's merge of several files leaves the
indices of lights as they were in the single files. What cannot be used is left out with a warning.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

import msgspec
import numpy as np

from gateway.gltf import document as gltf
from gateway.gltf.document import Document, Extensions, extension, vector
from gateway.gltf.errors import GltfError, element
from gateway.scene.transforms import Matrix
from renderers.drawlist import Light, LightKind

EXTENSION: Final = "KHR_lights_punctual"


def lights_of(document: Document, warnings: list[str]) -> tuple[gltf.Light | None, ...]:
    """What the document's ``extensions`` say, not placed yet."""
    raw = extension(document.extensions, EXTENSION)
    if raw is None:
        return ()
    try:
        return tuple(msgspec.json.decode(raw, type=gltf.Lights).lights or ())
    except msgspec.MsgspecError as error:
        warnings.append(f"extensions.{EXTENSION}: {error}, no lights")
        return ()


def place_lights(
    lights: tuple[gltf.Light | None, ...],
    nodes: Iterable[tuple[str, Extensions, Matrix]],
    limit: int,
    warnings: list[str],
) -> tuple[Light, ...]:
    """The lights that nodes carry, in the document's world.

    Args:
        lights: of the document.
        nodes: name, extensions and X_world_node of those that have extensions.
        limit: how many may shine; further ones are left out.
    """
    known = list(lights)
    placed: list[Light] = []
    for name, extensions, X_world_node in nodes:
        raw = extension(extensions, EXTENSION)
        if raw is None:
            continue
        if len(placed) == limit:
            warnings.append(f"{name}: more lights than max_lights = {limit}, further ones are left out")
            break
        try:
            index = msgspec.json.decode(raw, type=gltf.LightReference).light
            source = element(known, index, "lights", f"{name}.extensions.{EXTENSION}.light")
            placed.append(_light(source, f"lights[{index}]", X_world_node))
        except (msgspec.MsgspecError, GltfError) as error:
            warnings.append(f"{error}: the light is left out")
    return tuple(placed)


def _light(source: gltf.Light, name: str, X_world_node: Matrix) -> Light:
    try:
        kind = LightKind(source.type)
    except ValueError:
        raise GltfError(f"{name}.type: {str(source.type)[:20]!r} is not directional, point or spot") from None
    axis = -X_world_node[:3, 2]  # lights shine along -Z of their node
    length = float(np.linalg.norm(axis))
    if not (0.0 < length < math.inf and np.isfinite(X_world_node).all()):
        raise GltfError(f"{name}: its node has no direction")
    spot = source.spot or gltf.Spot()
    inner = 0.0 if spot.inner_cone_angle is None else spot.inner_cone_angle
    outer = math.pi / 4.0 if spot.outer_cone_angle is None else spot.outer_cone_angle
    if kind is LightKind.SPOT and not 0.0 <= inner < outer <= math.pi / 2.0:
        raise GltfError(f"{name}.spot: the cones {inner:g} and {outer:g} must lie within 0 .. pi/2, the inner first")
    intensity = 1.0 if source.intensity is None else source.intensity
    if not 0.0 <= intensity < math.inf:
        raise GltfError(f"{name}.intensity: {intensity} is not a finite number from 0 on")
    if source.range is not None and not 0.0 < source.range < math.inf:
        raise GltfError(f"{name}.range: {source.range} is not a positive finite number")
    color = vector(source.color, (1.0, 1.0, 1.0), f"{name}.color")
    x, y, z = (float(v) for v in X_world_node[:3, 3])
    dx, dy, dz = (float(v) for v in axis / length)
    return Light(kind, color, float(intensity), (x, y, z), (dx, dy, dz), source.range, inner, outer)
