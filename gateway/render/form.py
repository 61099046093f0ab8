"""Validation of the fields of a render request; no I/O.

Every form that Drake's demo server or drake-blender accepts is accepted. Unlike Drake's demo server, this one ignores
unknown fields with a warning, so that newer clients with more fields get their images, and computes a missing focal
length from the field of view.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Final, Literal, cast, get_args

from gateway.render.config import LookChoice, RenderConfig
from gateway.render.errors import RequestError, quoted
from gateway.render.multipart import Form

ImageType = Literal["color", "depth", "label"]
IMAGE_TYPES: Final = ("color", "depth", "label")

LOOK_FIELD: Final = "scenegate_look"
"""Field with a ``LookChoice``, which Drake's client never sends. The prefix keeps later fields of it apart."""
LOOKS: Final = get_args(LookChoice)
_FIELD_NAMES: Final = frozenset(
    (
        LOOK_FIELD,
        "scene_sha256",
        "image_type",
        "min_depth",
        "max_depth",
        "width",
        "height",
        "near",
        "far",
        "focal_x",
        "focal_y",
        "fov_x",
        "fov_y",
        "center_x",
        "center_y",
        "submit",
    )
)
_NUMBER: Final = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)
"""Syntax of decimal fields; float() alone would accept "1_000", "nan" and Arabic digits."""
_INTEGER: Final = re.compile(r"\+?(\d{1,9})(\.0*)?", re.ASCII)
"""Syntax of integer fields; a decimal point with zeros may follow."""
_SHA256: Final = re.compile(r"[0-9a-fA-F]{64}")
MAX_FOCAL: Final = 1e9
"""Maximum focal length, pixels: a field of view of a hundred-thousandth of a radian in the largest image."""
MIN_FOV: Final = 2e-5
"""Minimum field of view, radians. A narrower one has a focal length above ``MAX_FOCAL`` in the largest image."""
MAX_FOV: Final = 3.1415926
"""Maximum field of view, radians. A wider one has a focal length below ``1 / MAX_FOCAL`` in the smallest image."""
MIN_FAR: Final = 1e-8
"""Minimum distance of the far plane, metres, so that there is room for a near plane."""
MAX_FAR: Final = 1e12
"""Maximum distance of the far plane, metres. With a larger one, float32 depth cannot resolve a scene."""


@dataclass(frozen=True, slots=True, eq=False)
class RenderRequest:
    """A validated request for one image."""

    image_type: ImageType
    width: int
    """Pixels."""
    height: int
    """Pixels."""
    focal_x: float
    """Pixels, as in Drake's CameraInfo."""
    focal_y: float
    """Pixels."""
    center_x: float
    """Principal point in pixels from the left edge; pixel i covers i .. i + 1."""
    center_y: float
    """Principal point in pixels from the top edge."""
    near: float
    """Near plane in metres, >= 0. Drake prints six decimals: a value below 0.5 micrometres arrives as 0."""
    far: float
    """Far plane in metres, > near."""
    min_depth: float
    """Metres; closer depths are "too close". 0 unless the image is depth."""
    max_depth: float
    """Metres; larger depths are "too far". Infinite unless the image is depth."""
    scene: bytes | bytearray
    """The glTF file; must not change."""
    claimed_sha256: str | None = None
    """SHA-256 of the scene as sent by the client, 64 hexadecimal digits in lower case; None: not sent."""
    scene_filename: str = ""
    """File name as sent by the client; empty if it was not sent."""
    look: LookChoice | None = None
    """Shading model; None: the server's setting."""
    warnings: tuple[str, ...] = ()
    """Sentences about problems that do not prevent the image."""


