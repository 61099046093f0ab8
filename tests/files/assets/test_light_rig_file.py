"""Rig files: values, defaults, limits and errors."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from structlog.testing import capture_logs

from gateway.files.assets.light_rig_file import RigFileError, read_rig, rig_digest, rig_of
from renderers.drawlist import Light, LightKind
from renderers.light_rig import STUDIO, Hemisphere, Rig, Softbox, Surroundings

EVERYTHING = """
exposure = 1.5
tone = "aces"
shadow_size = 512
scene_lights = false
[surroundings]
image = "sky.hdr"
sky = [1, 1, 1]
intensity = 0.5
turn = 90
[[surroundings.softboxes]]
direction = [0, 0, 2]
radiance = [3, 2, 1]
width = 30
height = 15
[[lights]]
kind = "spot"
color = [1, 0.5, 0]
intensity = 20
position = [1, 2, 3]
direction = [0, 0, -4]
range = 9
inner_cone = 10
outer_cone = 60
casts_shadow = false
[[lights]]
kind = "point"
"""


def rig_file(folder: Path, text: str) -> Path:
    path = folder / "rig.toml"
    path.write_text(text)
    return path


def test_everything_is_read(tmp_path: Path) -> None:
    path = rig_file(tmp_path, EVERYTHING)
    sky = cv2.imencode(".hdr", np.ones((4, 8, 3), np.float32))[1].tobytes()
    (tmp_path / "sky.hdr").write_bytes(sky)
    rig = read_rig(path)
    assert (rig.exposure, rig.tone, rig.shadow_size, rig.scene_lights) == (1.5, "aces", 512, False)
    assert rig.surroundings.image == sky
    assert rig.surroundings.hemisphere == Hemisphere((1, 1, 1), Hemisphere().ground)
    assert (rig.surroundings.intensity, rig.surroundings.turn) == (0.5, math.pi / 2)
    assert rig.surroundings.softboxes == (Softbox((0, 0, 1), (3, 2, 1), math.radians(30), math.radians(15)),)
    spot, point = rig.lights
    assert point == Light(LightKind.POINT)
    assert (spot.kind, spot.position, spot.direction, spot.range) == (LightKind.SPOT, (1, 2, 3), (0, 0, -1), 9)
    assert (spot.inner_cone, spot.outer_cone) == (math.radians(10), math.radians(60))
    assert not spot.casts_shadow


def test_an_empty_file_has_no_light(tmp_path: Path) -> None:
    assert read_rig(rig_file(tmp_path, "")) == Rig(surroundings=None)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("exposure = -1", "exposure: input should be greater than or equal to 0, not -1"),
        ("exposure = inf", "exposure: input should be a finite number"),
        ("exposure = 1e308", "exposure: input should be less than or equal to 1000000000, not 1e"),
        ("[surroundings]\nimage = '.'", "cannot be read: it is not a regular file (the surroundings of"),
        ("fog = 1", "fog: extra inputs are not permitted"),
        ("shadow_size = 5", "shadow_size must be 0 or 64 .. 8192"),
        ("[[lights]]", "lights.0.kind: field required"),
        ("[[lights]]\nkind = 'sun'", "lights.0.kind: input should be 'directional', 'point' or 'spot', not 'sun'"),
        ("tone = 'filmic'", "tone: input should be 'neutral', 'aces' or 'none', not 'filmic'"),
        ("[[lights]]\nkind = 'spot'\ninner_cone = 50", "lights.0: inner_cone = 50 must be less than outer_cone = 45"),
        ("[[lights]]\nkind = 'spot'\ndirection = [0, 0, 0]", "lights.0: direction = [0.0, 0.0, 0.0] has no direction"),
        (
            "[surroundings]\nimage = 'none.hdr'",
            "none.hdr cannot be read: No such file or directory (the surroundings of ",
        ),
        ("[surroundings]\nimage = 'rig.toml'", "no Radiance image"),
        ("exposure = ", "rig.toml: Invalid value"),
    ],
)
def test_errors_name_file_field_and_value(tmp_path: Path, text: str, message: str) -> None:
    path = rig_file(tmp_path, text)
    with pytest.raises(RigFileError) as error:
        read_rig(path)
    assert message in str(error.value)
    assert "rig.toml" in str(error.value)


def test_the_digest_covers_the_file_and_its_image(tmp_path: Path) -> None:
    path, picture = tmp_path / "rig.toml", tmp_path / "light.hdr"
    path.write_text('[surroundings]\nimage = "light.hdr"')
    pixels = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n"
    picture.write_bytes(pixels + 2 * bytes((128, 128, 128, 128)))
    first = rig_digest(path)
    assert rig_digest(path) == first
    picture.write_bytes(pixels + 2 * bytes((128, 128, 128, 129)))
    second = rig_digest(path)
    path.write_text(path.read_text() + "\nintensity = 2")
    assert len({first, second, rig_digest(path)}) == 3


def test_an_environment_map_is_a_rig(tmp_path: Path) -> None:
    """It lights the scene alone, as in Drake's RenderEngineVtk."""
    path = tmp_path / "Sky.HDR"
    sky = cv2.imencode(".hdr", np.ones((4, 8, 3), np.float32))[1].tobytes()
    path.write_bytes(sky)
    assert read_rig(path) == Rig(surroundings=Surroundings(image=sky))
    digest = rig_digest(path)
    path.write_bytes(sky[:-1] + b"\x80")
    assert rig_digest(path) != digest
    path.write_bytes(b"P6")
    with pytest.raises(RigFileError, match=r"Sky.HDR: .*Radiance"):
        read_rig(path)


