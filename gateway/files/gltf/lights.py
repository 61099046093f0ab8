"""KHR_lights_punctual: the document's lights, and the nodes that refer to them.

An invalid light is left out with a warning, because only some looks use lights, and because Drake's client does not
adapt the references to lights when it merges several files.
"""

import math
from typing import Final

from gateway.files.gltf import schema
from gateway.files.gltf.gltf_errors import GltfError, as_warning, checked_item
from gateway.files.gltf.nodes import SceneNodes
from gateway.files.gltf.parser import extension, vector_or_default
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


def node_lights(
    sources: list[schema.GltfLight | None], nodes: SceneNodes, limit: int, warnings: list[str]
) -> dict[int, Light]:
    """Return the lights of nodes from the result of ``read_lights``, in the node's frame, by its position in ``nodes``.

    Lights beyond the limit, and those of nodes without a direction, are left out with a warning.
    """
    lights: dict[int, Light] = {}
    for position, (index, node) in enumerate(zip(nodes.indices, nodes.sources, strict=True)):
        if not node.extensions or EXTENSION not in node.extensions:
            continue
        name = f"nodes[{index}]"
        if len(lights) == limit:
            warnings.append(f"{name}: more lights than max_lights = {limit}, further ones are left out")
            break
        with as_warning(warnings, f"{name} has no light"):
            if reference := extension(node.extensions, EXTENSION, schema.LightReference, name, warnings):
                source = checked_item(sources, reference.light, "lights", f"{name}.extensions.{EXTENSION}.light")
                light = _light(source, f"lights[{reference.light}]", warnings)
                if light.placed(nodes.X_world_node[position]) is None:
                    raise GltfError(f"lights[{reference.light}]: its node has no direction")
                lights[position] = light
    return lights


def _light(source: schema.GltfLight, name: str, warnings: list[str]) -> Light:
    """Return a light in the frame of its node, where it shines along -Z. Raises GltfError if a property is invalid."""
    try:
        kind = LightKind(source.type)
    except ValueError:
        raise GltfError(f"{name}.type: {str(source.type)[:20]!r} is not directional, point or spot") from None
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
    return Light(kind, color, float(intensity), range=range_, inner_cone=inner_cone, outer_cone=outer_cone)
