"""Changes of a rig's key light and environment."""

from dataclasses import replace

import pytest

from renderers.drawlist import Light, LightKind
from renderers.light_rig import STUDIO, LightChange, Rig

LAMP = Light(LightKind.POINT, (1.0, 1.0, 1.0), 5.0)
KEY = Light(LightKind.DIRECTIONAL, (1.0, 1.0, 1.0), 2.0, direction=(0.6, 0.0, -0.8))
FILL = Light(LightKind.DIRECTIONAL, (1.0, 1.0, 1.0), 1.0, direction=(0.0, 0.0, 1.0))
RIG = Rig((LAMP, KEY, FILL))


def test_no_change_is_the_same_rig() -> None:
    for rig in (STUDIO, RIG, Rig((), None)):
        assert LightChange().applied_to(rig) == rig


@pytest.mark.parametrize(
    ("azimuth", "elevation", "direction"),
    [
        (90.0, 0.0, (0.0, -1.0, 0.0)),
        (0.0, 90.0, (0.0, 0.0, -1.0)),
        (None, 0.0, (1.0, 0.0, 0.0)),
        (0.0, None, (-0.6, 0.0, -0.8)),
    ],
)
def test_the_first_directional_light_comes_from_a_direction(
    azimuth: float | None, elevation: float | None, direction: tuple[float, float, float]
) -> None:
    lamp, key, fill = LightChange(azimuth, elevation).applied_to(RIG).lights
    assert key.direction == pytest.approx(direction, abs=1e-12)
    assert (lamp, fill, key.intensity) == (LAMP, FILL, 2.0)


def test_factors_of_the_key_light_and_of_the_environment() -> None:
    changed = LightChange(strength=1.5, ambient=0.25).applied_to(RIG)
    assert changed.lights == (LAMP, replace(KEY, intensity=3.0), FILL)
    assert changed.surroundings.intensity == 0.25
    assert LightChange(strength=2.0, ambient=2.0).applied_to(Rig((), None)) == Rig((), None)
