"""Key light on surfaces and in shadow."""

from __future__ import annotations

import numpy as np

from renderers.camera import Camera
from renderers.stereo.light.scene_light import FACTOR_ONE, light_factors

KEY_LIGHT = 0.8
OTHER_LIGHT = np.full((48, 64), 0.5, np.float32)


def looking_down() -> Camera:
    """Return a camera 2 m above the ground that looks straight down."""
    X_world_camera = np.array(((1.0, 0, 0, 0), (0, -1, 0, 0), (0, 0, -1, 2), (0, 0, 0, 1)))
    return Camera(64, 48, 60.0, 60.0, 32.0, 24.0, 0.01, 100.0, X_world_camera)


def light_above(offset: float = 0.0) -> Camera:
    """Return the camera of a light that shines straight down from 100 m, with texels of 5 cm."""
    X_world_light = np.array(((1.0, 0, 0, offset), (0, -1, 0, 0), (0, 0, -1, 100), (0, 0, 0, 1)))
    return Camera(128, 128, 2000.0, 2000.0, 64.0, 64.0, 1.0, 1000.0, X_world_light)


def test_key_light_reaches_what_it_sees() -> None:
    depth = np.full((48, 64), 2.0, np.float32)
    normal = np.zeros((48, 64, 3), np.float32)
    normal[:, :, 2] = -1.0  # up
    shadow_depth = np.full((128, 128), 100.0, np.float32)
    open_ground = light_factors(depth, normal, looking_down(), shadow_depth, light_above(), OTHER_LIGHT, KEY_LIGHT)
    assert (open_ground == round((1.0 + KEY_LIGHT / 0.5) * FACTOR_ONE)).all()
    shadow_depth[:, :64] = 99.0  # something 1 m above the ground
    half = light_factors(depth, normal, looking_down(), shadow_depth, light_above(), OTHER_LIGHT, KEY_LIGHT)
    assert (half[:, :28] == FACTOR_ONE).all()
    assert (half[:, 36:] == round((1.0 + KEY_LIGHT / 0.5) * FACTOR_ONE)).all()
    assert len(np.unique(half[24, 28:36])) > 2, "a soft edge"
    assert (np.diff(half[24].astype(int)) >= 0).all()
    normal[:, :, 2] = 1.0 / np.sqrt(2)
    normal[:, :, 1] = 1.0 / np.sqrt(2)  # away from the light
    back = light_factors(depth, normal, looking_down(), shadow_depth, light_above(), OTHER_LIGHT, KEY_LIGHT)
    assert (back == FACTOR_ONE).all()
    depth[:] = np.inf
    empty = light_factors(depth, normal, looking_down(), shadow_depth, light_above(), OTHER_LIGHT, KEY_LIGHT)
    assert (empty == FACTOR_ONE).all()
