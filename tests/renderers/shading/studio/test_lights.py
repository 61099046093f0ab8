"""Automatic exposure of lights in lux and candela."""

import math

import numpy as np
import pytest

from renderers.drawlist import Light, LightKind
from renderers.shading.studio.lights import dimmed_to_expose

GRID = np.stack([*np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9)), np.zeros((9, 9))], -1).reshape(-1, 3)
"""Points of a floor, metres."""
SUN = Light(LightKind.DIRECTIONAL, intensity=100_000.0)


def test_the_sun_lights_a_white_wall_white() -> None:
    assert dimmed_to_expose((SUN,), GRID)[0].intensity == pytest.approx(math.pi)


@pytest.mark.parametrize("kind", [LightKind.POINT, LightKind.SPOT])
def test_lamps_in_candela_are_measured_where_they_shine(kind: LightKind) -> None:
    lamp = Light(kind, (1.0, 0.5, 0.2), 54_351.0, (0.0, 0.0, 5.0), inner_cone=0.5, outer_cone=0.7)
    intensity = dimmed_to_expose((lamp,), GRID)[0].intensity
    assert intensity == pytest.approx(25.0 * math.pi, rel=0.1)


def test_all_lights_are_dimmed_by_one_factor() -> None:
    lamp = Light(LightKind.POINT, intensity=600.0, position=(0.0, 0.0, 2.0))
    sun, dimmed_lamp = dimmed_to_expose((SUN, lamp), GRID)
    assert sun.intensity / dimmed_lamp.intensity == pytest.approx(SUN.intensity / lamp.intensity)


@pytest.mark.parametrize(
    "light",
    [
        Light(LightKind.DIRECTIONAL, intensity=math.pi),
        Light(LightKind.POINT, intensity=3.0, position=(0.0, 0.0, 1.0)),
        Light(LightKind.SPOT, intensity=1e6, position=(0.0, 0.0, 5.0), direction=(0.0, 0.0, 1.0)),
        Light(LightKind.POINT, intensity=1e6, position=(0.0, 0.0, 5.0), range=1.0),
        Light(LightKind.POINT, intensity=1e6, position=(0.0, 0.0, 5.0), range=1e-170),
        Light(LightKind.DIRECTIONAL, (0.0, 0.0, 0.0), 1e6),
    ],
    ids=[
        "as bright as white",
        "a small number without unit",
        "a spot that shines away",
        "out of range",
        "tiny range",
        "black",
    ],
)
def test_other_lights_stay_as_they_are(light: Light) -> None:
    assert dimmed_to_expose((light,), GRID) == (light,)


def test_without_visible_surfaces_nothing_is_measured() -> None:
    assert dimmed_to_expose((SUN,), np.zeros((0, 3))) == (SUN,)
    inside = Light(LightKind.POINT, intensity=1e308, position=(0.0, 0.0, 0.0))
    assert math.isfinite(dimmed_to_expose((inside,), np.zeros((4, 3)))[0].intensity)
