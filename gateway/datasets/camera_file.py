"""Read the file of ``--cameras``: JSON with views of all scenes or of single scenes. See ``docs/datasets.md``."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal

import msgspec
import numpy as np

from gateway.datasets.views import Intrinsics, View
from gateway.scene.draw.cameras import CameraError
from renderers.camera import OPENGL_FROM_OPTICAL
from scenegate.datasets.manifest import Pose, pose_rows
from scenegate.regular_files import errors_as, read_regular

MAX_FILE_BYTES: Final = 256 << 20
"""Maximum size of the file. A camera takes about 400 bytes."""


class _CameraEntry(Intrinsics, frozen=True, forbid_unknown_fields=True):
    """A camera in the file: ``camera`` is a camera text, ``X_world_camera`` a pose in the ``convention``."""

    name: str | None = None
    camera: str | None = None
    X_world_camera: Pose | None = None
    convention: Literal["optical", "opengl"] = "optical"


class _FileContent(msgspec.Struct, forbid_unknown_fields=True):
    cameras: list[_CameraEntry] = []
    scenes: dict[str, list[_CameraEntry]] = {}


@dataclass(frozen=True, slots=True)
class CameraFile:
    """Views in a camera file."""

    default_views: tuple[View, ...] = ()
    """Views of the scenes that are not in ``scene_views``."""
    scene_views: Mapping[str, tuple[View, ...]] = field(default_factory=dict)
    """Views of single scenes, by scene name."""


def read_camera_file(path: Path) -> CameraFile:
    """Read a camera file. Raises CameraError, with the entry, if it cannot be read or an entry is invalid."""
    with errors_as(CameraError, path, msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        content = msgspec.json.decode(read_regular(path, MAX_FILE_BYTES), type=_FileContent)
    if not content.cameras and not content.scenes:
        raise CameraError(f"{path} names no camera: neither 'cameras' nor 'scenes' has an entry")
    scene_views = {name: _views(entries, f"{path}: scenes[{name!r}]") for name, entries in content.scenes.items()}
    return CameraFile(_views(content.cameras, f"{path}: cameras"), scene_views)


def _views(entries: list[_CameraEntry], location: str) -> tuple[View, ...]:
    """Return the views of camera entries. ``location`` names the list of entries in error messages."""
    digits = max(3, len(str(len(entries) - 1)))
    views: dict[str, View] = {}
    for index, entry in enumerate(entries):
        try:
            lens = Intrinsics(*(getattr(entry, name) for name in Intrinsics.__struct_fields__))
            view = View(entry.name or f"camera-{index:0{digits}d}", _pose(entry), lens)
        except CameraError as error:
            raise CameraError(f"{location}[{index}]: {error}") from None
        if view.name in views:
            raise CameraError(f"{location}[{index}]: the name {view.name!r} is taken")
        views[view.name] = view
    return tuple(views.values())


def _pose(entry: _CameraEntry) -> str | Pose:
    """Return the camera text, or X_world_camera of the optical frame."""
    if (entry.camera is None) == (entry.X_world_camera is None):
        raise CameraError("needs either 'camera' (a text such as fit) or 'X_world_camera' (4 x 4)")
    if entry.X_world_camera is None:
        assert entry.camera is not None
        return entry.camera
    if entry.convention == "optical":
        return entry.X_world_camera
    return pose_rows(np.array(entry.X_world_camera) @ OPENGL_FROM_OPTICAL)
