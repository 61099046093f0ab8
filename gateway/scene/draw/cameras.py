"""Parses cameras from text: the grammar of ``camera=`` and ``--camera``.

``stereo``
    the left camera of the stereo sensor;
``fit``
    a camera that sees the whole scene, from the front right and above;
``path:["robot", "head"]``
    a camera at a node, given by its path in JSON. The node's frame is the optical frame: +Z forward, +X right, +Y down;
``eye=x,y,z;target=x,y,z;up=x,y,z;fovy=degrees``
    a free camera; ``up`` (default 0,0,1) and ``fovy`` may be left out;
``eye=x,y,z;target=x,y,z;up=x,y,z;xmag=metres``
    a free orthographic camera, whose image is twice ``xmag`` wide, as in glTF.
"""

import json
import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.scene.tree.nodes import Path

DEFAULT_FOVY: Final = 45.0
"""Default vertical field of view, degrees; Drake's default for its cameras."""
MIN_FOVY: Final = 0.001
"""Minimum vertical field of view, degrees. In the largest image it is a focal length of 1e9 pixels, the render
endpoint's limit."""
MIN_PLANE_DISTANCE: Final = 1e-9
"""Minimum distance of a clipping plane, metres; the inverse of a smaller one would overflow."""
MAX_CAMERA_CHARACTERS: Final = 4096
"""Maximum length of a camera's text; a path of a dozen names is shorter."""
MAX_COORDINATE: Final = 1e12
"""Maximum coordinate, metres; larger ones would overflow."""

Vector = tuple[float, float, float]
"""(x, y, z) in the world; a point in metres, or a direction."""

_NUMBER: Final = r"[+-]?[0-9]{1,9}(\.[0-9]{0,9})?([eE][+-]?[0-2])?"
_VECTOR: Final = f"{_NUMBER},{_NUMBER},{_NUMBER}"
_NAME: Final = r'("[^"\\\x00-\x1f]*"|0|-?[1-9][0-9]{0,8})'
_FOVY: Final = r"(0?\.0{0,2}[1-9][0-9]{0,6}|([1-9]|[1-9][0-9]|1[0-7][0-9])(\.[0-9]{0,9})?)"
_XMAG: Final = r"(0?\.0{0,2}[1-9][0-9]{0,6}|[1-9][0-9]{0,8}(\.[0-9]{0,9})?)"
_PATH: Final = rf"\[({_NAME}(, ?{_NAME})*)?\]"
PATHS_PATTERN: Final = rf"^\[({_PATH}(, ?{_PATH})*)?\]$"
"""Pattern of a JSON list of paths."""
_LOOK_AT: Final = rf"eye={_VECTOR};target={_VECTOR}(;up={_VECTOR})?"
LOOK_AT_PATTERN: Final = f"^{_LOOK_AT}$"
"""Pattern of a pose in words."""
CAMERA_PATTERN: Final = rf"^(stereo|fit|path:{_PATH}|{_LOOK_AT}(;fovy={_FOVY}|;xmag={_XMAG})?)$"
"""Regular expression of the grammar, for API descriptions.

It does not say all: ``parse_camera`` also accepts spaces and another order of ``eye``, ``target``, ``up``, ``fovy`` and
``xmag``, and rejects an ``eye`` equal to ``target`` and an ``up`` of zeros.
"""


class CameraError(ValueError):
    """A camera's text that cannot be parsed or resolved. The message names the part of the text and the reason."""


class NoSuchCameraError(CameraError):
    """A valid text that names a node or a sensor that does not exist."""


@dataclass(frozen=True, slots=True)
class StereoCamera:
    """``stereo``: the left camera of the stereo sensor."""


@dataclass(frozen=True, slots=True)
class FitCamera:
    """``fit``: a camera that sees the whole scene."""


@dataclass(frozen=True, slots=True)
class NodeCamera:
    """``path:[...]``: a camera at a node."""

    path: Path


@dataclass(frozen=True, slots=True)
class LookAtCamera:
    """``eye=...;target=...;up=...;fovy=...`` or ``...;xmag=...``: a free camera."""

    eye: Vector
    target: Vector
    up: Vector = (0.0, 0.0, 1.0)
    fovy: float | None = None
    """Vertical field of view, degrees; None: the caller's default."""
    xmag: float | None = None
    """Half of the width of an orthographic view, metres; None: the camera is a pinhole."""


CameraSpec = StereoCamera | FitCamera | NodeCamera | LookAtCamera
"""A parsed camera, not yet placed in a scene."""


