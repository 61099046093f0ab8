"""Query parameters of images of the scene, each declared once for ``/scene``, ``/view`` and ``/cameras``.

FastAPI parses them, describes them for OpenAPI, and responds to invalid ones (``error_handlers.invalid_parameters``).
"""

from typing import Any, Final

from fastapi import Query
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, ConfigDict, ValidationInfo, field_validator

from gateway.runtime.http.openapi import example
from gateway.scene.draw.cameras import CAMERA_PATTERN, PATHS_PATTERN, CameraSpec, parse_camera
from gateway.scene.draw.shown import COLOR_PATTERN, parse_color, parse_paths
from gateway.scene.tree.nodes import Path
from gateway.scene.tree.timeline import MAX_SECONDS, TIME_DESCRIPTION
from renderers.light_rig import LightChange

TIME_PARAMETER: Final[Any] = Query(
    None,
    ge=-MAX_SECONDS,
    le=MAX_SECONDS,
    description=f"{TIME_DESCRIPTION} Default: now.",
    openapi_examples=example(-2.5),
)

MAX_LIGHT_FACTOR: Final = 100.0
"""Maximum factor of the light: a hundred times brighter, most images are white."""


def side_parameter(default: int, *, max_side: int, max_pixels_text: str, example_value: int) -> Any:
    """Return the parameter of a width or height."""
    return Query(
        None,
        ge=1,
        description=f"Pixels; width x height is at most {max_pixels_text}. Default: {default}.",
        json_schema_extra={"maximum": max_side},  # not le=: ``ViewQuery.size`` words the error
        openapi_examples=example(example_value),
    )


class ViewQuery(BaseModel):
    """Camera, visible nodes and size of an image. Subclasses describe the size, as they have other limits.

    OpenAPI has the patterns of texts, whose parsers word the errors.
    """

    model_config = ConfigDict(frozen=True)

    camera: str = Query(
        "fit",
        description=(
            'stereo, fit, path:["robot","head"] (a node\'s frame, optical: +Z forward, +Y down), or '
            "eye=x,y,z;target=x,y,z;up=x,y,z;fovy=degrees, or xmag=metres in place of fovy (orthographic)."
        ),
        json_schema_extra={"pattern": CAMERA_PATTERN},
        openapi_examples=example("eye=2,-2,1.5;target=0,0,0.5"),
    )
    width: int | None = None
    height: int | None = None
    hide: str = Query(
        "[]",
        description="JSON list of the paths of nodes to hide, with everything below them.",
        json_schema_extra={"pattern": PATHS_PATTERN},
        openapi_examples=example('[["robot","arm"]]'),
    )
    show: str = Query(
        "[]",
        description="JSON list of the paths of hidden nodes to show.",
        json_schema_extra={"pattern": PATHS_PATTERN},
        openapi_examples=example('[["ghost"]]'),
    )

    @field_validator("camera")
    @classmethod
    def _check_camera(cls, text: str) -> str:
        parse_camera(text)
        return text

    @field_validator("hide", "show")
    @classmethod
    def _check_paths(cls, text: str, info: ValidationInfo) -> str:
        parse_paths(str(info.field_name), text)
        return text

    @property
    def camera_spec(self) -> CameraSpec:
        """The camera as asked for; a scene resolves it."""
        return parse_camera(self.camera)

    @property
    def hidden(self) -> tuple[Path, ...]:
        """Nodes to hide with everything below them."""
        return parse_paths("hide", self.hide)

    @property
    def shown(self) -> tuple[Path, ...]:
        """Hidden nodes to show."""
        return parse_paths("show", self.show)

    def size(self, width: int, height: int, max_side: int, max_pixels: int) -> tuple[int, int]:
        """Return width and height in pixels, given their defaults and limits.

        Raises:
            RequestValidationError: the image is too large.
        """
        width, height = self.width or width, self.height or height
        if max(width, height) > max_side or width * height > max_pixels:
            limits = f"{max_side} pixels per side and {max_pixels} pixels in total"
            reason = f"{width}x{height} is too large; the limits are {limits}"
            raise RequestValidationError([{"type": "value_error", "loc": ("query",), "msg": reason}])
        return width, height


class ColorQuery(ViewQuery):
    """Parameters of colour images."""

    background: str | None = Query(
        None,
        description="Background of colour images: red, green and blue in hexadecimal. Default: the server's.",
        json_schema_extra={"pattern": COLOR_PATTERN},
        openapi_examples=example("ffffff"),
    )

    light_azimuth: float | None = Query(
        None,
        ge=-360,
        le=360,
        description="Direction from which the key light of the look studio comes, its first directional light: "
        "degrees from +X, counter-clockwise seen from above. Default: the rig's.",
        openapi_examples=example(-120.0),
    )
    light_elevation: float | None = Query(
        None, ge=-90, le=90, description="Its degrees above the horizon.", openapi_examples=example(60.0)
    )
    light_strength: float = Query(
        1.0, ge=0, le=MAX_LIGHT_FACTOR, description="Factor of the key light.", openapi_examples=example(1.5)
    )
    light_ambient: float = Query(
        1.0, ge=0, le=MAX_LIGHT_FACTOR, description="Factor of the environment.", openapi_examples=example(0.5)
    )

    @field_validator("background")
    @classmethod
    def _check_background(cls, text: str) -> str:
        parse_color("background", text)
        return text

    @property
    def light(self) -> LightChange:
        """Changes of the server's light."""
        return LightChange(self.light_azimuth, self.light_elevation, self.light_strength, self.light_ambient)

    @property
    def background_rgb(self) -> tuple[int, int, int] | None:
        """Background, 0 .. 255; None: the server's."""
        return None if self.background is None else parse_color("background", self.background)
