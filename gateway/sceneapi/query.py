"""Query parameters of ``/scene/render`` and ``/scene.glb``. One declaration serves both the parser and OpenAPI."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal, get_args

from gateway.scene.cameras import (
    CAMERA_PATTERN,
    DEFAULT_FOVY,
    MAX_COORDINATE,
    MIN_FOVY,
    MIN_PLANE_DISTANCE,
    PATHS_PATTERN,
    CameraError,
    CameraSpec,
    parse_camera,
    quoted,
)
from gateway.scene.shown import COLOR_PATTERN, ShownError, parse_color, parse_paths
from gateway.scene.timeline import MAX_SECONDS, TIME_DESCRIPTION
from gateway.scene.tree import Path
from gateway.sceneapi.config import SceneApiConfig
from gateway.server.openapi import example
from renderers.interface import LookName, SampleCount

ImageType = Literal["color", "depth", "label"]
DepthFormat = Literal["tiff", "png"]

FILE_PARAMETERS: Final = ("camera", "width", "height", "fovy", "near", "far", "hide", "show", "time")
"""Parameters of ``/scene.glb``."""


class QueryError(ValueError):
    """A parameter is invalid. The message has the parameter's name, value and limits."""


class CameraNotFoundError(QueryError):
    """The camera's node is not in the scene, or there is no stereo camera."""


