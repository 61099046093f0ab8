"""Views: named camera poses and intrinsics, and the file of ``--cameras`` with them (``docs/datasets.md``).

``camera_of`` computes the camera of one in a scene.
"""

import hashlib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Final, Literal

import msgspec
import numpy as np

from gateway.adapters.render.errors import RequestError
from gateway.adapters.render.pipeline import rigid_pose
from gateway.files.gltf import PlacedCamera
from gateway.scene.draw.cameras import CameraError, CameraSpec, OrbitCamera, PoseCamera, StereoCamera, parse_camera
from gateway.scene.draw.viewpoints import orthographic_camera, resolve_camera
from gateway.scene.tree.nodes import Node
from gateway.scene.tree.transforms import is_rotation
from renderers.camera import OPENGL_FROM_OPTICAL, Camera
from renderers.drawlist import DrawList
from scenegate.datasets.manifest import CameraRecord, Pose, pose_rows
from scenegate.regular_files import errors_as, read_regular

NAME_PATTERN: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
"""Allowed names of views. They become parts of file names."""
REQUEST_VIEW_NAME: Final = "request"
"""Name of the only view that a recorded request has."""
MAX_ROTATION_ERROR: Final = 1e-4
"""Maximum deviation of an element of R^T R from the identity. It allows matrices with five digits."""

_Side = Annotated[int, msgspec.Meta(ge=1, le=16384)]
_Positive = Annotated[float, msgspec.Meta(gt=0)]


class Intrinsics(msgspec.Struct, frozen=True):
    """Image size, intrinsics and clipping planes of a view. All are optional."""

    width: _Side | None = None
    """Width of the image in pixels; None: the dataset's."""
    height: _Side | None = None
    """Height of the image in pixels; None: the dataset's."""
    fovy: Annotated[float, msgspec.Meta(gt=0, lt=180)] | None = None
    """Vertical field of view in degrees, an alternative to ``fy``; None: the dataset's."""
    fx: _Positive | None = None
    """Horizontal focal length in pixels; None: the vertical focal length."""
    fy: _Positive | None = None
    """Vertical focal length in pixels; None: computed from ``fovy``."""
    cx: float | None = None
    """Principal point in pixels from the left edge; None: the centre."""
    cy: float | None = None
    """Principal point in pixels from the top edge; None: the centre."""
    near: _Positive | None = None
    """Near plane in metres; None: that of the scene file's camera, or computed from the scene's extent."""
    far: _Positive | None = None
    """Far plane in metres; None: that of the scene file's camera, or computed from the scene's extent."""


@dataclass(frozen=True, slots=True)
class SceneCamera:
    """A camera that is drawn with the scene, and the frame of the scene that it sees. Only scenarios have them."""

    index: int
    frame: int | None
    """None: the scene does not move."""


@dataclass(frozen=True, slots=True)
class View:
    """Camera pose and intrinsics with a name. The constructor raises CameraError if they are invalid."""

    name: str
    pose: str | Pose | OrbitCamera | SceneCamera | None
    """Camera text, X_world_camera of the optical frame, position on an orbit, or camera of the scene; None: the scene
    file's first camera, or ``fit`` if it has none."""
    intrinsics: Intrinsics = field(default=Intrinsics())

    def __post_init__(self) -> None:
        if NAME_PATTERN.fullmatch(self.name) is None:
            raise CameraError(f"the view's name {self.name[:80]!r} is not made of letters, digits, '_', '.' and '-'")
        if isinstance(self.pose, str) and isinstance(parse_camera(self.pose), StereoCamera):
            raise CameraError("camera 'stereo': there is no stereo camera without a gateway")
        if isinstance(self.pose, tuple):
            check_pose(self.pose)
        if self.intrinsics.fovy is not None and self.intrinsics.fy is not None:
            raise CameraError(f"view {self.name}: fovy and fy say the same thing; give one of them")

    @property
    def description(self) -> str:
        """Text for ``SampleRecord.view_description``. Different poses or intrinsics have different texts."""
        if isinstance(self.pose, OrbitCamera):
            text = f"orbit {self.pose.index}/{self.pose.count} at {self.pose.elevation:g} degrees"
        elif isinstance(self.pose, SceneCamera):
            text = f"camera {self.pose.index} of the scene"
            text += "" if self.pose.frame is None else f", frame {self.pose.frame}"
        elif isinstance(self.pose, tuple):
            text = "pose " + hashlib.sha256(repr(self.pose).encode()).hexdigest()[:16]
        else:
            text = self.pose or "the file's own, or fit"
        if self.intrinsics != Intrinsics():
            text += "; lens " + hashlib.sha256(repr(msgspec.structs.astuple(self.intrinsics)).encode()).hexdigest()[:16]
        return text


def scene_views(cameras: int, frames: int | None) -> tuple[View, ...]:
    """Return the views of a scene with cameras of its own, which see each frame in turn; None: it does not move."""
    if frames is None:
        return tuple(View(f"camera-{k:03d}", SceneCamera(k, None)) for k in range(cameras))
    return tuple(
        View(f"camera-{k:03d}-frame-{frame:04d}", SceneCamera(k, frame))
        for k in range(cameras)
        for frame in range(frames)
    )


