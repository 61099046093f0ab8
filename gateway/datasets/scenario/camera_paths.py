"""Draws cameras around objects: single poses on a shell, and smooth paths of a hand that holds a camera."""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.datasets.scenario.choices import CameraChoice
from gateway.datasets.scenario.tables import Fixed, FrameRange, Handheld, Range, Shell
from gateway.scene.tree.transforms import look_at
from scenegate.datasets.manifest import pose_rows
from scenegate.transforms import Matrix

DEFAULT_FRAMES: Final = FrameRange(count=1)
CLEARANCE: Final = 0.02
"""Minimum distance of a camera from the boxes of objects, metres."""
_TRIES: Final = 100
"""Maximum number of places that are drawn until the eye is outside of all boxes."""
_SHAKE_HERTZ: Final = (1.1, 2.3, 4.7)
"""Frequencies of a hand's shaking."""
_SHAKE_SHARES: Final = (1.0, 1.0 / 2.0, 1.0 / 3.0)
"""Amplitude at each of these frequencies, as a multiple of that at the first one."""


def uniform(random: np.random.Generator, values: Range[float]) -> float:
    """Return a number that is drawn uniformly from a range."""
    if not isinstance(values, tuple):
        return float(values)
    low, high = values
    return low + (high - low) * float(random.random())


class _Orbit(NamedTuple):
    """Place of a camera on a sphere around its target, +z up."""

    distance: float
    """Metres."""
    elevation: float
    """Degrees."""
    azimuth: float
    """Degrees counter-clockwise from +x."""
    target: NDArray[np.float64]
    """(3,) in the world, metres."""

    def eye(self) -> NDArray[np.float64]:
        """Return the camera's position in the world, (3,)."""
        elevation, azimuth = math.radians(self.elevation), math.radians(self.azimuth)
        horizontal = math.cos(elevation)
        direction = (horizontal * math.cos(azimuth), horizontal * math.sin(azimuth), math.sin(elevation))
        return np.asarray(self.target + self.distance * np.array(direction))

    def X_world_camera(self, roll: float) -> Matrix:
        """Return the pose of a camera that looks at the target, turned by ``roll`` degrees about its line of sight."""
        X = look_at(self.eye(), self.target, (0.0, 0.0, 1.0))
        c, s = math.cos(math.radians(roll)), math.sin(math.radians(roll))
        right, down = X[:3, 0].copy(), X[:3, 1].copy()
        X[:3, 0], X[:3, 1] = c * right + s * down, c * down - s * right
        return X


def draw_cameras(
    camera: Shell | Fixed, boxes: NDArray[np.float64], frames: FrameRange | None, random: np.random.Generator
) -> list[CameraChoice]:
    """Return the cameras of a table of the scenario (``Handheld`` is a ``Shell``); None: the scene does not move.

    ``boxes``: (N, 2, 3) boxes of the objects in the world, metres; at least one.
    """
    if isinstance(camera, Fixed):
        pose = look_at(camera.eye, camera.target, camera.up)
        return [CameraChoice(fovy=uniform(random, camera.fovy), X_world_camera=(pose_rows(pose),))]
    choices = []
    for _ in range(camera.count):
        fovy = uniform(random, camera.fovy)
        if isinstance(camera, Handheld):
            poses = _handheld_poses(camera, boxes, fovy, frames or DEFAULT_FRAMES, random)
        else:
            orbit = _draw_orbit(camera, boxes, fovy, random)
            poses = [orbit.X_world_camera(uniform(random, camera.roll))]
        choices.append(CameraChoice(fovy=fovy, X_world_camera=tuple(map(pose_rows, poses))))
    return choices


