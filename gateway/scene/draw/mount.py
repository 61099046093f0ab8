"""Mount of a stereo camera, a fixed pose or a node of the tree, as users write it."""

import re
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.scene.draw.cameras import CameraError, LookAtCamera, NodeCamera, parse_camera
from gateway.scene.tree.nodes import Path
from gateway.scene.tree.transforms import from_pose, look_at


def parse_mount_pose(text: str) -> NDArray[np.float64]:
    """Parse the pose of an optical frame: ``x,y,z,qw,qx,qy,qz`` or ``eye=x,y,z;target=x,y,z;up=x,y,z``.

    Returns X_world_camera, (4, 4). Raises CameraError if the text has neither form.
    """
    if "=" in text:
        camera = parse_camera(text)
        if isinstance(camera, LookAtCamera):
            return look_at(camera.eye, camera.target, camera.up)
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 7 or not np.isfinite(numbers).all() or not any(numbers[3:]):
        raise CameraError(f"pose {text!r} is neither x,y,z,qw,qx,qy,qz nor eye=x,y,z;target=x,y,z;up=x,y,z")
    return from_pose(numbers[:3], numbers[3:])


def mount_pose_text(X_world_camera: NDArray[np.float64]) -> str:
    """Return the pose of an optical frame, (4, 4), as ``eye=x,y,z;target=x,y,z;up=x,y,z``, rounded to micrometres.

    The target is 1 m in front of the eye.
    """
    _, down, forward, eye = X_world_camera[:3].T
    vectors = {"eye": eye, "target": eye + forward, "up": -down}
    return ";".join(f"{name}={','.join(map(_plain, vector))}" for name, vector in vectors.items())


def _plain(number: float) -> str:
    """Return a number with at most six decimals and without an exponent."""
    return f"{round(number, 6) + 0.0:.6f}".rstrip("0").rstrip(".")


def parse_mount_path(text: str) -> Path:
    """Parse a path of the tree from JSON such as ``["robot", "head"]``. Raises CameraError for another text."""
    camera = parse_camera(f"path:{text}")
    assert isinstance(camera, NodeCamera)
    return camera.path


_OPTION: Final = re.compile(r"(name|profile)=([^;]*);")
_NAME: Final = re.compile(r"[A-Za-z0-9_-]{1,64}")


@dataclass(frozen=True, slots=True, eq=False)
class Mount:
    """Place of a camera: a fixed pose, or a node that it follows."""

    pose: NDArray[np.float64]
    """(4, 4) float64 X_world_camera; with a path, only until the node exists."""
    path: Path | None = None
    """Node whose frame is the camera's optical frame; None: the pose is fixed."""


@dataclass(frozen=True, slots=True)
class MountedCamera:
    """A camera as users write it: ``name=wrist;profile=rgbd;`` and a mount. Name and profile are optional."""

    mount: str
    """Pose (``parse_mount_pose``), or node (``parse_mount_path``)."""
    name: str = ""
    """Letters, digits, ``_`` and ``-``, not only digits; empty: none is given."""
    profile: str = ""
    """Name or file of a camera profile; empty: none is given."""

    def new_mount(self) -> Mount:
        """Return a mount with this pose or node. Raises CameraError."""
        if self.mount.lstrip().startswith("["):
            return Mount(np.eye(4), parse_mount_path(self.mount))
        return Mount(parse_mount_pose(self.mount))


def parse_mounted_camera(text: str) -> MountedCamera:
    """Parse an entry of ``--stereo-cameras``. Raises CameraError: an invalid option, or neither a pose nor a node."""
    options: dict[str, str] = {}
    rest = text.strip()
    while (match := _OPTION.match(rest)) is not None:
        name, value = match.groups()
        if name in options:
            raise CameraError(f"camera {text!r} has {name}= twice")
        if name == "profile" and not value:
            raise CameraError(f"camera {text!r} has profile= without the name or file of a profile")
        if name == "name" and not _NAME.fullmatch(value):
            raise CameraError(f"name={value!r} of a camera must have 1 to 64 letters, digits, _ or -")
        if name == "name" and value.isdigit():
            raise CameraError(f"name={value!r} of a camera must not be a number: numbers are those of pipelines")
        options[name] = value
        rest = rest[match.end() :].lstrip()
    camera = MountedCamera(rest, **options)
    camera.new_mount()  # raises an error for an invalid mount
    return camera
