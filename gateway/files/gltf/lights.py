"""KHR_lights_punctual: the document's lights, placed by the nodes that refer to them.

An invalid light is left out with a warning, because only some looks use lights, and because Drake's client does not
adapt the references to lights when it merges several files.
"""

import math
from typing import Final

import numpy as np

from gateway.files.gltf import schema
from gateway.files.gltf.gltf_errors import GltfError, as_warning, checked_item
from gateway.files.gltf.nodes import SceneNodes
from gateway.files.gltf.parser import extension, vector_or_default
from gateway.scene.tree.transforms import Matrix
from renderers.drawlist import Light, LightKind

EXTENSION: Final = "KHR_lights_punctual"
MAX_INTENSITY: Final = 1e12
"""Maximum intensity times colour, lux or candela: sums of larger ones overflow in float32. The sun has 1e5 lux."""
MAX_RANGE: Final = 1e9
"""Maximum range, metres: the fourth power of a much larger one overflows, and it changes nothing in an image."""


def read_lights(document: schema.Document, warnings: list[str]) -> list[schema.GltfLight | None]:
    """Return the document's lights."""
    found = extension(document.extensions, EXTENSION, schema.GltfLights, "", warnings)
    return (found and found.lights) or []


def place_lights(
    sources: list[schema.GltfLight | None], nodes: SceneNodes, limit: int, warnings: list[str]
) -> tuple[Light, ...]:
    """Return the lights of the scene's nodes from the result of ``read_lights``, in the document's world frame.

    Lights beyond the limit are left out with a warning.
    """
    lights: list[Light] = []
    if not sources:
        return ()
    for index, node, X_world_node in zip(nodes.indices, nodes.sources, nodes.X_world_node, strict=True):
        if not node.extensions or EXTENSION not in node.extensions:
            continue
        name = f"nodes[{index}]"
        if len(lights) == limit:
            warnings.append(f"{name}: more lights than max_lights = {limit}, further ones are left out")
            break
        with as_warning(warnings, f"{name} has no light"):
            if reference := extension(node.extensions, EXTENSION, schema.LightReference, name, warnings):
                source = checked_item(sources, reference.light, "lights", f"{name}.extensions.{EXTENSION}.light")
                lights.append(_light(source, f"lights[{reference.light}]", X_world_node, warnings))
    return tuple(lights)


def _light(source: schema.GltfLight, name: str, X_world_node: Matrix, warnings: list[str]) -> Light:
    """Return a light at the pose of its node. Raises GltfError if a property is invalid, or it has no direction."""
    try:
        kind = LightKind(source.type)
    except ValueError:
        raise GltfError(f"{name}.type: {str(source.type)[:20]!r} is not directional, point or spot") from None
    axis = -X_world_node[:3, 2]  # lights shine along -Z of their node
    length = float(np.linalg.norm(axis))
    if not (0.0 < length < math.inf and np.isfinite(X_world_node).all()):
        raise GltfError(f"{name}: its node has no direction")
    spot = source.spot or schema.Spot()
    inner_cone = 0.0 if spot.inner_cone_angle is None else spot.inner_cone_angle
    outer_cone = math.pi / 4.0 if spot.outer_cone_angle is None else spot.outer_cone_angle
    if kind is LightKind.SPOT and not 0.0 <= inner_cone < outer_cone <= math.pi / 2.0:
        raise GltfError(
            f"{name}.spot: the cones {inner_cone:g} and {outer_cone:g} must lie within 0 .. pi/2, the inner first"
        )
    intensity = 1.0 if source.intensity is None else source.intensity
    if not 0.0 <= intensity < math.inf:
        raise GltfError(f"{name}.intensity: {intensity} is not a finite number from 0 on")
    if source.range is not None and not 0.0 < source.range < math.inf:
        raise GltfError(f"{name}.range: {source.range} is not a positive finite number")
    color = vector_or_default(source.color, f"{name}.color", (1.0, 1.0, 1.0), warnings)
    if intensity * max(map(abs, color)) > MAX_INTENSITY:
        raise GltfError(f"{name}: intensity {intensity:g} times color {list(color)} is above {MAX_INTENSITY:g}")
    range_ = None if source.range is None else min(source.range, MAX_RANGE)
    x, y, z = (float(v) for v in X_world_node[:3, 3])
    dx, dy, dz = (float(v) for v in axis / length)
    return Light(kind, color, float(intensity), (x, y, z), (dx, dy, dz), range_, inner_cone, outer_cone)
