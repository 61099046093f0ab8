"""Draws cameras around objects: single poses on a shell, and smooth paths of a hand that holds a camera."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.datasets.scenario.choices import CameraChoice
from gateway.datasets.scenario.tables import Fixed, FrameRange, Handheld, Range, Shell
from gateway.scene.transforms import look_at
from scenegate.datasets.manifest import pose_rows
from scenegate.transforms import Matrix

DEFAULT_FRAMES: Final = FrameRange(count=1)
CLEARANCE: Final = 0.02
"""Minimum distance of a camera from the boxes of objects, metres."""
_TRIES: Final = 100
"""Number of places that are drawn until one is outside of all boxes."""
_SHAKE_HERTZ: Final = (1.1, 2.3, 4.7)
"""Frequencies of a hand's shaking; the amplitude of each is the first one's divided by its number, from 1."""
_AZIMUTH: Final = 2
"""Index of the azimuth in a place (``_draw_place``)."""


def uniform(random: np.random.Generator, values: Range[float]) -> float:
    """Return a number that is drawn uniformly from a range."""
    if not isinstance(values, tuple):
        return float(values)
    low, high = values
    return low + (high - low) * float(random.random())


def draw_cameras(
    camera: Shell | Fixed, boxes: NDArray[np.float64], frames: FrameRange | None, random: np.random.Generator
) -> list[CameraChoice]:
    """Return the cameras of a table of the scenario.

    Args:
        boxes: (N, 2, 3) boxes of the objects in the world, metres.
        frames: frames of the scene; None if it does not move.
    """
    if isinstance(camera, Fixed):
        pose = look_at(camera.eye, camera.target, camera.up)
        return [CameraChoice(fovy=uniform(random, camera.fovy), X_world_camera=(pose_rows(pose),))]
    choices = []
    for _ in range(camera.count):
        fovy = uniform(random, camera.fovy)
        if isinstance(camera, Handheld):
            poses = _path(camera, boxes, fovy, frames or DEFAULT_FRAMES, random)
        else:
            place, roll = _draw_place(camera, boxes, fovy, random), uniform(random, camera.roll)
            poses = [_pose(place, roll)]
        choices.append(CameraChoice(fovy=fovy, X_world_camera=tuple(map(pose_rows, poses))))
    return choices


def _draw_place(
    camera: Shell, boxes: NDArray[np.float64], fovy: float, random: np.random.Generator
) -> NDArray[np.float64]:
    """Return distance, elevation and azimuth (metres, degrees) and the target, (6,) float64.

    The eye is outside of all boxes unless the ranges allow no such place.
    """
    low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
    fitted = 0.5 * float(np.linalg.norm(high - low)) / math.sin(math.radians(0.5 * fovy))
    for _ in range(_TRIES):
        if camera.look_at == "objects":
            target = 0.5 * (low + high)
        elif camera.look_at == "object":
            target = boxes[int(random.integers(len(boxes)))].mean(axis=0)
        else:
            target = np.array(camera.look_at)
        distance = (
            fitted * uniform(random, camera.margin) if camera.distance is None else uniform(random, camera.distance)
        )
        place = np.array((distance, uniform(random, camera.elevation), uniform(random, camera.azimuth), *target))
        eye = _eye(place)
        if not ((boxes[:, 0] - CLEARANCE < eye) & (eye < boxes[:, 1] + CLEARANCE)).all(axis=1).any():
            break
    return place


def _eye(place: NDArray[np.float64]) -> NDArray[np.float64]:
    distance, elevation, azimuth = place[0], math.radians(place[1]), math.radians(place[2])
    direction = (math.cos(elevation) * math.cos(azimuth), math.cos(elevation) * math.sin(azimuth), math.sin(elevation))
    return np.asarray(place[3:] + distance * np.array(direction))


def _pose(place: NDArray[np.float64], roll: float) -> Matrix:
    pose = look_at(_eye(place), place[3:], (0.0, 0.0, 1.0))
    c, s = math.cos(math.radians(roll)), math.sin(math.radians(roll))
    x, y = pose[:3, 0].copy(), pose[:3, 1].copy()
    pose[:3, 0], pose[:3, 1] = c * x + s * y, c * y - s * x
    return pose


def _path(
    camera: Handheld, boxes: NDArray[np.float64], fovy: float, frames: FrameRange, random: np.random.Generator
) -> list[Matrix]:
    """Return a pose for each frame: a Catmull-Rom curve through the drawn places, and the shaking of a hand."""
    places = np.array([_draw_place(camera, boxes, fovy, random) for _ in range(camera.waypoints)])
    places[1:, _AZIMUTH] = places[0, _AZIMUTH] + camera.sweep * (random.random(camera.waypoints - 1) - 0.5)
    rolls = [uniform(random, camera.roll) for _ in places]
    knots = np.column_stack((places, rolls))
    knots = np.concatenate((knots[:1], knots, knots[-1:]))  # the curve goes through all but the first and the last
    phases = math.tau * random.random((len(_SHAKE_HERTZ), 1, 6))
    seconds = np.arange(frames.count) / frames.rate
    angles = math.tau * np.multiply.outer(_SHAKE_HERTZ, seconds)[..., None] + phases
    shakes = camera.shake * np.tensordot(1.0 / np.arange(1, len(_SHAKE_HERTZ) + 1), np.sin(angles), 1)
    poses = []
    for frame, shake in enumerate(shakes):
        position = (camera.waypoints - 1) * frame / max(frames.count - 1, 1)
        first = min(int(position), camera.waypoints - 2)
        t = position - first
        a, b, c, d = knots[first : first + 4]
        # Catmull-Rom: from b to c.
        place = 0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * b - a - 3 * c + d) * t**3)
        place[3:6] += shake[:3]  # the target
        pose = _pose(place[:6], float(place[6]))
        pose[:3, 3] += shake[3:]  # the eye
        poses.append(pose)
    return poses
