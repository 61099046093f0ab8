"""Motion between two frames: the scene at times between them, and the rectangles of an image to blur."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.timestamps import NANOSECONDS_PER_SECOND
from gateway.adapters.stereo.imaging.scene_view import SceneState
from gateway.scene.draw.bounds import Bounds, corners_of, mesh_bounds
from renderers.camera import Camera
from renderers.drawlist import DrawList, Instance
from renderers.stereo.lens.motion_blur import poses_at

MIN_BLUR: Final = 1.0
"""Minimum motion during the exposure that is blurred, pixels. The lens's blur hides smaller motions."""
MAX_SUBFRAMES: Final = 7
"""Maximum number of images of a rectangle to average; odd, because the middle one is the image itself."""
MAX_EXTRA_IMAGES: Final = 4.0
"""Maximum number of pixels that are rendered for blur, as a multiple of the image's."""
MAX_INTERVAL: Final = 0.5
"""Maximum time since the previous frame, seconds. For an older one, the velocity may have changed."""
_MARGIN: Final = 2
"""Margin on each side of a rectangle, pixels."""


@dataclass(frozen=True, slots=True)
class MovingRectangle:
    """Part of an image in which something moves."""

    left: int
    top: int
    right: int
    """One past the last column."""
    bottom: int
    """One past the last row."""
    blur: float
    """Longest motion during the exposure, pixels."""

    @property
    def area(self) -> int:
        """Number of pixels."""
        return (self.right - self.left) * (self.bottom - self.top)

    def union(self, other: MovingRectangle) -> MovingRectangle:
        """Return the rectangle around both."""
        return MovingRectangle(
            min(self.left, other.left),
            min(self.top, other.top),
            max(self.right, other.right),
            max(self.bottom, other.bottom),
            max(self.blur, other.blur),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Motion of scene and camera between two frames with the same meshes (``has_equal_instances``)."""

    before: DrawList
    """Scene of the previous frame."""
    now: DrawList
    """Scene of this frame."""
    X_world_camera_before: NDArray[np.float64]
    """(4, 4) float64, pose of the rendered camera in the previous frame."""
    X_world_camera: NDArray[np.float64]
    """(4, 4) float64, pose of the rendered camera."""
    seconds: float = 1.0
    """Time between the frames."""

    def scene_at(self, time: float) -> DrawList:
        """Return the scene at a time: 0 is this frame, -1 the previous one."""
        pairs = [*zip(self.before.instances, self.now.instances, strict=True)]
        moved = [i for i, (old, new) in enumerate(pairs) if new is not old]
        instances = [*self.now.instances]
        for i, X_world_mesh in zip(moved, _poses_at([pairs[i] for i in moved], time), strict=True):
            new = instances[i]
            instances[i] = Instance(new.mesh, new.material, X_world_mesh, new.label, new.instance_id)
        return DrawList(tuple(instances), self.now.images, self.now.lights)

    def camera_at(self, time: float) -> NDArray[np.float64]:
        """Return the pose of the camera in the world at a time as for ``scene_at``, (4, 4) float64."""
        X_world_camera: NDArray[np.float64] = poses_at(
            self.X_world_camera_before[None], self.X_world_camera[None], time
        )[0]
        return X_world_camera


def motion_since(
    earlier: SceneState,
    timestamp: int,
    scene: DrawList,
    X_world_before: NDArray[np.float64],
    X_world_camera: NDArray[np.float64],
) -> Motion | None:
    """Return the motion since the previous frame; None: nothing moves, or that frame is too old or has other meshes.

    Timestamp (nanoseconds since the epoch) and scene are those of this frame. ``X_world_before`` and
    ``X_world_camera``, (4, 4) float64, are the poses of the rendered camera in both frames.
    """
    seconds = (timestamp - earlier.timestamp) / NANOSECONDS_PER_SECOND
    is_at_rest = earlier.scene is scene and np.array_equal(X_world_before, X_world_camera)
    if is_at_rest or not 0.0 < seconds <= MAX_INTERVAL or not has_equal_instances(earlier.scene, scene):
        return None
    return Motion(earlier.scene, scene, X_world_before, X_world_camera, seconds)


def has_equal_instances(before: DrawList, now: DrawList) -> bool:
    """Return True if two scenes have the same meshes in the same order. Poses and materials may differ."""
    if len(before.instances) != len(now.instances):
        return False
    return all(old is new or old.mesh is new.mesh for old, new in zip(before.instances, now.instances, strict=True))


def moving_rectangles(motion: Motion, camera: Camera, relative_exposure: float) -> list[MovingRectangle]:
    """Return disjoint rectangles of the image in which something moves by ``MIN_BLUR`` or more.

    The exposure is centred at time 0; ``relative_exposure`` is in units of the time between the frames.
    """
    camera_moves = not np.array_equal(motion.X_world_camera_before, motion.X_world_camera)
    pairs: list[tuple[Instance, Instance]] = []
    boxes: list[Bounds] = []
    for old, new in zip(motion.before.instances, motion.now.instances, strict=True):
        if (camera_moves or old is not new) and (bounds := mesh_bounds(new.mesh)) is not None:
            pairs.append((old, new))
            boxes.append(bounds)
    if not pairs:
        return []
    corners = corners_of(np.array(boxes))
    begin, end = (
        _transformed(corners, np.linalg.inv(motion.camera_at(time)) @ _poses_at(pairs, time))
        for time in (-0.5 * relative_exposure, 0.5 * relative_exposure)
    )
    rectangles: list[MovingRectangle] = []
    for rectangle in _rectangles_of_boxes(begin, end, camera):
        rectangles = _add_disjoint(rectangles, rectangle)
    return rectangles


def subframe_count(rectangle: MovingRectangle, total_area: int, image_area: int) -> int:
    """Return the odd number of images to average for a rectangle: about one per pixel of blur, within the limits.

    Areas, of all rectangles and of the image, are in pixels.
    """
    affordable = 1 + int(MAX_EXTRA_IMAGES * image_area / max(total_area, 1))
    count = min(math.ceil(rectangle.blur) | 1, MAX_SUBFRAMES, (affordable - 1) | 1)
    return max(count, 3)


def _poses_at(pairs: Sequence[tuple[Instance, Instance]], time: float) -> NDArray[np.float64]:
    """Return the poses at a time of instances in the previous frame and in this one, (N, 4, 4) float64."""
    X_world_before = np.array([old.X_world_mesh for old, _ in pairs]).reshape(-1, 4, 4)
    X_world_now = np.array([new.X_world_mesh for _, new in pairs]).reshape(-1, 4, 4)
    return poses_at(X_world_before, X_world_now, time)


def _transformed(points: NDArray[np.float64], X: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points (N, P, 3) transformed by X (N, 4, 4)."""
    return points @ X[:, :3, :3].transpose(0, 2, 1) + X[:, None, :3, 3]


def _rectangles_of_boxes(
    begin: NDArray[np.float64], end: NDArray[np.float64], camera: Camera
) -> Iterator[MovingRectangle]:
    """Yield the part of the image that each moving box covers, without those that move less than ``MIN_BLUR``.

    ``begin`` and ``end``, (N, 8, 3) float64, are the corners in the camera's frame at both ends of the exposure.
    """
    depth = np.concatenate((begin[:, :, 2], end[:, :, 2]), axis=1)
    nearest, farthest = depth.min(axis=1), depth.max(axis=1)
    if ((nearest <= camera.near) & (farthest > camera.near)).any():
        # The motion of a box that reaches behind the camera has no limit in the image.
        yield MovingRectangle(0, 0, camera.width, camera.height, float(MAX_SUBFRAMES))
    focal, center = np.array((camera.fx, camera.fy)), np.array((camera.cx, camera.cy))
    is_ahead = nearest > camera.near
    first, last = (points[is_ahead, :, :2] / points[is_ahead, :, 2:] * focal + center for points in (begin, end))
    blur = np.sqrt(((last - first) ** 2).sum(axis=2)).max(axis=1)
    both = np.concatenate((first, last), axis=1)
    size = np.array((camera.width, camera.height))
    low = np.clip(np.floor(both.min(axis=1)) - _MARGIN, 0, size).astype(int)
    high = np.clip(np.ceil(both.max(axis=1)) + _MARGIN, 0, size).astype(int)
    for i in np.flatnonzero((blur >= MIN_BLUR) & (high > low).all(axis=1)):
        yield MovingRectangle(int(low[i, 0]), int(low[i, 1]), int(high[i, 0]), int(high[i, 1]), float(blur[i]))


def _add_disjoint(rectangles: list[MovingRectangle], new: MovingRectangle) -> list[MovingRectangle]:
    """Return disjoint rectangles that cover disjoint ones and a new one. Overlapping rectangles are merged."""
    for other in rectangles:
        overlaps = (
            new.left < other.right and other.left < new.right and new.top < other.bottom and other.top < new.bottom
        )
        if overlaps:
            return _add_disjoint([each for each in rectangles if each is not other], new.union(other))
    return [*rectangles, new]
