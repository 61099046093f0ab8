"""Query parameters of ``/scene``, ``/scene.glb`` and ``/scene/render``."""

from typing import Any, Literal, Self

from fastapi import Query
from pydantic import BaseModel, ConfigDict, field_validator, model_validator

from gateway.adapters.sceneapi.config import SceneApiConfig
from gateway.runtime.http.openapi import example
from gateway.runtime.http.scene_query import TIME_PARAMETER, ColorQuery, ViewQuery, side_parameter
from gateway.scene.draw.cameras import DEFAULT_FOVY, MAX_COORDINATE, MIN_FOVY, MIN_PLANE_DISTANCE
from gateway.scene.draw.style import STUDIO_SAMPLES
from renderers.interface import LookName, SampleCount

_DEFAULTS = SceneApiConfig()


def _plane(name: str, shown: float) -> Any:
    text = f"{name} clipping plane in metres, near less than far; by default fitted to the scene."
    return Query(None, ge=MIN_PLANE_DISTANCE, le=MAX_COORDINATE, description=text, openapi_examples=example(shown))


class SceneQuery(BaseModel):
    """Parameters of ``GET /scene``."""

    model_config = ConfigDict(frozen=True)

    time: float | None = TIME_PARAMETER


class FileQuery(SceneQuery, ViewQuery):
    """Parameters of ``GET /scene.glb``: the camera in the file. Without any but ``time`` the file has none."""

    model_config = ConfigDict(extra="forbid")

    width: int | None = side_parameter(
        _DEFAULTS.width, max_side=_DEFAULTS.max_side, max_pixels_text="--max-pixels", example_value=640
    )
    height: int | None = side_parameter(
        _DEFAULTS.height, max_side=_DEFAULTS.max_side, max_pixels_text="--max-pixels", example_value=480
    )
    fovy: float = Query(
        DEFAULT_FOVY,
        ge=MIN_FOVY,
        lt=180,
        description="Vertical field of view in degrees, for cameras without one.",
        openapi_examples=example(DEFAULT_FOVY),
    )
    near: float | None = _plane("Near", 0.1)
    far: float | None = _plane("Far", 100.0)

    @model_validator(mode="after")
    def _near_before_far(self) -> Self:
        if self.near is not None and self.far is not None and self.near >= self.far:
            raise ValueError(f"near={self.near:g} must be less than far={self.far:g}")
        return self


class ImageQuery(FileQuery, ColorQuery):
    """Parameters of ``GET /scene/render``."""

    type: Literal["color", "depth", "label"] = Query(
        "color", description="Type of the image.", openapi_examples=example("color")
    )
    look: LookName = Query(
        _DEFAULTS.look, description="Shading of colour images.", openapi_examples=example(_DEFAULTS.look)
    )
    samples: SampleCount | None = Query(
        None,
        description=(
            f"Samples per pixel of colour images; default {STUDIO_SAMPLES} for studio, 1 for other looks. With 1, FXAA "
            "smooths edges."
        ),
        openapi_examples=example(4),
    )
    format: Literal["tiff", "png"] = Query(
        "tiff",
        description="File format of depth images: TIFF in float32 metres, or PNG in millimetres.",
        openapi_examples=example("tiff"),
    )

    @field_validator("samples", mode="before")
    @classmethod
    def _to_number(cls, value: str) -> object:
        return int(value) if value in ("1", "4", "8") else value
