"""Query parameters of ``/scene/render`` and ``/scene.glb``, and their OpenAPI description."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal, cast, get_args

from gateway.scene.cameras import (
    CAMERA_PATTERN,
    DEFAULT_FOVY,
    MAX_COORDINATE,
    MIN_FOVY,
    MIN_PLANE_DISTANCE,
    CameraError,
    CameraSpec,
    parse_camera,
    quoted,
)
from gateway.sceneapi.config import SceneApiConfig
from gateway.server.openapi import example
from renderers.interface import LookName, SampleCount

ImageType = Literal["color", "depth", "label"]
DepthFormat = Literal["tiff", "png"]

TYPES: Final = ("color", "depth", "label")
LOOKS: Final = get_args(LookName)
FORMATS: Final = ("tiff", "png")
SAMPLES: Final = ("1", "4", "8")
_CAMERA_EXAMPLE: Final = "eye=2,-2,1.5;target=0,0,0.5"


class QueryError(ValueError):
    """A parameter is invalid. The message has its name, value and limits."""


class CameraNotFoundError(QueryError):
    """The camera's node is not in the scene, or there is no stereo camera."""


@dataclass(frozen=True, slots=True)
class ImageQuery:
    """The parameters of ``GET /scene/render``."""

    camera: CameraSpec
    type: ImageType
    width: int
    """Pixels."""
    height: int
    """Pixels."""
    look: LookName
    samples: SampleCount
    fovy: float
    """Vertical field of view in degrees, for cameras without one."""
    near: float | None
    """Near plane in metres; None fits it to the scene."""
    far: float | None
    """Far plane in metres; None fits it to the scene."""
    format: DepthFormat
    """File format of depth images."""


def parse_file_query(query: Mapping[str, str], config: SceneApiConfig) -> ImageQuery | None:
    """Parse the camera of ``GET /scene.glb``; return None without any parameter.

    Raises:
        QueryError: A parameter is unknown or invalid.
    """
    _check_names(query, FILE_PARAMETERS)
    return parse_query(query, config) if query else None


def parse_query(query: Mapping[str, str], config: SceneApiConfig) -> ImageQuery:
    """Parse the query of ``GET /scene/render``.

    Raises:
        QueryError: A parameter is unknown or invalid.
    """
    _check_names(query, PARAMETERS)
    try:
        camera = parse_camera(query.get("camera", "fit"))
    except CameraError as error:
        raise QueryError(str(error)) from error
    width = _size(query, "width", config.width, config)
    height = _size(query, "height", config.height, config)
    if width * height > config.max_pixels:
        raise QueryError(f"width x height = {width}x{height} has more than {config.max_pixels} pixels")
    fovy = _number(query, "fovy")
    if fovy is not None and not MIN_FOVY <= fovy < 180.0:
        raise QueryError(f"fovy={quoted(query['fovy'])} must be at least {MIN_FOVY:g} and less than 180 degrees")
    near, far = _number(query, "near"), _number(query, "far")
    for name, value in (("near", near), ("far", far)):
        if value is not None and not MIN_PLANE_DISTANCE <= value <= MAX_COORDINATE:
            raise QueryError(
                f"{name}={quoted(query[name])} must be from {MIN_PLANE_DISTANCE:g} to {MAX_COORDINATE:g} metres"
            )
    if near is not None and far is not None and near >= far:
        raise QueryError(f"near={quoted(query['near'])} must be less than far={quoted(query['far'])}")
    look = cast("LookName", _choice(query, "look", LOOKS, config.look))
    return ImageQuery(
        camera=camera,
        type=cast("ImageType", _choice(query, "type", TYPES, "color")),
        width=width,
        height=height,
        look=look,
        samples=_samples(query, config.samples if look == "studio" else 1),
        fovy=DEFAULT_FOVY if fovy is None else fovy,
        near=near,
        far=far,
        format=cast("DepthFormat", _choice(query, "format", FORMATS, "tiff")),
    )


def _check_names(query: Mapping[str, str], names: tuple[str, ...]) -> None:
    unknown = [name for name in query if name not in names]
    if unknown:
        raise QueryError(f"{quoted(unknown[0])} is not a parameter; the parameters are {', '.join(names)}")


