"""Key light on surfaces and in shadow."""

import numpy as np
from numpy.typing import NDArray

from renderers import primitives
from renderers.camera import Camera
from renderers.drawlist import DrawList, Instance, Material
from renderers.interface import Look, Output
from renderers.light_rig import CameraLight, KeyLight
from renderers.raster import CpuRenderer
from renderers.shading.camera_light import MAX_KEY_FACTOR

KEY_LIGHT = 0.8
LIT = 1.0 + KEY_LIGHT / 0.5


def looking_down() -> Camera:
    """Return a camera 2 m above the ground that looks straight down."""
    X_world_camera = np.array(((1.0, 0, 0, 0), (0, -1, 0, 0), (0, 0, -1, 2), (0, 0, 0, 1)))
    return Camera(64, 48, 60.0, 60.0, 32.0, 24.0, 0.01, 100.0, X_world_camera)


def light_above() -> Camera:
    """Return the camera of a light that shines straight down from 100 m, with texels of 5 cm."""
    X_world_light = np.array(((1.0, 0, 0, 0), (0, -1, 0, 0), (0, 0, -1, 100), (0, 0, 0, 1)))
    return Camera(128, 128, 2000.0, 2000.0, 64.0, 64.0, 1.0, 1000.0, X_world_light)


def factors(
    shadow_depth: NDArray[np.float32], tilt: float = 0.0, material: Material | None = None, side: float = 10.0
) -> NDArray[np.float32]:
    """Return the factors on a box whose top is the ground, turned by ``tilt`` radians about x."""
    pose = np.eye(4)
    pose[1:3, 1:3] = (np.cos(tilt), -np.sin(tilt)), (np.sin(tilt), np.cos(tilt))
    pose = pose @ np.diag((side, side, 1.0, 1.0))
    pose[:3, 3] = pose[:3, 2] * -0.5
    key = KeyLight(KEY_LIGHT, light_above(), shadow_depth, 0.0005)
    look = Look("gltf", camera_light=CameraLight((0.0, 0.0, 2.0), 0.0, 0.5, 0.5, key=key))
    scene = DrawList((Instance(primitives.box(), material or Material(), pose, 1, 1),))
    renderer = CpuRenderer(1)
    frame = renderer.render(scene, looking_down(), Output.COLOR | Output.KEY_FACTOR, look)
    renderer.close()
    return frame.key_factor[:, :64]


def test_key_light_reaches_what_it_sees() -> None:
    shadow_depth = np.full((128, 128), 100.0, np.float32)
    np.testing.assert_allclose(factors(shadow_depth), LIT, rtol=1e-5)
    np.testing.assert_allclose(factors(shadow_depth, material=Material(unlit=True)), LIT, rtol=1e-5)
    shadow_depth[:, :64] = 99.0  # something 1 m above the ground
    half = factors(shadow_depth)
    assert (half[:, :28] == 1.0).all()
    np.testing.assert_allclose(half[:, 36:], LIT, rtol=1e-5)
    assert len(np.unique(half[24, 28:36])) > 2, "a soft edge"
    assert (np.diff(half[24]) >= 0).all()
    shadow_depth[:] = np.inf
    np.testing.assert_allclose(factors(shadow_depth, np.pi / 3)[24, 20:44], 1.0 + KEY_LIGHT, rtol=1e-5)
    assert factors(shadow_depth).max() <= MAX_KEY_FACTOR
    small = factors(shadow_depth, side=0.5)
    assert (small[:16] == 1.0).all(), "the background"
    assert small[24, 32] > 2.0
