"""Camera profiles: shipped ones, a user's, and errors."""

import re
from pathlib import Path
from typing import Any

import msgspec
import pytest

from gateway.adapters.stereo.device.parameters import ParameterError, Parameters
from gateway.adapters.stereo.device.profile import (
    MAX_FILE_BYTES,
    PROFILE_NAMES,
    ColorSection,
    DepthSection,
    Profile,
    ProfileError,
    ProjectorSection,
    StereoSection,
    read_profile,
)
from gateway.adapters.stereo.device.stream_settings import read_settings
from gateway.runtime.settings import Settings
from gateway.scene.draw.cameras import CameraError
from gateway.scene.draw.mount import parse_mounted_camera
from gateway.wiring.stereo import config_of
from renderers.stereo.model import Quality

PAGE = Path(__file__).parents[4] / "docs" / "camera-profiles.md"
MINIMAL = 'name = "x"\n[stereo]\nsize = [640, 400]\nfocal_length = 704.0\nbaseline = 0.05\n'
COLOR = MINIMAL + "[color]\nsize = [64, 64]\nfocal_length = "


def write(folder: Path, text: str) -> str:
    path = folder / "camera.toml"
    path.write_text(text)
    return str(path)


@pytest.mark.parametrize("name", PROFILE_NAMES)
def test_shipped_profiles(name: str) -> None:
    profile = read_profile(name)
    model = profile.model
    assert profile.name == model.name
    assert name in Settings.model_fields["stereo_profile"].description
    assert f"`{name}`" in PAGE.read_text("utf-8")
    assert profile.stereo.color == (name.endswith("c")), "rc_visard …c has colour"
    if name.startswith("rc_visard"):
        assert (model.width, model.height, model.full_max_disparities) == (1280, 960, 256)
        assert profile.limits == Parameters().limits
        assert profile.color_camera is None


def test_rgbd_camera() -> None:
    config: Any = config_of(Settings(stereo_profile="rgbd", grpc_port=50051))
    assert (config.color_camera.intrinsics.width, config.color_camera.readout, config.projector) == (1280, 0.015, True)
    assert config.uses_motion
    parameters = Parameters(config.limits)
    settings = read_settings(parameters)
    assert (settings.fps, settings.depth_rate, settings.quality, settings.depth_gpio) == (30, 30, Quality.FULL, 1)
    assert (settings.filters.mindepth, settings.filters.maxdepth) == (0.2, 10.0)
    with pytest.raises(ParameterError, match=r"maxdepth: 11 .* 0\.2 to 10 "):
        parameters.set("rc_stereomatching", [("maxdepth", 11)])
    parameters.set("rc_iocontrol", [("out1_mode", "ExposureAlternateActive")])
    assert read_settings(parameters).camera_rate == 15.0, "every second exposure is for depth"
    parameters.reset("rc_stereomatching")
    assert parameters.values("rc_stereomatching")["quality"] == "Full"


def test_the_smallest_profile(tmp_path: Path) -> None:
    config = config_of(Settings(stereo_profile=write(tmp_path, MINIMAL)))
    k = config.model.intrinsics(2)
    assert (k.width, k.height, k.cx, k.cy) == (320, 200, 160.0, 100.0)
    assert k.focal_length == pytest.approx(352.0)
    assert (config.color, config.projector, config.depth_mode, config.image_noise) == (True, False, "matched", 1.0)
    assert config.model.disparity_count(1, 0.1) == 282  # ceil(704 * 0.05 / (2.5 * 0.05))


def test_the_page_shows_every_key_and_its_example_is_valid(tmp_path: Path) -> None:
    (example,) = re.findall(r"```toml\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    profile = read_profile(write(tmp_path, example))
    for section in (Profile, StereoSection, DepthSection, ProjectorSection, ColorSection):
        for field in msgspec.structs.fields(section):
            assert re.search(rf"^(\[{field.name}\]|{field.name} =)", example, re.MULTILINE), field.name
    assert profile.model.intrinsics().cx == 322.0
    assert profile.limits.depth_rates[Quality.MEDIUM] == 15.0
    assert profile.limits.depth_rates[Quality.FULL] == 60.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "missing required field `name`"),
        ("name = ", "Invalid value"),
        (MINIMAL + "basline = 1\n", "unknown field `basline` - at `stereo`"),
        (MINIMAL.replace("640", "15"), r"`int` >= 16 - at `stereo.size\[0\]`"),
        (MINIMAL.replace("704.0", '"704"'), "Expected `float`, got `str` - at `stereo.focal_length`"),
        (MINIMAL.replace("704.0", "1e5"), "stereo.focal_length is 100000, .* 640 .* 32 to 12800"),
        (MINIMAL.replace("640, 400", "8192, 8192"), "stereo.size: 8192x8192 .* 67108864 .* 16777216"),
        (COLOR.replace("64, 64", "8192, 4096") + "900\n", "color.size: 8192x4096 .* 33554432"),
        (COLOR + "1e-9\n", "color.focal_length is 1e-09, .* 3.2 to 1280"),
        (MINIMAL + "[depth]\nrange = [2, 1]\n", "depth.range: 2 .* 1"),
        (MINIMAL + "[depth]\nrange = [0.01, 0.1]\n", "depth.range: .* 0.1 m"),
        (MINIMAL + '[depth]\nquality = "full"\n', "'full' - at `depth.quality`"),
        (COLOR + "9\nrotation = [0, 0, 0, 0]\n", "color.rotation .* 0, .* 0.001"),
        (COLOR + "9\nrotation = [1e-300, 0, 0, 0]\n", "color.rotation .* 1e-300, .* 0.001"),
        ("#" * (MAX_FILE_BYTES + 1), str(MAX_FILE_BYTES)),
    ],
)
def test_invalid_profiles_are_one_sentence(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(ProfileError, match=r"camera profile .*camera\.toml.*" + message):
        read_profile(write(tmp_path, text))


def test_unknown_profiles_name_the_shipped_ones() -> None:
    with pytest.raises(ProfileError, match=r"no camera profile 'kinect': use rc_visard_160c, .* or a \.toml file"):
        read_profile("kinect")
    with pytest.raises(ProfileError, match="No such file"):
        read_profile("missing.toml")


def test_text_of_a_camera() -> None:
    camera = parse_mounted_camera('profile=rgbd;name=wrist; ["robot", "a;b"]')
    assert (camera.name, camera.profile, camera.mount) == ("wrist", "rgbd", '["robot", "a;b"]')
    assert parse_mounted_camera("eye=1,0,0;target=0,0,0").name == ""
    for text, message in (
        ("name=a;name=b;0,0,0,1,0,0,0", "name= twice"),
        ("name=a b;0,0,0,1,0,0,0", "name='a b' .* 1 to 64"),
        ("name=1;0,0,0,1,0,0,0", "name='1' .* number"),
        ("profile=;0,0,0,1,0,0,0", "profile= without"),
        ("name=a;", "x,y,z,qw,qx,qy,qz"),
    ):
        with pytest.raises(CameraError, match=message):
            parse_mounted_camera(text)
