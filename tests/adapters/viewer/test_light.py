"""The light of the page: the rig's, as three.js reads it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gateway.adapters.viewer.light import encode_light
from renderers.drawlist import Light, LightKind
from renderers.light_rig import STUDIO, Rig, Surroundings
from renderers.shading.studio.environment_image import radiance_of
from renderers.shading.studio.environment_map import irradiance_of
from renderers.shading.studio.octahedral import octahedral_directions
from tests.support.view_frames import parse_frame


def test_irradiance_of_the_harmonics_is_that_of_the_renderer() -> None:
    """The polynomials are three.js' ``shGetIrradianceAt`` (Ramamoorthi and Hanrahan 2001)."""
    header, _ = parse_frame(encode_light(STUDIO))
    c = np.array(header["ambient"]).reshape(9, 3)
    n = octahedral_directions(32).reshape(-1, 3)
    x, y, z = n.T[..., None]
    irradiance = 0.886227 * c[0] + 2 * 0.511664 * (c[1] * y + c[2] * z + c[3] * x)
    irradiance = irradiance + 2 * 0.429043 * (c[4] * x * y + c[5] * y * z + c[7] * x * z)
    irradiance = irradiance + c[6] * (0.743125 * z * z - 0.247708) + c[8] * 0.429043 * (x * x - y * y)
    assert STUDIO.surroundings is not None
    expected = irradiance_of(radiance_of(STUDIO.surroundings))[1:-1, 1:-1].reshape(-1, 3)
    assert irradiance / math.pi == pytest.approx(expected, rel=0.1)


def test_lights_have_their_colour_times_intensity_and_a_range() -> None:
    lamp = Light(LightKind.POINT, (1.0, 0.5, 0.25), 4.0, position=(1.0, 2.0, 3.0), range=7.0)
    header, _ = parse_frame(encode_light(Rig((lamp,), None, exposure=2.0, tone="aces", shadow_size=0)))
    (light,) = header["lights"]
    assert light["type"] == "point"
    assert light["color"] == [4.0, 2.0, 1.0]
    assert light["position"] == [1.0, 2.0, 3.0]
    assert light["range"] == 7.0
    assert light["castsShadow"] is False
    assert header["exposure"] == 2.0
    assert header["tone"] == "aces"
    assert header["ambient"] == [0.0] * 27


def test_environment_turns_with_the_rig() -> None:
    def brightest_column(surroundings: Surroundings) -> int:
        header, body = parse_frame(encode_light(replace(STUDIO, surroundings=surroundings)))
        offset, count = header["environment"]
        height, width = header["size"]
        image = np.frombuffer(body, np.float32, count, offset).reshape(height, width, 3)
        return int(image.sum(axis=(0, 2)).argmax())

    assert STUDIO.surroundings is not None
    turned = replace(STUDIO.surroundings, turn=math.pi / 2)
    assert (brightest_column(STUDIO.surroundings) - brightest_column(turned)) % 128 == 32
