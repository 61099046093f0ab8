"""Renders one request in a worker thread: reads the scene, renders, and encodes the image. No I/O."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from gateway.gltf import DRAKE_MERGER, GltfError, HashedDocument
from gateway.render.camera import camera_of
from gateway.render.config import RenderConfig
from gateway.render.errors import RequestError
from gateway.render.form import RenderRequest
from gateway.render.scenes import PreparedScene, SceneStore
from gateway.runtime.tracing import span
from gateway.scene.flatten import flatten
from gateway.scene.tree import Node
from renderers.depth_range import depth_in_millimetres, limit_depth
from renderers.drawlist import DrawList, ImageError
from renderers.encode import png_gray16, png_label, png_rgb, tiff_float32
from renderers.fxaa import fxaa
from renderers.interface import Frame, LookName, Output, Renderer
from scenegate.warning_text import strict_refusal

Backdrop = Callable[[], Node]
"""Returns the root of a scene to draw in addition to the request's: a new object if and only if it has changed."""

_OUTPUTS: Final = {"color": Output.COLOR, "depth": Output.DEPTH, "label": Output.LABEL}
_LOOKS: Final[dict[str, LookName]] = {"VTK": "phong", DRAKE_MERGER: "pbr"}
"""Look by ``asset.generator``. RenderEngineVtk uses PBR if the scene has a glTF mesh. The generator tells: the client's
merger writes the documents of such scenes, and VTK's exporter those of all others."""


@dataclass(frozen=True, slots=True)
class EncodedImage:
    """An encoded image."""

    body: bytes
    """The image file."""
    media_type: str
    stage_seconds: tuple[tuple[str, float], ...]
    """Names and durations of the stages ``parse``, ``render`` and ``encode``."""
    generator: str
    """``asset.generator`` of the scene."""
    element_count: int
    """Number of triangles, lines and points of the scene, without the backdrop."""
    warnings: tuple[str, ...]
    """Sentences about properties of the scene that the reader ignored or repaired."""


class Pipeline:
    """Renders requests. Thread-safe."""

    def __init__(self, renderer: Renderer, config: RenderConfig, backdrop: Backdrop | None = None) -> None:
        self._renderer = renderer
        self._config = config
        self._backdrop = backdrop
        self._last_backdrop: tuple[Node, DrawList] | None = None
        """Last result of ``backdrop``, and its draw list, without labels."""
        self.scenes = SceneStore(config)

    def render(self, request: RenderRequest) -> EncodedImage:
        """Render a request.

        Raises:
            RequestError: The scene, its camera or one of its images cannot be used.
        """
        start_time = time.perf_counter()
        document = posted_document(request)
        try:
            try:
                return self._render_scene(request, document, start_time)
            except ImageError:  # nearly no document has a broken image, so that this is not checked before
                return self._render_scene(request, document, start_time, decode_images=True)
        except (GltfError, ImageError) as error:
            raise RequestError(400, f"scene: {error}") from error

    def _render_scene(
        self, request: RenderRequest, document: HashedDocument, start_time: float, *, decode_images: bool = False
    ) -> EncodedImage:
        with span("parse"):
            scene = self.scenes.get(document, decode_images=decode_images)
            if self._config.strict and scene.warnings:
                raise RequestError(400, f"scene: {strict_refusal(scene.warnings)}")
            camera = camera_of(request, scene)
            draw_list = scene.draw_list if self._backdrop is None else _joined(scene.draw_list, self._flat_backdrop())
        parsed_time = time.perf_counter()
        look = self._config.style.look_for(_LOOKS.get(scene.generator, "gltf"), request.look)
        with span("render"):
            frame = self._renderer.render(draw_list, camera, _OUTPUTS[request.image_type], look)
        rendered_time = time.perf_counter()
        with span("encode"):
            body, media_type = self._encode(frame, request)
        encoded_time = time.perf_counter()
        return EncodedImage(
            body=body,
            media_type=media_type,
            stage_seconds=(
                ("parse", parsed_time - start_time),
                ("render", rendered_time - parsed_time),
                ("encode", encoded_time - rendered_time),
            ),
            generator=scene.generator,
            element_count=scene.element_count,
            warnings=scene.warnings + (_label_warnings(scene) if request.image_type == "label" else ()),
        )

    def _flat_backdrop(self) -> DrawList:
        """Return the draw list of the backdrop, which is flattened again only if it has changed."""
        assert self._backdrop is not None
        root, cached = self._backdrop(), self._last_backdrop
        if cached is None or cached[0] is not root:
            cached = self._last_backdrop = root, flatten(root)
        return cached[1]

    def _encode(self, frame: Frame, request: RenderRequest) -> tuple[bytes, str]:
        if request.image_type == "color":
            assert frame.color is not None
            if self._config.style.antialias == "fxaa" and self._config.style.samples == 1:
                fxaa(frame.color)
            return png_rgb(frame.color), "image/png"
        if request.image_type == "label":
            assert frame.label is not None
            return png_label(frame.label), "image/png"
        assert frame.depth is not None
        limit_depth(frame.depth, request.min_depth, request.max_depth)
        if self._config.depth_format == "png":
            return png_gray16(depth_in_millimetres(frame.depth)), "image/png"
        return tiff_float32(frame.depth), "image/tiff"


def _joined(scene: DrawList, backdrop: DrawList) -> DrawList:
    images = tuple(dict.fromkeys((*scene.images, *backdrop.images)))
    return DrawList((*scene.instances, *backdrop.instances), images, scene.lights + backdrop.lights)


def _label_warnings(scene: PreparedScene) -> tuple[str, ...]:
    """Return a warning about instances without a label, if there are any."""
    if scene.unlabelled_count == 0:
        return ()
    sentence = (
        f"meshes without a material are white in label images ({scene.unlabelled_count} here): Drake's client sends "
        "labels in materials. Give them one in their glTF file"
    )
    return (sentence,)


def posted_document(request: RenderRequest) -> HashedDocument:
    """Return the posted scene with its hash.

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
