"""Cameras that are drawn around objects."""

import numpy as np

from gateway.datasets.scenario.camera_paths import CLEARANCE, draw_cameras
from gateway.datasets.scenario.tables import Shell


def test_eyes_are_outside_of_all_objects() -> None:
    """Half of the distances end in one of two boxes, which leave a gap of their own width between them."""
    boxes = np.array((((-3.0, -1.0, -1.0), (-1.0, 1.0, 1.0)), ((1.0, -1.0, -1.0), (3.0, 1.0, 1.0))))
    shell = Shell(count=200, distance=(0.0, 6.0), elevation=(-5.0, 5.0))
    cameras = draw_cameras(shell, boxes, None, np.random.default_rng(1))
    eyes = np.array([np.array(camera.X_world_camera[0])[:3, 3] for camera in cameras])
    near, far = boxes[:, 0] - CLEARANCE, boxes[:, 1] + CLEARANCE
    is_inside = ((near <= eyes[:, None]) & (eyes[:, None] <= far)).all(axis=2)
    assert not is_inside.any()
    assert (np.abs(eyes[:, 0]) < 1.0).any()  # in the gap
    assert (np.abs(eyes[:, 0]) > 3.0).any()