@dataclass(frozen=True, slots=True)
class OrbitCamera:
    """One of ``count`` cameras on a circle around the scene, far enough away that each of them sees the whole scene."""

    index: int
    """Index of the camera, 0 .. ``count`` - 1, counter-clockwise from +x."""
    count: int
    elevation: float
    """Degrees above the horizon, -89 .. 89."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseCamera:
    """A camera at a given pose."""

    X_world_camera: NDArray[np.float64]
    """(4, 4) float64: rigid pose of the optical frame in the world."""


def parse_camera(text: str) -> CameraSpec:
    """Parse a camera's text. Raises CameraError, with the part that is wrong, if it does not follow the grammar."""
    if len(text) > MAX_CAMERA_CHARACTERS:
        raise CameraError(f"camera text has {len(text)} characters, at most {MAX_CAMERA_CHARACTERS} are allowed")
    stripped = text.strip()
    if stripped == "stereo":
        return StereoCamera()
    if stripped == "fit":
        return FitCamera()
    if stripped.startswith("path:"):
        return NodeCamera(_parse_path(stripped.removeprefix("path:")))
    if "=" in stripped:
        return _parse_look_at(stripped)
    raise CameraError(
        f"camera {quoted(text)} is not one of 'stereo', 'fit', 'path:[\"name\", ...]' and 'eye=x,y,z;target=x,y,z'"
    )


def quoted(text: str) -> str:
    """Return a client's text for an error message: quoted, and shortened to 60 characters."""
    return repr(text if len(text) <= 60 else text[:57] + "...")


def _parse_path(text: str) -> Path:
    try:
        names = json.loads(text)
    except (ValueError, RecursionError):
        names = None
    if not isinstance(names, list):
        raise CameraError(f'camera path {quoted(text)} is not a JSON list such as ["robot", "head"]')
    for name in names:
        if not isinstance(name, str | int) or isinstance(name, bool):
            raise CameraError(f"camera path element {quoted(json.dumps(name))} is neither a string nor an integer")
    return tuple(names)


def _parse_look_at(text: str) -> LookAtCamera:
    values: dict[str, str] = {}
    for part in text.split(";"):
        if not part.strip():
            continue
        name, equals, value = part.partition("=")
        name = name.strip()
        if not equals or name not in ("eye", "target", "up", "fovy", "xmag"):
            raise CameraError(f"camera part {quoted(part)} is not one of eye=, target=, up=, fovy= and xmag=")
        if name in values:
            raise CameraError(f"camera part {quoted(part)} repeats {name}=")
        values[name] = value
    for name in ("eye", "target"):
        if name not in values:
            raise CameraError(f"camera {quoted(text)} has no {name}=x,y,z")
    eye, target = _parse_vector("eye", values["eye"]), _parse_vector("target", values["target"])
    up = _parse_vector("up", values["up"]) if "up" in values else (0.0, 0.0, 1.0)
    if eye == target:
        raise CameraError(f"camera part {quoted('target=' + values['target'])} is the same point as eye")
    if up == (0.0, 0.0, 0.0):
        raise CameraError(f"camera part {quoted('up=' + values['up'])} has no direction")
    fovy = None
    if "fovy" in values:
        fovy = _parse_number("fovy", values["fovy"])
        if not MIN_FOVY <= fovy < 180.0:
            part = quoted("fovy=" + values["fovy"])
            raise CameraError(f"camera part {part} must be at least {MIN_FOVY:g} and less than 180 degrees")
    xmag = None
    if "xmag" in values:
        xmag = _parse_number("xmag", values["xmag"])
        if fovy is not None or not xmag >= MIN_PLANE_DISTANCE:
            part = quoted("xmag=" + values["xmag"])
            raise CameraError(f"camera part {part} must be at least {MIN_PLANE_DISTANCE:g} metres, without fovy=")
    return LookAtCamera(eye, target, up, fovy, xmag)


def _parse_vector(name: str, text: str) -> Vector:
    parts = text.split(",")
    if len(parts) != 3:
        raise CameraError(f"camera part {quoted(f'{name}={text}')} needs three numbers separated by commas")
    x, y, z = (_parse_number(name, part) for part in parts)
    return x, y, z


def _parse_number(name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) <= MAX_COORDINATE:
        raise CameraError(
            f"camera part {name}: {quoted(text)} is not a number between -{MAX_COORDINATE:g} and {MAX_COORDINATE:g}"
        )
    return value