def test_lights_of_a_scene_are_metered_unless_the_file_has_an_exposure(tmp_path: Path) -> None:
    assert read_rig(rig_file(tmp_path, "shadow_size = 0")).auto_exposure
    assert not read_rig(rig_file(tmp_path, "exposure = 1.0")).auto_exposure


def test_a_missing_file_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(RigFileError, match="cannot be read"):
        read_rig(tmp_path / "rig.toml")


@pytest.mark.parametrize(
    ("text", "allowed"),
    [
        ("[[lights]]\nkind = 'spot'\ninner_cone = 45", False),
        ("[[lights]]\nkind = 'spot'\ninner_cone = 44.9", True),
        ("[[lights]]\nkind = 'point'\ninner_cone = 50", True),
        ("[[lights]]\nkind = 'spot'\nouter_cone = 90", True),
        ("[[lights]]\nkind = 'spot'\nouter_cone = 90.1", False),
        ("[[lights]]\nkind = 'point'\nintensity = 0", True),
        ("[[lights]]\nkind = 'point'\nrange = 0", False),
        ("[[lights]]\nkind = 'point'\ncolor = [1, -0.1, 1]", False),
        ("[[lights]]\nkind = 'point'\nposition = [0, -1e13, 0]", True),
        ("[[lights]]\nkind = 'point'\nposition = [0, nan, 0]", False),
        ("[[lights]]\nkind = 'point'\ndirection = [0, 1e-9, 0]", False),
        ("[[lights]]\nkind = 'point'\ndirection = [0, 1.1e-9, 0]", True),
        ("[[lights]]\nkind = 'point'\ndirection = [0, -1e9, 0]", False),
        ("[[surroundings.softboxes]]\ndirection = [0, 0, 1]\nradiance = [1, 1, 1]\nwidth = 89\nheight = 5", False),
        ("[[surroundings.softboxes]]\ndirection = [0, 0, 1]\nradiance = [1, 1, 1]\nwidth = 5\nheight = 0", False),
        ("exposure = 0", True),
    ],
)
def test_values_at_their_limits(tmp_path: Path, text: str, allowed: bool) -> None:
    path = rig_file(tmp_path, text)
    if allowed:
        assert isinstance(read_rig(path), Rig)
    else:
        with pytest.raises(RigFileError):
            read_rig(path)


def test_directions_have_unit_length(tmp_path: Path) -> None:
    path = rig_file(tmp_path, "[[lights]]\nkind = 'directional'\ndirection = [2, -3, 6]")
    (light,) = read_rig(path).lights
    assert light.direction == (2 / 7, -3 / 7, 6 / 7)


def test_without_a_path_the_default_rig_is_used(tmp_path: Path) -> None:
    assert rig_of(None) is STUDIO
    path = rig_file(tmp_path, "shadow_radius = 3")
    with capture_logs() as log:
        assert rig_of(path) == Rig(surroundings=None, shadow_radius=3)
        assert rig_of(path).is_dark
    (entry,) = log
    assert entry["reason"] == "the rig has neither [[lights]] nor [surroundings]"