def camera_of(
    view: View, root: Node, draw_list: DrawList, file_camera: PlacedCamera | None, width: int, height: int, fovy: float
) -> Camera:
    """Return the camera of a view in a scene. Width, height and ``fovy``, in degrees, are defaults.

    ``file_camera``: first camera of the scene file; None if it has none. Raises CameraError if the scene does not have
    the node that the pose names, or a number is invalid.
    """
    intrinsics = view.intrinsics
    width, height = intrinsics.width or width, intrinsics.height or height
    if view.pose is None and file_camera is not None:
        camera = _camera_from_file(file_camera, width, height, draw_list)
    else:
        spec: CameraSpec | OrbitCamera | PoseCamera
        if isinstance(view.pose, OrbitCamera):
            spec = view.pose
        elif isinstance(view.pose, tuple):
            spec = PoseCamera(np.array(view.pose))
        else:
            assert not isinstance(view.pose, SceneCamera)  # ``LoadedScene.posed`` replaces it
            spec = parse_camera(view.pose or "fit")
        fovy = intrinsics.fovy or fovy
        if intrinsics.fy is not None:
            fovy = math.degrees(2.0 * math.atan(0.5 * height / intrinsics.fy))
        camera = resolve_camera(
            spec, root, width, height, fovy=fovy, near=intrinsics.near, far=intrinsics.far, draw_list=draw_list
        )
    fy = intrinsics.fy or camera.fy
    try:
        return Camera(
            width,
            height,
            intrinsics.fx or fy,
            fy,
            camera.cx if intrinsics.cx is None else intrinsics.cx,
            camera.cy if intrinsics.cy is None else intrinsics.cy,
            camera.near if intrinsics.near is None else camera.depth_origin + intrinsics.near,
            camera.far if intrinsics.far is None else camera.depth_origin + intrinsics.far,
            camera.X_world_camera,
            camera.depth_origin,
        )
    except ValueError as error:
        raise CameraError(f"view {view.name}: {error}") from None


def usable_camera(cameras: Sequence[PlacedCamera], draw_list: DrawList) -> tuple[PlacedCamera | None, tuple[str, ...]]:
    """Return the first camera of a scene file that can be used, if any, and warnings about those before it."""
    warnings: list[str] = []
    for camera in cameras:
        try:
            _camera_from_file(camera, 1, 1, draw_list)
        except CameraError as error:
            warnings.append(f"{error}; it is not used")
        else:
            return camera, tuple(warnings)
    return None, tuple(warnings)


def _camera_from_file(file_camera: PlacedCamera, width: int, height: int, draw_list: DrawList) -> Camera:
    """Return the camera of a scene file for an image size in pixels."""
    near, far = file_camera.znear, file_camera.zfar
    try:
        pose = rigid_pose(file_camera.X_world_camera, file_camera.name)
        if file_camera.yfov is None:
            if not file_camera.xmag or not math.isfinite(file_camera.xmag):
                raise CameraError("it has neither yfov nor xmag")
            return orthographic_camera(pose, width, height, abs(file_camera.xmag), draw_list, near, far)
        if not 0.0 < file_camera.yfov < math.pi:
            raise CameraError(f"yfov = {file_camera.yfov:g} is not in 0 .. pi")
        focal_length = 0.5 * height / math.tan(0.5 * file_camera.yfov)
        far = math.inf if far is None else far
        return Camera(width, height, focal_length, focal_length, 0.5 * width, 0.5 * height, near, far, pose)
    except (RequestError, ValueError) as error:  # CameraErrors are ValueErrors
        raise CameraError(f"the file's camera {file_camera.name!r}: {error}") from None


def check_pose(rows: Pose) -> None:
    """Raise CameraError unless a matrix is a rotation and a translation."""
    pose = np.array(rows)
    if pose.shape != (4, 4) or not np.isfinite(pose).all() or not (pose[3] == (0.0, 0.0, 0.0, 1.0)).all():
        raise CameraError("X_world_camera must be four rows of four finite numbers, the last of them 0, 0, 0, 1")
    if not is_rotation(pose[:3, :3], MAX_ROTATION_ERROR):
        raise CameraError("X_world_camera must be a rotation and a translation: it is scaled, sheared or mirrored")


def record_of(camera: Camera) -> CameraRecord:
    """Return a camera as it is written to the manifest."""
    far = None if math.isinf(camera.far) else float(camera.far)
    return CameraRecord(
        width=camera.width,
        height=camera.height,
        fx=float(camera.fx),
        fy=float(camera.fy),
        cx=float(camera.cx),
        cy=float(camera.cy),
        near=float(camera.near),
        far=far,
        X_world_camera=pose_rows(camera.X_world_camera),
        depth_origin=float(camera.depth_origin),
    )


MAX_FILE_BYTES: Final = 256 << 20
"""Maximum size of a file of ``--cameras``. A camera takes about 400 bytes."""


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
