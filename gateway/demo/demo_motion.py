"""Poses of the demo scene as a function of time."""

import math
from typing import Final

from gateway.scene.tree.nodes import Path, Pose

PERIOD: Final = 24.0
"""Period of the whole scene, seconds: a recording of this length can be looped."""
CRYSTAL_BALL: Final = (0.72, -1.0, 0.62)
"""Position of the crystal ball, metres. It is below the default view of the stereo camera: stereo matching fails on
transparent objects."""
ORBIT_RADIUS: Final = 0.17
"""Radius of the ring around the crystal ball, metres."""
_X: Final = (1.0, 0.0, 0.0)
_Y: Final = (0.0, 1.0, 0.0)
_Z: Final = (0.0, 0.0, 1.0)


def poses(t: float) -> dict[Path, Pose]:
    """Return the pose of every moving node, relative to its parent, at time ``t`` in seconds."""
    phase = 2.0 * math.pi * (t / PERIOD)
    shoulder, elbow = 0.55 + 0.25 * math.sin(2 * phase), 1.15 + 0.35 * math.sin(2 * phase + 1.2)
    wrist = math.pi - shoulder - elbow + 0.2 * math.sin(4 * phase)
    grip = 0.035 + 0.02 * math.sin(6 * phase)
    base: Path = ("robot",)
    upper_arm: Path = (*base, "turret", "upper arm")
    hand: Path = (*upper_arm, "forearm", "wrist")
    roll = 3 * phase
    bounce = abs(math.sin(4 * phase))
    return {
        base: _pose((-0.35, 0.0, 0.75)),
        (*base, "turret"): _pose((0.0, 0.0, 0.12), _Z, 0.9 * math.sin(phase)),
        upper_arm: _pose((0.0, 0.0, 0.14), _Y, shoulder),
        (*upper_arm, "forearm"): _pose((0.0, 0.0, 0.40), _Y, elbow),
        hand: _pose((0.0, 0.0, 0.36), _Y, wrist),
        (*hand, "left finger"): _pose((0.0, grip, 0.10)),
        (*hand, "right finger"): _pose((0.0, -grip, 0.10)),
        ("turntable",): _pose((0.30, -0.28, 0.76), _Z, 2 * phase),
        ("crystal ball",): _pose((*CRYSTAL_BALL,), _Z, -phase),
        ("bouncing ball",): _pose((0.02, 0.36, 0.80 + 0.22 * bounce), _X, roll),
        ("satellite",): _pose(
            (
                CRYSTAL_BALL[0] + ORBIT_RADIUS * math.cos(3 * phase),
                CRYSTAL_BALL[1] + ORBIT_RADIUS * math.sin(3 * phase),
                CRYSTAL_BALL[2],
            )
        ),
        ("drone",): _pose(
            (0.9 * math.cos(phase), 0.9 * math.sin(phase), 1.75 + 0.06 * math.sin(5 * phase)),
            _Z,
            phase + 0.5 * math.pi,
        ),
        ("drone", "rotor 1"): _pose((0.11, 0.11, 0.03), _Z, 40 * phase),
        ("drone", "rotor 2"): _pose((-0.11, 0.11, 0.03), _Z, -40 * phase),
        ("drone", "rotor 3"): _pose((-0.11, -0.11, 0.03), _Z, 40 * phase),
        ("drone", "rotor 4"): _pose((0.11, -0.11, 0.03), _Z, -40 * phase),
        ("scanner",): _pose((0.0, 0.95, 0.0), _Z, -0.5 * math.pi),
    }


def _pose(position: tuple[float, float, float], axis: tuple[float, float, float] = _Z, angle: float = 0.0) -> Pose:
    """Return a pose from a position in metres and a rotation about a unit axis in radians."""
    sine = math.sin(0.5 * angle)
    return (*position, math.cos(0.5 * angle), sine * axis[0], sine * axis[1], sine * axis[2])
