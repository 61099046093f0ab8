"""A request to the bytes of its image: read the scene, render, encode. No I/O; runs in worker threads."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from gateway.gltf import GltfError, HashedDocument
from gateway.render.camera import camera_of
from gateway.render.config import RenderConfig
from gateway.render.depth import millimetres
from gateway.render.errors import RequestError
from gateway.render.form import RenderRequest
from gateway.render.labels import unlabelled
from gateway.render.scenes import SceneStore
from gateway.scene.flatten import flatten
from gateway.scene.tree import Node
from renderers.depth_range import limit_depth
from renderers.drawlist import DrawList, ImageError
from renderers.encode import png_gray16, png_label, png_rgb, tiff_float32
from renderers.fxaa import fxaa
from renderers.interface import Frame, Look, LookName, Output, Renderer

Backdrop = Callable[[], DrawList | Node | None]
"""Return the scene to draw besides the request's; the same object means that it has not changed."""

_OUTPUTS: Final = {"color": Output.COLOR, "depth": Output.DEPTH, "label": Output.LABEL}
_LOOKS: Final[dict[str, LookName]] = {"VTK": "phong", "Drake glTF merger": "pbr"}
"""Looks by ``asset.generator``. RenderEngineVtk switches to PBR as soon as one glTF mesh exists; then the client's
merger writes the file, else VTK's exporter."""


@dataclass(frozen=True, slots=True)
class Picture:
    """An encoded image."""

    body: bytes
    media_type: str
    stages: tuple[tuple[str, float], ...]
    """Durations of the stages: (name, seconds)."""
    generator: str
    """``asset.generator`` of the scene."""
    elements: int
    """Number of triangles, lines and points of the scene, without the backdrop."""
    warnings: tuple[str, ...]
    """Sentences about properties that the reader ignored or repaired."""


class Pipeline:
    """Renders requests. Thread-safe."""

    def __init__(self, renderer: Renderer, config: RenderConfig, backdrop: Backdrop | None = None) -> None:
        self._renderer = renderer
        self._config = config
        self._backdrop = backdrop
        self._last_backdrop: tuple[DrawList | Node, DrawList] | None = None
        self.scenes = SceneStore(config)

    def picture(self, request: RenderRequest) -> Picture:
        """Render a request.

        Raises:
            RequestError: The scene, its camera or one of its images cannot be used.
        """
        begin = time.perf_counter()
        try:
            scene = self.scenes.get(posted_document(request))
            camera = camera_of(request, scene)
            drawn = self._with_backdrop(scene.drawn)
            parsed = time.perf_counter()
            look = Look(self._look(scene.generator), self._config.background, self._config.samples)
            with self._renderer.render(drawn, camera, _OUTPUTS[request.image_type], look) as frame:
                rendered = time.perf_counter()
                body, media_type = self._encode(frame, request)
        except (GltfError, ImageError) as error:
            raise RequestError(400, f"scene: {error}") from error
        encoded = time.perf_counter()
        return Picture(
            body=body,
            media_type=media_type,
            stages=(("parse", parsed - begin), ("render", rendered - parsed), ("encode", encoded - rendered)),
            generator=scene.generator,
            elements=scene.element_count,
            warnings=scene.warnings,
        )

    def _look(self, generator: str) -> LookName:
        if self._config.look != "auto":
            return self._config.look
        return _LOOKS.get(generator, self._config.default_look)

    def _with_backdrop(self, drawn: DrawList) -> DrawList:
        source = self._backdrop() if self._backdrop is not None else None
        if source is None:
            return drawn
        last = self._last_backdrop
        if last is None or last[0] is not source:
            last = (source, flatten(source) if isinstance(source, Node) else unlabelled(source))
            self._last_backdrop = last
        backdrop = last[1]
        images = tuple(dict.fromkeys((*drawn.images, *backdrop.images)))
        return DrawList((*drawn.instances, *backdrop.instances), images)

    def _encode(self, frame: Frame, request: RenderRequest) -> tuple[bytes, str]:
        if request.image_type == "color":
            assert frame.color is not None
            if self._config.antialias == "fxaa" and self._config.samples == 1:
                fxaa(frame.color)
            return png_rgb(frame.color), "image/png"
        if request.image_type == "label":
            assert frame.label is not None
            return png_label(frame.label), "image/png"
        assert frame.depth is not None
        limit_depth(frame.depth, request.min_depth, request.max_depth)
        if self._config.depth_format == "png16":
            return png_gray16(millimetres(frame.depth)), "image/png"
        return tiff_float32(frame.depth), "image/tiff"


def posted_document(request: RenderRequest) -> HashedDocument:
    """Hash the posted scene.

    Raises:
        RequestError: The hash differs from the one in the form.
    """
    document = HashedDocument(request.scene)
    if request.claimed_sha256 not in (None, document.digest):
        raise RequestError(
            400,
            f"scene_sha256 does not match: the form says {request.claimed_sha256}, but the {len(request.scene)} bytes "
            f"of the scene that arrived have {document.digest}",
        )
    return document