def _draw_orbit(camera: Shell, boxes: NDArray[np.float64], fovy: float, random: np.random.Generator) -> _Orbit:
    """Return a place whose eye is outside of all boxes, or the last one drawn if ``_TRIES`` are not."""
    low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
    fitting_distance = 0.5 * float(np.linalg.norm(high - low)) / math.sin(math.radians(0.5 * fovy))
    for _ in range(_TRIES):
        if camera.look_at == "objects":
            target = 0.5 * (low + high)
        elif camera.look_at == "object":
            target = boxes[int(random.integers(len(boxes)))].mean(axis=0)
        else:
            target = np.array(camera.look_at)
        if camera.distance is None:
            distance = fitting_distance * uniform(random, camera.margin)
        else:
            distance = uniform(random, camera.distance)
        orbit = _Orbit(distance, uniform(random, camera.elevation), uniform(random, camera.azimuth), target)
        if not _is_in_a_box(orbit.eye(), boxes):
            break
    return orbit


def _is_in_a_box(eye: NDArray[np.float64], boxes: NDArray[np.float64]) -> bool:
    """Return True if a point is in a box, or nearer to it than ``CLEARANCE``."""
    is_inside = (boxes[:, 0] - CLEARANCE < eye) & (eye < boxes[:, 1] + CLEARANCE)  # (box, axis)
    return bool(is_inside.all(axis=1).any())


def _handheld_poses(
    camera: Handheld, boxes: NDArray[np.float64], fovy: float, frames: FrameRange, random: np.random.Generator
) -> list[Matrix]:
    """Return X_world_camera of each frame: a curve through drawn way-points, and the shaking of a hand.

    Only the first way-point is sure to be outside of the boxes: ``sweep`` changes the azimuth of the others.
    """
    waypoints = [_draw_orbit(camera, boxes, fovy, random) for _ in range(camera.waypoints)]
    turns = camera.sweep * (random.random(camera.waypoints - 1) - 0.5)
    azimuths = waypoints[0].azimuth + np.concatenate(((0.0,), turns))
    rolls = [uniform(random, camera.roll) for _ in waypoints]
    columns = zip(waypoints, azimuths, rolls, strict=True)
    knots = np.array([(each.distance, each.elevation, azimuth, *each.target, roll) for each, azimuth, roll in columns])
    poses = []
    for frame, (target_shift, eye_shift) in enumerate(_hand_shake(camera.shake, frames, random)):
        position = (camera.waypoints - 1) * frame / max(frames.count - 1, 1)
        distance, elevation, azimuth, *target, roll = _on_curve(knots, position)
        X = _Orbit(distance, elevation, azimuth, np.array(target) + target_shift).X_world_camera(roll)
        X[:3, 3] += eye_shift
        poses.append(X)
    return poses


def _on_curve(knots: NDArray[np.float64], position: float) -> NDArray[np.float64]:
    """Return the values, (M,), on the Catmull-Rom curve through knots, (N, M), at a position from 0 to N - 1."""
    last = len(knots) - 1
    index = min(int(position), last - 1)
    begin, end = knots[index], knots[index + 1]
    before, after = knots[max(index - 1, 0)], knots[min(index + 2, last)]
    t = position - index  # 0 at begin, 1 at end
    linear, quadratic = end - before, 2 * before - 5 * begin + 4 * end - after
    cubic = 3 * begin - before - 3 * end + after
    return np.asarray(0.5 * (2 * begin + linear * t + quadratic * t**2 + cubic * t**3))


def _hand_shake(amplitude: float, frames: FrameRange, random: np.random.Generator) -> NDArray[np.float64]:
    """Return the shifts of target and eye in each frame, (frames, 2, 3), metres."""
    seconds = np.arange(frames.count) / frames.rate
    cycles = np.multiply.outer(_SHAKE_HERTZ, seconds)[..., None]  # (frequency, frame, coordinate)
    phases = math.tau * random.random((len(_SHAKE_HERTZ), 1, 6))
    shifts = amplitude * np.tensordot(_SHAKE_SHARES, np.sin(math.tau * cycles + phases), axes=1)
    return shifts.reshape(-1, 2, 3)