def read_form(form: Form, config: RenderConfig) -> RenderRequest:
    """Validate every field.

    Raises:
        RequestError: names the field, its value and what is accepted.
    """
    if form.scene is None:
        raise RequestError(400, "the field 'scene' (the glTF file) is missing")
    if not form.scene:
        raise RequestError(400, "the field 'scene' is an empty file")
    fields = form.fields
    warnings = [f"the field {quoted(name)} is unknown and ignored" for name in fields if name not in _FIELD_NAMES]
    image_type = _choice(fields, "image_type", IMAGE_TYPES)
    width, height = _image_side(fields, "width", config), _image_side(fields, "height", config)
    if width * height > config.max_pixels:
        raise RequestError(
            400, f"width * height = {width * height} pixels, the limit is {config.max_pixels} (max_pixels)"
        )
    near = _number(fields, "near", minimum=0.0)
    far = _number(fields, "far", maximum=MAX_FAR)
    if far < MIN_FAR:
        raise RequestError(400, f"far must be at least {MIN_FAR:g}, got {quoted(fields['far'])}")
    if not near < far:
        raise RequestError(400, f"near must be less than far, got near={near:g} and far={far:g}")
    min_depth, max_depth = 0.0, math.inf
    if image_type == "depth":
        min_depth, max_depth = _number(fields, "min_depth", minimum=0.0), _number(fields, "max_depth")
        if not min_depth < max_depth:
            raise RequestError(400, f"min_depth must be less than max_depth, got {min_depth:g} and {max_depth:g}")
    else:  # unused, but invalid values are still errors
        _optional_number(fields, "min_depth", minimum=0.0)
        _optional_number(fields, "max_depth")
    sha256_text = fields.get("scene_sha256", "")
    has_hash = _SHA256.fullmatch(sha256_text) is not None
    if not has_hash:  # drake-blender's tests send NOT_USED_IN_THE_TEST
        warnings.append(
            f"scene_sha256 is no SHA-256 hash: {quoted(sha256_text)}" if sha256_text else "scene_sha256 is missing"
        )
    return RenderRequest(
        image_type=cast("ImageType", image_type),
        width=width,
        height=height,
        focal_x=_focal_length(fields, "x", width),
        focal_y=_focal_length(fields, "y", height),
        center_x=_principal_point(fields, "center_x", width, "width"),
        center_y=_principal_point(fields, "center_y", height, "height"),
        near=near,
        far=far,
        min_depth=min_depth,
        max_depth=max_depth,
        scene=form.scene,
        claimed_sha256=sha256_text.lower() if has_hash else None,
        scene_filename=form.scene_filename,
        look=cast("LookChoice", _choice(fields, LOOK_FIELD, LOOKS)) if LOOK_FIELD in fields else None,
        warnings=tuple(warnings),
    )


def _required_text(fields: dict[str, str], name: str) -> str:
    value = fields.get(name)
    if not value:
        problem = "is missing" if value is None else "is empty"
        hint = "; depth images need it" if name in ("min_depth", "max_depth") else ""
        raise RequestError(400, f"the field '{name}' {problem}{hint}")
    return value


def _choice(fields: dict[str, str], name: str, choices: tuple[str, ...]) -> str:
    text = _required_text(fields, name)
    if text not in choices:
        listed = f"{', '.join(choices[:-1])} or {choices[-1]}"
        raise RequestError(400, f"{name} must be {listed}, got {quoted(text)}")
    return text


def _image_side(fields: dict[str, str], name: str, config: RenderConfig) -> int:
    text = _required_text(fields, name)
    match = _INTEGER.fullmatch(text)
    value = int(match[1]) if match else 0
    if not 1 <= value <= config.max_side:
        raise RequestError(400, f"{name} must be a whole number from 1 to {config.max_side}, got {quoted(text)}")
    return value


def _number(fields: dict[str, str], name: str, *, minimum: float | None = None, maximum: float = math.inf) -> float:
    """Return the finite number in a field. It must be positive if ``minimum`` is None."""
    text = _required_text(fields, name)
    value = float(text) if _NUMBER.fullmatch(text) else math.nan
    if not math.isfinite(value):
        raise RequestError(400, f"{name} must be a finite decimal number, got {quoted(text)}")
    if value > maximum:
        raise RequestError(400, f"{name} must be at most {maximum:g}, got {quoted(text)}")
    if minimum is None and not value > 0.0:
        raise RequestError(400, f"{name} must be positive, got {quoted(text)}")
    if minimum is not None and not value >= minimum:
        raise RequestError(400, f"{name} must be at least {minimum:g}, got {quoted(text)}")
    return value


def _optional_number(fields: dict[str, str], name: str, *, minimum: float | None = None) -> float | None:
    """Return ``_number`` of a field; None if the field is missing or empty."""
    return _number(fields, name, minimum=minimum) if fields.get(name) else None


def _focal_length(fields: dict[str, str], axis: str, size: int) -> float:
    """Return the focal length in pixels. If it is missing, it is computed from the field of view.

    Args:
        axis: ``x`` or ``y``.
        size: Width or height of the image, pixels.
    """
    focal, fov = f"focal_{axis}", f"fov_{axis}"
    angle = _optional_number(fields, fov)
    if angle is not None and not angle < math.pi:
        raise RequestError(400, f"{fov} must be less than pi (radians), got {quoted(fields[fov])}")
    if fields.get(focal) or angle is None:
        value = _number(fields, focal, maximum=MAX_FOCAL)
    else:
        value = size / (2.0 * math.tan(angle / 2.0))
    if not 1.0 / MAX_FOCAL <= value <= MAX_FOCAL:
        raise RequestError(400, f"{focal} = {value:g} pixels is not from {1.0 / MAX_FOCAL:g} to {MAX_FOCAL:g}")
    return value


def _principal_point(fields: dict[str, str], name: str, size: int, size_name: str) -> float:
    """Return a coordinate of the principal point, which must be inside the image as in Drake's CameraInfo."""
    value = _number(fields, name)
    if not value < size:
        raise RequestError(400, f"{name} must be less than the {size_name} ({size}), got {quoted(fields[name])}")
    return value