def _choice(query: Mapping[str, str], name: str, choices: tuple[str, ...], default: str) -> str:
    value = query.get(name, default)
    if value not in choices:
        raise QueryError(f"{name}={quoted(value)} is not one of {', '.join(choices)}")
    return value


def _samples(query: Mapping[str, str], default: SampleCount) -> SampleCount:
    return cast("SampleCount", int(_choice(query, "samples", SAMPLES, str(default))))


def _size(query: Mapping[str, str], name: str, default: int, config: SceneApiConfig) -> int:
    text = query.get(name)
    if text is None:
        return default
    value = int(text) if text.isascii() and text.isdigit() and len(text) < 10 else 0
    if not 1 <= value <= config.max_side:
        raise QueryError(f"{name}={quoted(text)} is not a number of pixels between 1 and {config.max_side}")
    return value


def _number(query: Mapping[str, str], name: str) -> float | None:
    text = query.get(name)
    if text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise QueryError(f"{name}={quoted(text)} is not a number")
    return value


def _parameter(
    name: str, kind: str, default: object, example_value: object, description: str, **schema: object
) -> dict[str, Any]:
    return {
        "name": name,
        "in": "query",
        "required": False,
        "description": description,
        "schema": {"type": kind, **({} if default is None else {"default": default}), **schema},
        "examples": example(example_value),
    }


def openapi_file_parameters(config: SceneApiConfig) -> list[dict[str, Any]]:
    """Return the OpenAPI description of the parameters of ``GET /scene.glb``."""
    known = {entry["name"]: entry for entry in openapi_parameters(config)}
    camera = known["camera"]
    text = (
        "Camera in the file, which clients of /render need; without any parameter the file has no camera. "
        f"{camera['description']}"
    )
    return [{**camera, "description": text}, *(known[name] for name in FILE_PARAMETERS[1:])]


def openapi_parameters(config: SceneApiConfig) -> list[dict[str, Any]]:
    """Return the OpenAPI description of the parameters of ``GET /scene/render``."""
    size: dict[str, Any] = {"minimum": 1, "maximum": config.max_side}
    plane: dict[str, Any] = {"minimum": MIN_PLANE_DISTANCE, "maximum": MAX_COORDINATE}
    pixels = f"Pixels; width x height is at most {config.max_pixels}."
    return [
        _parameter(
            "camera",
            "string",
            "fit",
            _CAMERA_EXAMPLE,
            'stereo, fit, path:["robot","head"] (a node\'s frame, optical: +Z forward, +Y down), or '
            "eye=x,y,z;target=x,y,z;up=x,y,z;fovy=degrees.",
            pattern=CAMERA_PATTERN,
        ),
        _parameter("type", "string", "color", "color", "Type of the image.", enum=list(TYPES)),
        _parameter("width", "integer", config.width, 640, pixels, **size),
        _parameter("height", "integer", config.height, 480, pixels, **size),
        _parameter("look", "string", config.look, config.look, "Shading of colour images.", enum=list(LOOKS)),
        _parameter(
            "samples",
            "integer",
            None,
            4,
            f"Samples per pixel of colour images; default {config.samples} for studio, 1 and FXAA for other looks.",
            enum=[int(samples) for samples in SAMPLES],
        ),
        _parameter(
            "fovy",
            "number",
            DEFAULT_FOVY,
            DEFAULT_FOVY,
            "Vertical field of view in degrees, for cameras without one.",
            minimum=MIN_FOVY,
            exclusiveMaximum=180,
        ),
        _parameter(
            "near",
            "number",
            None,
            0.1,
            "Near clipping plane in metres, less than far; by default fitted to the scene.",
            **plane,
        ),
        _parameter(
            "far", "number", None, 100.0, "Far clipping plane in metres; by default fitted to the scene.", **plane
        ),
        _parameter(
            "format",
            "string",
            "tiff",
            "tiff",
            "File format of depth images: TIFF in float32 metres, or PNG in millimetres.",
            enum=list(FORMATS),
        ),
    ]


PARAMETERS: Final = tuple(entry["name"] for entry in openapi_parameters(SceneApiConfig()))
FILE_PARAMETERS: Final = ("camera", "width", "height", "fovy", "near", "far")
