"""Settings of the stereo camera."""

from pathlib import Path

import numpy as np
import pytest

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.runtime.settings import Settings, SettingsError, load
from gateway.wiring.stereo import config_of
from renderers.stereo.realism import REALISM_PARTS
from renderers.stereo.sensor.camera_image import NoiseStream, frame_key
from renderers.stereo.sensor.exposure import Exposure
from tests.adapters.stereo.camera_images import sensor_image


def test_the_defaults_are_the_device_s() -> None:
    config = config_of(Settings(grpc_port=50051))
    assert config == StereoConfig(background=config.background, realism=frozenset(REALISM_PARTS))


def test_image_noise_is_a_factor() -> None:
    grey = np.full((200, 200, 3), 120, np.uint8)
    key = frame_key(1, 1, NoiseStream.LEFT)
    images = [sensor_image(grey, Exposure(gain=18.0), key, noise_factor=n).image for n in (0.0, 1.0, 3.0)]
    deviation = [float(image.std()) for image in images]
    assert deviation[0] == 0.0
    assert 2.8 < deviation[2] / deviation[1] < 3.2


def test_realism_is_all_by_default(tmp_path: Path) -> None:
    assert config_of(load()).realism == {*REALISM_PARTS}
    assert config_of(load({"stereo_realism": "off"})).realism == frozenset()
    assert config_of(load({"stereo_realism": "vignetting,shadows"})).realism == {"vignetting", "shadows"}
    path = tmp_path / "camera.toml"
    path.write_text('stereo_realism = ["projector"]\n')
    assert config_of(load(config=path)).realism == {"projector"}
    with pytest.raises(SettingsError, match="'haze'"):
        load({"stereo_realism": "haze"})
