"""A scene and a camera to encoded pictures."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache, reduce
from operator import or_
from pathlib import Path
from typing import Final, Literal

from gateway.assets.light_rig_file import read_rig
from gateway.client.manifest import ImageType, Settings
from gateway.datasets.scenes import LoadedScene
from gateway.render.camera import camera_of
from gateway.render.config import RenderConfig
from gateway.render.depth import millimetres
from gateway.render.form import RenderRequest
from gateway.render.pipeline import Pipeline, posted_document
from renderers.camera import Camera
from renderers.drawlist import Topology
from renderers.encode import jpeg_rgb, png_gray16, png_label, png_rgb, tiff_float32
from renderers.fxaa import fxaa
from renderers.interface import Frame, Look, LookName, Output, Renderer, SampleCount
from renderers.light_rig import STUDIO, Rig

OUTPUTS: Final[dict[ImageType, Output]] = {"color": Output.COLOR, "depth": Output.DEPTH, "label": Output.LABEL}
FORMATS: Final[dict[ImageType, tuple[str, ...]]] = {
    "color": ("png", "jpg", "jpeg"),
    "depth": ("tiff", "tif", "png"),
    "label": ("png",),
}
"""By type of picture, the first is the default."""


@dataclass(frozen=True, slots=True)
class Style:
    """How colour is made."""

    look: Literal["auto", "phong", "pbr", "plain", "studio"] = "auto"
    background: tuple[int, int, int] = Look().background
    antialias: Literal["fxaa", "none"] = "fxaa"
    """Of pictures with one sample a pixel."""
    samples: Literal[0, 1, 4, 8] = 0
    """0: 4 of the studio look, 1 of the others."""
    rig: Rig = STUDIO
    """What lights the studio look."""


def style_of(settings: Settings) -> Style:
    """The style that a dataset's settings say.

    Raises:
        RigFileError: the rig's file cannot be used.
    """
    return Style(
        settings.look,  # type: ignore[arg-type]  # checked when the settings were made
        settings.background,
        settings.antialias,  # type: ignore[arg-type]  # as the look
        settings.samples,  # type: ignore[arg-type]  # as the look
        STUDIO if settings.rig is None else _rig(settings.rig),
    )


def unlit_by_rig(scene: LoadedScene, settings: Settings) -> str | None:
    """Why the lights of ``--rig`` do not light a scene, as a sentence; None: they do, there are none, or the look that
    was asked for never has them.

    Raises:
        RigFileError: the rig's file cannot be used.
    """
    if settings.rig is None or "color" not in settings.types or settings.look not in ("auto", "studio"):
        return None
    if scene.request is not None:
        return "a recorded request is drawn as /render does, without --rig"
    if settings.look == "auto" and scene.look != "studio":
        return "drawn as Drake shows it, without --rig; --look studio takes it"
    rig = _rig(settings.rig)
    if scene.drawn.lights and rig.lights and rig.scene_lights:
        return "its own lights replace those of --rig; scene_lights = false in the rig's file keeps them"
    return None


@lru_cache(maxsize=4)
def _rig(path: str) -> Rig:
    return read_rig(Path(path))


def draw(
    renderer: Renderer, scene: LoadedScene, camera: Camera, formats: dict[ImageType, str], style: Style
) -> dict[ImageType, bytes]:
    """The pictures of a scene, all from one pass.

    Args:
        formats: which types, each with one of ``FORMATS``.

    Raises:
        ImageError: a texture that colour needs cannot be decoded.
        ValueError: the picture is larger than the renderer makes them.
    """
    look: LookName = scene.look if style.look == "auto" else style.look
    wanted = reduce(or_, (OUTPUTS[image_type] for image_type in formats))
    samples: SampleCount = style.samples or (4 if look == "studio" else 1)
    with renderer.render(scene.drawn, camera, wanted, Look(look, style.background, samples, style.rig)) as frame:
        # FXAA takes a point of one pixel for a flaw and pales it.
        points = any(instance.mesh.topology is Topology.POINTS for instance in scene.drawn.instances)
        smooth = style.antialias == "fxaa" and samples == 1 and look != "studio" and not points
        if frame.color is not None and smooth:
            fxaa(frame.color)
        return {image_type: _encoded(frame, image_type, name) for image_type, name in formats.items()}


def _encoded(frame: Frame, image_type: ImageType, name: str) -> bytes:
    if image_type == "color":
        assert frame.color is not None
        return png_rgb(frame.color) if name == "png" else jpeg_rgb(frame.color)
    if image_type == "label":
        assert frame.label is not None
        return png_label(frame.label)
    assert frame.depth is not None
    return png_gray16(millimetres(frame.depth)) if name == "png" else tiff_float32(frame.depth)


class RequestDrawer:
    """Draws recorded requests as the endpoint does."""

    def __init__(self, renderer: Renderer, settings: Settings) -> None:
        look = settings.look if settings.look in ("phong", "pbr") else "auto"
        config = RenderConfig(
            look=look,  # type: ignore[arg-type]  # checked when the settings were made
            background=settings.background,
            antialias=settings.antialias,  # type: ignore[arg-type]  # as the look
            samples=settings.samples or 1,  # type: ignore[arg-type]  # as the look
            depth_format="png16" if settings.depth_format == "png" else "tiff32f",
            scene_cache_count=1,
        )
        self._pipeline = Pipeline(renderer, config)

    def draw(self, request: RenderRequest) -> tuple[Camera, ImageType, bytes]:
        """
        Raises:
            RequestError: the scene or its camera cannot be used.
        """
        picture = self._pipeline.picture(request)
        camera = camera_of(request, self._pipeline.scenes.get(posted_document(request)))
        return camera, request.image_type, picture.body