@dataclass(frozen=True, slots=True)
class ImageQuery:
    """The values of the parameters of ``GET /scene/render``."""

    camera: CameraSpec
    type: ImageType
    width: int
    """Pixels."""
    height: int
    """Pixels."""
    look: LookName
    """Shading of colour images."""
    samples: SampleCount
    """Samples per pixel of colour images."""
    fovy: float
    """Vertical field of view in degrees, for cameras without one."""
    near: float | None
    """Near plane in metres; None: fitted to the scene."""
    far: float | None
    """Far plane in metres; None: fitted to the scene."""
    format: DepthFormat
    """File format of depth images."""
    hide: tuple[Path, ...] = ()
    """Nodes to hide with everything below them."""
    show: tuple[Path, ...] = ()
    """Hidden nodes to show."""
    background: tuple[int, int, int] | None = None
    """Background of colour images, 0 .. 255; None: the server's."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """Declaration of a query parameter."""

    name: str
    description: str
    """Description for OpenAPI."""
    schema: Mapping[str, Any]
    """JSON schema, with the limits that ``parse`` checks and the default."""
    example: object
    """Example value for OpenAPI."""
    unit: str = ""
    """Unit of a number, for error messages."""

    def parse(self, text: str) -> Any:
        """Return the value of the parameter, given its text in the query.

        Raises:
            QueryError: The value does not match the schema.
        """
        try:
            if self.name == "camera":
                return parse_camera(text)
            if self.name in ("hide", "show"):
                return parse_paths(self.name, text)
            if self.name == "background":
                return parse_color(self.name, text)
        except (CameraError, ShownError) as error:
            raise QueryError(str(error)) from error
        if "enum" in self.schema:
            choices = {str(choice): choice for choice in self.schema["enum"]}
            if text not in choices:
                raise QueryError(f"{self.name}={quoted(text)} is not one of {', '.join(choices)}")
            return choices[text]
        if self.schema["type"] == "integer":
            return self._parse_integer(text)
        return self._parse_number(text)

    def _parse_integer(self, text: str) -> int:
        value = int(text) if text.isascii() and text.isdigit() and len(text) < 10 else 0
        low, high = self.schema["minimum"], self.schema["maximum"]
        if not low <= value <= high:
            raise QueryError(f"{self.name}={quoted(text)} is not a number of {self.unit} between {low} and {high}")
        return value

    def _parse_number(self, text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise QueryError(f"{self.name}={quoted(text)} is not a number")
        low = self.schema["minimum"]
        high, exclusive_high = self.schema.get("maximum", math.inf), self.schema.get("exclusiveMaximum", math.inf)
        if not (low <= value <= high and value < exclusive_high):
            limit = f"at most {high:g}" if high < math.inf else f"less than {exclusive_high:g}"
            raise QueryError(f"{self.name}={quoted(text)} must be at least {low:g} and {limit} {self.unit}")
        return value

    def openapi(self) -> dict[str, Any]:
        """Return the OpenAPI description."""
        return {
            "name": self.name,
            "in": "query",
            "required": False,
            "description": self.description,
            "schema": dict(self.schema),
            "examples": example(self.example),
        }


TIME_PARAMETER: Final = Parameter(
    "time",
    f"{TIME_DESCRIPTION} Default: now.",
    {"type": "number", "minimum": -MAX_SECONDS, "maximum": MAX_SECONDS},
    -2.5,
    "seconds",
)


def parse_time(query: Mapping[str, str]) -> float | None:
    """Return ``time`` of a query; None if there is none.

    Raises:
        QueryError: It is not a time.
    """
    text = query.get(TIME_PARAMETER.name)
    return None if text is None else TIME_PARAMETER.parse(text)


def image_parameters(config: SceneApiConfig) -> tuple[Parameter, ...]:
    """Return the parameters of ``GET /scene/render``."""
    side = {"type": "integer", "minimum": 1, "maximum": config.max_side}
    pixels = f"Pixels; width x height is at most {config.max_pixels}."
    paths = {"type": "string", "pattern": PATHS_PATTERN}
    plane = {"type": "number", "minimum": MIN_PLANE_DISTANCE, "maximum": MAX_COORDINATE}
    fovy = {"type": "number", "default": DEFAULT_FOVY, "minimum": MIN_FOVY, "exclusiveMaximum": 180}
    return (
        Parameter(
            "camera",
            'stereo, fit, path:["robot","head"] (a node\'s frame, optical: +Z forward, +Y down), or '
            "eye=x,y,z;target=x,y,z;up=x,y,z;fovy=degrees, or xmag=metres in place of fovy (orthographic).",
            {"type": "string", "default": "fit", "pattern": CAMERA_PATTERN},
            "eye=2,-2,1.5;target=0,0,0.5",
        ),
        Parameter("type", "Type of the image.", _choice_schema(get_args(ImageType), "color"), "color"),
        Parameter("width", pixels, {**side, "default": config.width}, 640, "pixels"),
        Parameter("height", pixels, {**side, "default": config.height}, 480, "pixels"),
        Parameter("look", "Shading of colour images.", _choice_schema(get_args(LookName), config.look), config.look),
        Parameter(
            "samples",
            f"Samples per pixel of colour images; default {config.samples} for studio, 1 and FXAA for other looks.",
            {"type": "integer", "enum": list(get_args(SampleCount))},
            4,
        ),
        Parameter("fovy", "Vertical field of view in degrees, for cameras without one.", fovy, DEFAULT_FOVY, "degrees"),
        Parameter(
            "near",
            "Near clipping plane in metres, less than far; by default fitted to the scene.",
            plane,
            0.1,
            "metres",
        ),
        Parameter("far", "Far clipping plane in metres; by default fitted to the scene.", plane, 100.0, "metres"),
        Parameter(
            "format",
            "File format of depth images: TIFF in float32 metres, or PNG in millimetres.",
            _choice_schema(get_args(DepthFormat), "tiff"),
            "tiff",
        ),
        Parameter("hide", "JSON list of the paths of nodes to hide.", paths, '[["robot","arm"]]'),
        Parameter("show", "JSON list of the paths of hidden nodes to show.", paths, '[["ghost"]]'),
        Parameter(
            "background",
            "Background of colour images: red, green and blue in hexadecimal. Default: the server's.",
            {"type": "string", "pattern": COLOR_PATTERN},
            "ffffff",
        ),
        TIME_PARAMETER,
    )


def _choice_schema(choices: tuple[str, ...], default: str) -> dict[str, Any]:
    return {"type": "string", "enum": list(choices), "default": default}


def parse_file_query(query: Mapping[str, str], config: SceneApiConfig) -> ImageQuery | None:
    """Parse the query of ``GET /scene.glb``; return None if it has no parameters besides ``time``.

    Raises:
        QueryError: A parameter is unknown or invalid.
    """
    _check_names(query, FILE_PARAMETERS)
    return parse_query(query, config) if query.keys() - {TIME_PARAMETER.name} else None


def parse_query(query: Mapping[str, str], config: SceneApiConfig) -> ImageQuery:
    """Parse the query of ``GET /scene/render``.

    Raises:
        QueryError: A parameter is unknown or invalid.
    """
    parameters = image_parameters(config)
    _check_names(query, tuple(parameter.name for parameter in parameters))
    values: dict[str, Any] = {"camera": parse_camera("fit"), "hide": (), "show": (), "background": None}
    for parameter in parameters:
        if parameter.name in query:
            values[parameter.name] = parameter.parse(query[parameter.name])
        else:
            values.setdefault(parameter.name, parameter.schema.get("default"))
    width, height, near, far = values["width"], values["height"], values["near"], values["far"]
    if width * height > config.max_pixels:
        raise QueryError(f"width x height = {width}x{height} has more than {config.max_pixels} pixels")
    if near is not None and far is not None and near >= far:
        raise QueryError(f"near={quoted(query['near'])} must be less than far={quoted(query['far'])}")
    if values["samples"] is None:
        values["samples"] = config.samples if values["look"] == "studio" else 1
    del values[TIME_PARAMETER.name]  # of the scene, not of its image
    return ImageQuery(**values)


def _check_names(query: Mapping[str, str], names: tuple[str, ...]) -> None:
    for name in query:
        if name not in names:
            raise QueryError(f"{quoted(name)} is not a parameter; the parameters are {', '.join(names)}")


def openapi_parameters(config: SceneApiConfig) -> list[dict[str, Any]]:
    """Return the OpenAPI description of the parameters of ``GET /scene/render``."""
    return [parameter.openapi() for parameter in image_parameters(config)]


def openapi_file_parameters(config: SceneApiConfig) -> list[dict[str, Any]]:
    """Return the OpenAPI description of the parameters of ``GET /scene.glb``."""
    camera, *others = (entry for entry in openapi_parameters(config) if entry["name"] in FILE_PARAMETERS)
    hint = "Camera in the file, which clients of /render need; without any parameter the file has no camera. "
    return [{**camera, "description": f"{hint}{camera['description']}"}, *others]
