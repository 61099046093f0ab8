"""Poses of an SDF document, limits and thread pitch of its joints.

http://sdformat.org/tutorials?tut=pose_frame_semantics_proposal
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from scenegate.robots.xml_text import (
    Element,
    attribute,
    children_as_attributes,
    finite_numbers,
    is_true,
    numbers,
    pose_of_rpy,
)
from scenegate.transforms import IDENTITY, from_pose

WORLD: Final = "world"
_MAX_DEPTH: Final = 100
"""Maximum length of a chain of frames that are relative to each other."""


@dataclass(frozen=True, slots=True)
class Frame:
    """A link, joint, model or ``<frame>``."""

    X: NDArray[np.float64]
    """(4, 4) float64: pose in the frame ``relative_to``."""
    relative_to: str
    """Full name of a frame."""
    attached_to: str
    """Full name of the frame that this one moves with; its own name for a link."""
    placement: str = ""
    """Full name of the frame in the model that ``X`` places; empty: the model's own frame."""


class Frames:
    """Frames of a document by full name: ``model::nested::link``. The world is the frame ``world``."""

    def __init__(self, warnings: list[str]) -> None:
        self._warnings = warnings
        self._frames: dict[str, Frame] = {}
        self._poses: dict[tuple[str, str], NDArray[np.float64]] = {}
        """Poses by frame and base."""
        self._in_progress: set[tuple[str, str]] = set()
        """Frames and bases whose poses are being computed."""

    def __contains__(self, name: str) -> bool:
        return name == WORLD or name in self._frames

    def add(self, name: str, frame: Frame) -> None:
        """Add a frame."""
        self._frames[name] = frame

    def X_world(self, name: str) -> NDArray[np.float64]:
        """Return the (4, 4) pose of a frame in the world."""
        return self._pose(name, WORLD)

    def link_of(self, name: str) -> str:
        """Return the full name of the link that a frame moves with; ``world`` if there is none."""
        for _ in range(_MAX_DEPTH):
            frame = self._frames.get(name)
            if frame is None:
                return WORLD
            if frame.attached_to == name:
                return name
            name = frame.attached_to
        return WORLD

    def _pose(self, name: str, base: str) -> NDArray[np.float64]:
        """Return the pose of a frame in the frame ``base``, which is the world or a model around it."""
        if name in (base, WORLD):
            return IDENTITY
        key = (name, base)
        if key in self._poses:
            return self._poses[key]
        frame = self._frames.get(name)
        if frame is None:
            self._warnings.append(f"there is no frame {name[:60]!r}; the world is used")
            return IDENTITY
        if key in self._in_progress or len(self._in_progress) > _MAX_DEPTH:
            self._warnings.append(f"the frame {name[:60]!r} is relative to itself or to too many others; it is ignored")
            return IDENTITY
        self._in_progress.add(key)
        X = self._pose(frame.relative_to, base) @ frame.X
        if frame.placement:
            X = X @ np.linalg.inv(self._pose(frame.placement, name))
        self._in_progress.remove(key)
        self._poses[key] = X
        return X


def read_pose(element: Element, where: str, warnings: list[str]) -> tuple[NDArray[np.float64], str]:
    """Return the (4, 4) pose of an element's ``<pose>``, and the name in ``relative_to``, which may be empty."""
    pose = element.find("pose")
    if pose is None:
        return IDENTITY, ""
    text = (pose.text or "").strip()
    relative_to = attribute(pose, "relative_to") or attribute(pose, "frame")  # its name before SDF 1.7
    rotation_format = attribute(pose, "rotation_format")
    if rotation_format not in ("", "euler_rpy", "quat_xyzw"):
        warnings.append(f"{where}: rotation_format={rotation_format[:60]!r} is neither euler_rpy nor quat_xyzw")
    is_quaternion = rotation_format == "quat_xyzw"
    numbers = finite_numbers(text)
    if not text:
        return IDENTITY, relative_to
    if len(numbers) != (7 if is_quaternion else 6):
        warnings.append(
            f"{where}: <pose>{text[:60]}</pose> must be {7 if is_quaternion else 6} finite numbers, no pose"
        )
        return IDENTITY, relative_to
    if is_quaternion:
        x, y, z, w = numbers[3:]
        return from_pose(numbers[:3], (w, x, y, z)), relative_to
    angles = np.deg2rad(numbers[3:]) if is_true(attribute(pose, "degrees")) else np.array(numbers[3:])
    return pose_of_rpy(numbers[:3], angles.tolist()), relative_to


def limits_of(axis: Element | None, where: str, warnings: list[str]) -> tuple[float, float] | None:
    """Return the limits of a joint's axis; None if there are none."""
    limit = axis.find("limit") if axis is not None else None
    if limit is None:
        return None
    texts = children_as_attributes(limit)
    values = []
    for name, default in (("lower", -1e16), ("upper", 1e16)):
        text = attribute(texts, name).lower()
        infinite = text.lstrip("+-") in ("inf", "infinity")
        values.append(default if infinite else numbers(texts, name, (default,), where, warnings)[0])
    return (values[0], values[1]) if max(map(abs, values)) < 1e16 else None


def thread_pitch(joint: Element, where: str, warnings: list[str]) -> float:
    """Return the translation of a screw joint, metres per radian. As in libsdformat, the default is 1 m per turn."""
    texts = children_as_attributes(joint)
    if "screw_thread_pitch" in texts.attrib:  # metres per turn
        return numbers(texts, "screw_thread_pitch", (1.0,), where, warnings)[0] / math.tau
    (negative_radians_per_metre,) = numbers(texts, "thread_pitch", (-math.tau,), where, warnings)
    if negative_radians_per_metre == 0.0:
        warnings.append(f"{where}: its thread_pitch is 0; it turns without moving")
        return 0.0
    return -1.0 / negative_radians_per_metre
