"""The parameters of a picture, from the query of its URL."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal, cast, get_args

from gateway.scene.cameras import (
    DEFAULT_FOVY,
    LIMIT,
    MIN_FOVY,
    NEAREST,
    PATTERN,
    CameraError,
    CameraSpec,
    parse_camera,
)
from gateway.sceneapi.config import SceneApiConfig
from gateway.server.openapi import example
from renderers.interface import LookName, SampleCount

PictureType = Literal["color", "depth", "label"]
DepthFormat = Literal["tiff", "png"]

TYPES: Final = ("color", "depth", "label")
LOOKS: Final = get_args(LookName)
FORMATS: Final = ("tiff", "png")
SAMPLES: Final = ("1", "4", "8")
_CAMERA_EXAMPLE: Final = "eye=2,-2,1.5;target=0,0,0.5"


class QueryError(ValueError):
    """A parameter cannot be used; the message names it, its value and the reason."""


class NoSuchCameraQueryError(QueryError):
    """The camera names what the scene or the gateway does not have."""


@dataclass(frozen=True, slots=True)
class PictureQuery:
    """``GET /scene/render``."""

    camera: CameraSpec
    type: PictureType
    width: int
    height: int
    look: LookName
    samples: SampleCount
    fovy: float
    """Degrees."""
    near: float | None
    far: float | None
    """Metres; None: chosen so that the whole scene is in between."""
    format: DepthFormat
    """Of depth."""


def parse_file_query(query: Mapping[str, str], config: SceneApiConfig) -> PictureQuery | None:
    """The camera that ``GET /scene.glb`` is to have; None: none.

    Raises:
        QueryError: naming the parameter.
    """
    _known(query, FILE_PARAMETERS)
    return parse_query(query, config) if query else None


def parse_query(query: Mapping[str, str], config: SceneApiConfig) -> PictureQuery:
    """The picture that a query asks for.

    Raises:
        QueryError: naming the parameter.
    """
    _known(query, PARAMETERS)
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
        raise QueryError(f"fovy={_quoted(query['fovy'])} must be at least {MIN_FOVY:g} and less than 180 degrees")
    near, far = _number(query, "near"), _number(query, "far")
    for name, value in (("near", near), ("far", far)):
        if value is not None and not NEAREST <= value <= LIMIT:
            raise QueryError(f"{name}={_quoted(query[name])} must be from {NEAREST:g} to {LIMIT:g} metres")
    if near is not None and far is not None and near >= far:
        raise QueryError(f"near={_quoted(query['near'])} must be less than far={_quoted(query['far'])}")
    look = cast("LookName", _choice(query, "look", LOOKS, config.look))
    return PictureQuery(
        camera=camera,
        type=cast("PictureType", _choice(query, "type", TYPES, "color")),
        width=width,
        height=height,
        look=look,
        samples=_samples(query, config.samples if look == "studio" else 1),
        fovy=DEFAULT_FOVY if fovy is None else fovy,
        near=near,
        far=far,
        format=cast("DepthFormat", _choice(query, "format", FORMATS, "tiff")),
    )


def _known(query: Mapping[str, str], names: tuple[str, ...]) -> None:
    unknown = [name for name in query if name not in names]
    if unknown:
        raise QueryError(f"{_quoted(unknown[0])} is no parameter; known are {', '.join(names)}")


def _quoted(text: str) -> str:
    return repr(text if len(text) <= 60 else text[:57] + "...")


def _choice(query: Mapping[str, str], name: str, choices: tuple[str, ...], default: str) -> str:
    value = query.get(name, default)
    if value not in choices:
        raise QueryError(f"{name}={_quoted(value)} is none of {', '.join(choices)}")
    return value


def _samples(query: Mapping[str, str], default: SampleCount) -> SampleCount:
    return cast("SampleCount", int(_choice(query, "samples", SAMPLES, str(default))))


def _size(query: Mapping[str, str], name: str, default: int, config: SceneApiConfig) -> int:
    text = query.get(name)
    if text is None:
        return default
    value = int(text) if text.isascii() and text.isdigit() and len(text) < 10 else 0
    if not 1 <= value <= config.max_side:
        raise QueryError(f"{name}={_quoted(text)} is not a number of pixels between 1 and {config.max_side}")
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
        raise QueryError(f"{name}={_quoted(text)} is not a number")
    return value


def _parameter(name: str, kind: str, default: object, shown: object, text: str, **more: object) -> dict[str, Any]:
    schema = {"type": kind, **({} if default is None else {"default": default}), **more}
    return {
        "name": name,
        "in": "query",
        "required": False,
        "description": text,
        "schema": schema,
        "examples": example(shown),
    }


def openapi_file_parameters(config: SceneApiConfig) -> list[dict[str, Any]]:
    """The parameters of ``GET /scene.glb`` for the OpenAPI document."""
    known = {entry["name"]: entry for entry in openapi_parameters(config)}
    camera = known["camera"]
    text = (
        "Written into the file, as clients of /render need one; a request without any parameter gets a file without a "
        f"camera. {camera['description']}"
    )
    return [{**camera, "description": text}, *(known[name] for name in FILE_PARAMETERS[1:])]


def openapi_parameters(config: SceneApiConfig) -> list[dict[str, Any]]:
    """The parameters for the OpenAPI document."""
    size: dict[str, Any] = {"minimum": 1, "maximum": config.max_side}
    plane: dict[str, Any] = {"minimum": NEAREST, "maximum": LIMIT}
    pixels = f"Pixels; width x height is at most {config.max_pixels}."
    return [
        _parameter(
            "camera",
            "string",
            "fit",
            _CAMERA_EXAMPLE,
            'stereo, fit, path:["robot","head"] (a node\'s frame, optical: +Z forward, +Y down), or '
            "eye=x,y,z;target=x,y,z;up=x,y,z;fovy=degrees.",
            pattern=PATTERN,
        ),
        _parameter("type", "string", "color", "color", "Which picture.", enum=list(TYPES)),
        _parameter("width", "integer", config.width, 640, pixels, **size),
        _parameter("height", "integer", config.height, 480, pixels, **size),
        _parameter("look", "string", config.look, config.look, "How colour is made.", enum=list(LOOKS)),
        _parameter(
            "samples",
            "integer",
            None,
            4,
            f"Samples a pixel of colour; else {config.samples} of the studio look, and one and FXAA of the others.",
            enum=[int(samples) for samples in SAMPLES],
        ),
        _parameter(
            "fovy",
            "number",
            DEFAULT_FOVY,
            DEFAULT_FOVY,
            "Vertical field of view in degrees, where the camera names none.",
            minimum=MIN_FOVY,
            exclusiveMaximum=180,
        ),
        _parameter(
            "near",
            "number",
            None,
            0.1,
            "Near clipping plane, metres, less than far; else chosen by the scene.",
            **plane,
        ),
        _parameter("far", "number", None, 100.0, "Far clipping plane, metres; else chosen by the scene.", **plane),
        _parameter("format", "string", "tiff", "tiff", "Of depth: float metres, or PNG in mm.", enum=list(FORMATS)),
    ]


PARAMETERS: Final = tuple(entry["name"] for entry in openapi_parameters(SceneApiConfig()))
FILE_PARAMETERS: Final = ("camera", "width", "height", "fovy", "near", "far")
