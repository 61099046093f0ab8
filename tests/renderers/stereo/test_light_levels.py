"""The option of the levels of light, and dimming of a scene's lights."""

import numpy as np
import pytest

from renderers.drawlist import Light, LightKind
from renderers.stereo.light.levels import LightLevels, parse_light_levels
from renderers.stereo.light.scene_light import camera_light

ORIGIN = np.zeros(3)


def test_levels_are_read_from_text() -> None:
    assert parse_light_levels("") == LightLevels()
    assert parse_light_levels("lamp=0, sky=2") == LightLevels(lamp=0.0, sky=2.0)
    assert parse_light_levels(str(LightLevels(key=0.25))) == LightLevels(key=0.25)
    for text, named in (("sun=1", "'sun'"), ("sky=-1", "'-1'"), ("sky=bright", "'bright'"), ("sky=nan", "sky")):
        with pytest.raises(ValueError, match=named):
            parse_light_levels(text)


@pytest.mark.parametrize(("intensity", "at_camera"), [(0.5, 0.125), (100_000.0, 1.0)])
def test_bright_lights_are_dimmed_to_the_light_one(intensity: float, at_camera: float) -> None:
    lights = (Light(LightKind.POINT, intensity=intensity, position=(0.0, 0.0, 2.0)),)
    for level in (1.0, 0.3):
        (light,) = camera_light(LightLevels(scene=level), ORIGIN, lights, has_key_light=False).lights
        assert light.intensity / 2.0**2 == pytest.approx(level * at_camera)


def test_the_key_light_replaces_the_lamp() -> None:
    assert camera_light(LightLevels(), ORIGIN, (), has_key_light=False).lamp == LightLevels().lamp
    assert camera_light(LightLevels(), ORIGIN, (), has_key_light=True).lamp == 0.0
