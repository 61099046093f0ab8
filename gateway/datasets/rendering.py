"""Render loaded scenes and recorded requests to encoded images.

``worker`` uses it for datasets, ``gateway.cli`` for single images.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache, reduce
from operator import or_
from pathlib import Path
from typing import Final, Literal

from gateway.assets.light_rig_file import NO_LIGHT, read_rig
from gateway.datasets.scenes import LoadedScene
from gateway.render.camera import camera_of
from gateway.render.config import LookChoice, RenderConfig
from gateway.render.form import RenderRequest
from gateway.render.pipeline import Pipeline, posted_document
from renderers.camera import Camera
from renderers.depth_range import depth_in_millimetres
from renderers.drawlist import Topology
from renderers.encode import jpeg_rgb, png_gray16, png_label, png_rgb, tiff_float32
from renderers.fxaa import fxaa
from renderers.interface import Frame, Look, LookName, Output, Renderer, SampleCount
from renderers.light_rig import STUDIO, Rig
from scenegate.datasets.manifest import ImageType, Settings

OUTPUTS: Final[dict[ImageType, Output]] = {"color": Output.COLOR, "depth": Output.DEPTH, "label": Output.LABEL}
"""The renderer's output for each type of image."""
IMAGE_FORMATS: Final[dict[ImageType, tuple[str, ...]]] = {
    "color": ("png", "jpg", "jpeg"),
    "depth": ("tiff", "tif", "png"),
    "label": ("png",),
}
"""Suffixes of the file formats of each type of image. The first is the default."""


@dataclass(frozen=True, slots=True)
class Style:
    """Shading of colour images, and what is cut out of the others."""

    look: LookChoice = "auto"
    """Look; ``auto``: ``LoadedScene.look``."""
    background: tuple[int, int, int] = Look().background
    """RGB background."""
    antialias: Literal["fxaa", "none"] = "fxaa"
    """Anti-aliasing of images with one sample per pixel."""
    samples: Literal[0, 1, 4, 8] = 0
    """Samples per pixel; 0: 4 for the look ``studio``, 1 for the others."""
    rig: Rig = STUDIO
    """Lights of the look ``studio``."""
    alpha_threshold: float = 0.0
    """As ``Look.alpha_threshold``."""


def style_of(settings: Settings) -> Style:
    """Return the style that a dataset's settings describe.

    Raises:
        RigFileError: the rig file is invalid.
    """
    return Style(
        settings.look,  # type: ignore[arg-type]  # checked by the command
        settings.background,
        settings.antialias,  # type: ignore[arg-type]  # as the look
        settings.samples,  # type: ignore[arg-type]  # as the look
        STUDIO if settings.rig is None else _rig(settings.rig),
        settings.alpha_threshold,
    )


def ignored_rig(scene: LoadedScene, settings: Settings) -> str | None:
    """Return a warning if a scene does not use the lights of ``--rig``, or is black as neither of them has one.

    Returns None if the scene uses them, if there is no ``--rig``, or if ``--look`` excludes them for all scenes.

    Raises:
        RigFileError: the rig file is invalid.
    """
    if settings.rig is None or "color" not in settings.types or settings.look not in ("auto", "studio"):
        return None
    if settings.look == "auto" and (scene.request is not None or scene.look != "studio"):
        return "drawn as Drake shows it, without --rig; --look studio takes it"
    rig = _rig(settings.rig)
    if scene.draw_list.lights and rig.lights and rig.scene_lights:
        return "its own lights replace those of --rig; scene_lights = false in the rig's file keeps them"
    if rig.is_dark and not (scene.draw_list.lights and rig.scene_lights):
        return f"drawn black: {NO_LIGHT} (--rig)"
    return None


@lru_cache(maxsize=4)
def _rig(path: str) -> Rig:
    """Read a rig file, or return it from the cache."""
    return read_rig(Path(path))


def render_images(
    renderer: Renderer, scene: LoadedScene, camera: Camera, formats: dict[ImageType, str], style: Style
) -> dict[ImageType, bytes]:
    """Render the images of a scene with one call of the renderer; return them encoded, by type.

    Args:
        renderer: renders the images.
        scene: the scene.
        camera: the camera.
        formats: file format of each type of image to render, one of ``IMAGE_FORMATS``.
        style: shading of the colour image.

    Raises:
        ImageError: a texture cannot be decoded.
        ValueError: the image is larger than the renderer's limit.
    """
    look: LookName = scene.look if style.look == "auto" else style.look
    outputs = reduce(or_, (OUTPUTS[image_type] for image_type in formats))
    samples: SampleCount = style.samples or (4 if look == "studio" else 1)
    full_look = Look(look, style.background, samples, style.rig, style.alpha_threshold)
    scenery = None if scene.scenario is None else scene.scenario.scenery
    full_look = full_look if scenery is None else scenery.look(full_look)
    frame = renderer.render(scene.draw_list, camera, outputs, full_look)
    # FXAA would blur points, which may be one pixel wide.
    has_points = any(instance.mesh.topology is Topology.POINTS for instance in scene.draw_list.instances)
    use_fxaa = style.antialias == "fxaa" and samples == 1 and look != "studio" and not has_points
    if frame.color is not None and use_fxaa:
        fxaa(frame.color)
    if frame.color is not None and scenery is not None:
        frame.color = scenery.finish(frame.color, scene.draw_list, camera, renderer, full_look)
    return {image_type: _encode(frame, image_type, file_format) for image_type, file_format in formats.items()}


def _encode(frame: Frame, image_type: ImageType, file_format: str) -> bytes:
    """Encode an image of a frame in one of ``IMAGE_FORMATS``."""
    if image_type == "color":
        assert frame.color is not None
        return png_rgb(frame.color) if file_format == "png" else jpeg_rgb(frame.color)
    if image_type == "label":
        assert frame.label is not None
        return png_label(frame.label)
    assert frame.depth is not None
    return png_gray16(depth_in_millimetres(frame.depth)) if file_format == "png" else tiff_float32(frame.depth)


class RequestRenderer:
    """Renders recorded requests like the render endpoint, with the settings of the dataset."""

    def __init__(self, renderer: Renderer, settings: Settings) -> None:
        style = style_of(settings)
        config = RenderConfig(
            look=style.look,
            rig=style.rig,
            background=style.background,
            antialias=style.antialias,
            samples=style.samples or (4 if style.look == "studio" else 1),
            alpha_threshold=style.alpha_threshold,
            depth_format="png16" if settings.depth_format == "png" else "tiff32f",
            scene_cache_count=1,
        )
        self._pipeline = Pipeline(renderer, config)

    def render(self, request: RenderRequest) -> tuple[Camera, ImageType, bytes]:
        """Render a request; return its camera, the type of its image and the encoded image.

        Raises:
            RequestError: the scene or its camera cannot be used.
        """
        image = self._pipeline.render(request)
        camera = camera_of(request, self._pipeline.scenes.get(posted_document(request)))
        return camera, request.image_type, image.body
