"""KHR_lights_punctual."""

import json
import math
from typing import Any

import numpy as np
import pytest

from gateway.files.gltf import GltfLimits, read_gltf
from gateway.files.gltf.lights import MAX_RANGE
from renderers.drawlist import Light, LightKind

HALF = math.sqrt(0.5)


def document(*lights: Any, nodes: list[dict[str, Any]] | None = None) -> bytes:
    """Every light at a node of its own, or at the given nodes."""
    name = "KHR_lights_punctual"
    carriers = nodes or [{"extensions": {name: {"light": k}}} for k in range(len(lights))]
    return json.dumps(
        {"asset": {"version": "2.0"}, "extensions": {name: {"lights": list(lights)}}, "nodes": carriers}
    ).encode()


def test_defaults() -> None:
    directional, point, spot = read_gltf(document(*({"type": t} for t in ("directional", "point", "spot")))).lights
    assert directional == Light(LightKind.DIRECTIONAL)
    assert point == Light(LightKind.POINT)
    assert spot == Light(LightKind.SPOT, inner_cone=0.0, outer_cone=math.pi / 4)


def test_values_and_place() -> None:
    light = {
        "type": "spot",
        "color": [1, 0.5, 0],
        "intensity": 7,
        "range": 3,
        "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.2},
    }
    child = {"translation": [0, 0, 1], "extensions": {"KHR_lights_punctual": {"light": 0}}}
    # A quarter turn about Y takes -Z to -X; scales change neither direction nor intensity.
    parent = {"children": [1], "rotation": [0, HALF, 0, HALF], "scale": [2, 2, 2], "translation": [5, 0, 0]}
    (placed,) = read_gltf(document(light, nodes=[parent, child])).lights
    assert (placed.kind, placed.color, placed.intensity, placed.range) == (LightKind.SPOT, (1.0, 0.5, 0.0), 7.0, 3.0)
    assert (placed.inner_cone, placed.outer_cone) == (0.1, 0.2)
    np.testing.assert_allclose(placed.position, (7, 0, 0), atol=1e-12)
    np.testing.assert_allclose(placed.direction, (-1, 0, 0), atol=1e-12)


@pytest.mark.parametrize(
    ("light", "message"),
    [
        ({"type": "sun"}, r"lights[0].type: 'sun' is not directional, point or spot"),
        ({"type": "point", "intensity": -1}, "lights[0].intensity: -1.0 is not a finite number from 0 on"),
        (
            {"type": "point", "intensity": 1e300},
            "lights[0]: intensity 1e+300 times color [1.0, 1.0, 1.0] is above 1e+12",
        ),
        ({"type": "point", "range": 0}, "lights[0].range: 0.0 is not a positive finite number"),
        ({"type": "spot", "spot": {"innerConeAngle": 1}}, "lights[0].spot: the cones 1 and 0.785398 must"),
        ({"type": 3}, "extensions.KHR_lights_punctual.lights[0].type: expected a string, got 3; nodes[0] has no light"),
        (None, "lights[0] is null"),
    ],
)
def test_unusable_lights_are_left_out_with_a_warning(light: Any, message: str) -> None:
    scene = read_gltf(document(light))
    assert scene.lights == ()
    assert any(message in warning for warning in scene.warnings)


def test_the_largest_ranges_change_nothing() -> None:
    (light,) = read_gltf(document({"type": "point", "range": 1e300})).lights
    assert light.range == MAX_RANGE


def test_unusable_references() -> None:
    carriers: list[dict[str, Any]] = [
        {"extensions": {"KHR_lights_punctual": {"light": index}}} for index in (1, "x", None)
    ]
    carriers.append({"scale": [1, 1, 0], "extensions": {"KHR_lights_punctual": {"light": 0}}})
    scene = read_gltf(document({"type": "point"}, nodes=carriers))
    assert scene.lights == ()
    assert len(scene.warnings) == 4


def test_limit() -> None:
    carriers = [{"extensions": {"KHR_lights_punctual": {"light": 0}}}] * 5
    scene = read_gltf(document({"type": "point"}, nodes=carriers), limits=GltfLimits(max_lights=2))
    assert len(scene.lights) == 2
    assert scene.warnings == ("nodes[2]: more lights than max_lights = 2, further ones are left out",)


@pytest.mark.parametrize(
    ("inner", "outer", "allowed"),
    [
        (0.0, 0.1, True),
        (0.5, math.pi / 2, True),
        (0.5, 0.5, False),
        (-0.1, 0.5, False),
        (0.5, math.nextafter(math.pi / 2, 2), False),
    ],
)
def test_cones_of_spots(inner: float, outer: float, allowed: bool) -> None:
    cones = {"innerConeAngle": inner, "outerConeAngle": outer}
    lights = read_gltf(document({"type": "spot", "spot": cones})).lights
    assert [(light.inner_cone, light.outer_cone) for light in lights] == ([(inner, outer)] if allowed else [])
    assert len(read_gltf(document({"type": "point", "spot": cones})).lights) == 1


@pytest.mark.parametrize(("intensity", "count"), [(0, 1), (-1e-9, 0), (1e12, 1)])
def test_intensities_from_0_on(intensity: float, count: int) -> None:
    assert len(read_gltf(document({"type": "point", "intensity": intensity})).lights) == count


def test_directions_of_sheared_and_mirrored_nodes_have_unit_length() -> None:
    carrier = {"extensions": {"KHR_lights_punctual": {"light": 0}}, "rotation": [0.38268343, 0, 0, 0.92387953]}
    parent = {"children": [1], "scale": [1, -4, 2], "translation": [0, -3, -1e13]}
    (light,) = read_gltf(document({"type": "directional"}, nodes=[parent, carrier])).lights
    # Turned by 45 degrees about X, -Z points along (0, 1, -1), which the parent scales to (0, -4, -2).
    np.testing.assert_allclose(light.direction, np.array((0, -4, -2)) / np.sqrt(20), atol=1e-6)
    assert light.position == (0, -3, -1e13)
