"""Renders one request in a worker thread: reads the scene, renders, and encodes the image. No I/O."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.render.config import RenderConfig
from gateway.adapters.render.errors import RequestError
from gateway.adapters.render.request import RenderRequest
from gateway.adapters.render.scenes import PreparedScene, SceneStore
from gateway.files.gltf import DRAKE_MERGER, VTK_EXPORTER, GltfError, HashedDocument
from gateway.runtime.logs import tracing
from gateway.scene.draw.flatten import flatten
from gateway.scene.tree.nodes import Node
from renderers.camera import OPENGL_FROM_OPTICAL, Camera
from renderers.depth_range import depth_in_millimetres, limit_depth
from renderers.drawlist import DrawList, ImageError
from renderers.encode import png_gray16, png_label, png_rgb, tiff_float32
from renderers.fxaa import fxaa
from renderers.interface import Frame, Look, LookName, Output, Renderer
from scenegate.warning_text import strict_refusal

Backdrop = Callable[[], Node]
"""Returns the root of a scene to draw in addition to the request's: a new object if and only if it has changed."""

_OUTPUTS: Final = {"color": Output.COLOR, "depth": Output.DEPTH, "label": Output.LABEL}
_LOOKS: Final[dict[str, LookName]] = {VTK_EXPORTER: "phong", DRAKE_MERGER: "pbr"}
"""Look by ``asset.generator``. RenderEngineVtk uses PBR if the scene has a glTF mesh. The generator tells: the client's
merger writes the documents of such scenes, and VTK's exporter those of all others."""
_NEAR_FAR_RATIO: Final = 1e-6
"""Ratio of near to far plane, used if neither the form nor the scene's camera has a near plane."""
_MIN_NEAR: Final = 1e-9
"""Minimum near plane, metres: with it, the rasterizer's 1/z fits float32. It is less than ``request.MIN_FAR``."""
_MAX_COORDINATE: Final = 1e12
"""Maximum coordinate of the camera, metres. Larger float64 coordinates do not resolve millimetres."""
_RIGID_TOLERANCE: Final = 1e-6
"""Maximum error of a rotation matrix that is used unchanged: the rounding error of numbers with six digits."""
_MIN_ANGLE: Final = 1e-9
"""Minimum angle between up and the line of sight, radians. With a smaller angle the pose is singular."""
_NO_CAMERA: Final = (
    "the scene has geometry but no camera: Drake's client leaves the camera out when everything with a perception role "
    "is a glTF mesh. Add any other geometry with a perception role (a Box, Sphere or OBJ mesh, as small as you like) "
    "to the SceneGraph; other clients: add a 'cameras' entry and a node with \"camera\": 0, "
    "or export the live scene with one: /scene.glb?camera=fit"
)
_UNLABELLED: Final = (
    "meshes without a material are white in label images ({} here): Drake's client sends labels in materials. Give "
    "them one in their glTF file"
)


@dataclass(frozen=True, slots=True)
class EncodedImage:
    """An encoded image."""

    body: bytes
    """The image file."""
    media_type: str
    stage_seconds: tuple[tuple[str, float], ...]
    """Names and durations of the stages ``queue``, ``parse``, ``render`` and ``encode``."""
    end_time: float
    """End of the last stage, by ``time.perf_counter``."""
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

    def render(self, request: RenderRequest, submitted_time: float | None = None) -> EncodedImage:
        """Render a request.

        Args:
            submitted_time: Time at which the request began to wait for this call, by ``time.perf_counter``.

        Raises:
            RequestError: The scene, its camera or one of its images cannot be used.
        """
        start_time = time.perf_counter()
        queue_seconds = start_time - submitted_time if submitted_time is not None else 0.0
        document = posted_document(request, self.scenes)
        try:
            try:
                return self._render_scene(request, document, start_time, queue_seconds)
            except ImageError:  # nearly no document has a broken image, so that this is not checked before
                return self._render_scene(request, document, start_time, queue_seconds, decode_images=True)
        except (GltfError, ImageError) as error:
            raise RequestError(400, f"scene: {error}") from error

    def _render_scene(
        self,
        request: RenderRequest,
        document: HashedDocument,
        start_time: float,
        queue_seconds: float,
        *,
        decode_images: bool = False,
    ) -> EncodedImage:
        with tracing.span("parse"):
            scene = self.scenes.get(document, decode_images=decode_images)
            if self._config.strict and (refusal := strict_refusal(scene.warnings)):
                raise RequestError(400, f"scene: {refusal}")
            camera = camera_of(request, scene)
            draw_list = scene.draw_list if self._backdrop is None else _joined(scene.draw_list, self._flat_backdrop())
        parsed_time = time.perf_counter()
        look = self._config.style.look_for(_LOOKS.get(scene.generator, "gltf"), request.look)
        with tracing.span("render"):
            frame = self._renderer.render(draw_list, camera, _OUTPUTS[request.image_type], look)
        rendered_time = time.perf_counter()
        with tracing.span("encode"):
            body, media_type = self._encode(frame, request, look)
        encoded_time = time.perf_counter()
        warnings = scene.warnings
        if request.image_type == "label" and scene.unlabelled_count:
            warnings += (_UNLABELLED.format(scene.unlabelled_count),)
        return EncodedImage(
            body=body,
            media_type=media_type,
            stage_seconds=(
                ("queue", queue_seconds),
                ("parse", parsed_time - start_time),
                ("render", rendered_time - parsed_time),
                ("encode", encoded_time - rendered_time),
            ),
            end_time=encoded_time,
            generator=scene.generator,
            element_count=scene.element_count,
            warnings=warnings,
        )

    def _flat_backdrop(self) -> DrawList:
        """Return the draw list of the backdrop, which is flattened again only if it has changed."""
        assert self._backdrop is not None
        root = self._backdrop()
        cached = self._last_backdrop
        if cached is None or cached[0] is not root:
            cached = self._last_backdrop = root, flatten(root)
        return cached[1]

    def _encode(self, frame: Frame, request: RenderRequest, look: Look) -> tuple[bytes, str]:
        if request.image_type == "color":
            assert frame.color is not None
            if self._config.style.applies_fxaa(look):
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


def posted_document(request: RenderRequest, scenes: SceneStore) -> HashedDocument:
    """Return the posted scene with what is known of it.

    Raises:
        RequestError: The hash differs from the one in the form.
    """
    document = scenes.look_up(request.scene)
    if request.claimed_sha256 not in (None, document.digest):
        raise RequestError(
            400,
            f"scene_sha256 does not match: the form says {request.claimed_sha256}, but the {len(request.scene)} bytes "
            f"of the scene that arrived have {document.digest}",
        )
    return document


def camera_of(request: RenderRequest, scene: PreparedScene) -> Camera:
    """Return the camera of a request.

    A scene without camera and geometry is seen from the origin along -Z: the pose of a glTF camera with the identity as
    transform.

    Raises:
        RequestError: There is geometry but no camera, or the node's transform is singular.
    """
    camera = scene.camera
    if camera is None and scene.has_geometry:
        raise RequestError(400, _NO_CAMERA)
    near = request.near
    if near == 0.0:  # the client formats small numbers as 0 (std::to_string); the scene's camera has all digits
        znear = camera.znear if camera is not None else 0.0
        near = znear if 0.0 < znear < request.far else request.far * _NEAR_FAR_RATIO
    return Camera(
        width=request.width,
        height=request.height,
        fx=request.focal_x,
        fy=request.focal_y,
        cx=request.center_x,
        cy=request.center_y,
        near=max(near, _MIN_NEAR),
        far=request.far,
        X_world_camera=OPENGL_FROM_OPTICAL if camera is None else rigid_pose(camera.X_world_camera, camera.name),
    )


def rigid_pose(X: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    """Return a rigid pose with the position and line of sight of a transform, since camera nodes may have a scale.

    As in VTK, the image's up direction is the part of the transform's up axis that is orthogonal to the line of sight.

    Args:
        X: (4, 4) float64, transform from the optical frame to the world.
        name: Name of the node, for messages.

    Raises:
        RequestError: The transform is singular, or too far from the origin.
    """
    *rows, last_row = X.tolist()
    x, y, z = rows[0][3], rows[1][3], rows[2][3]
    if not (abs(x) <= _MAX_COORDINATE and abs(y) <= _MAX_COORDINATE and abs(z) <= _MAX_COORDINATE):
        raise RequestError(400, f"scene: the camera node {name!r} is farther than {_MAX_COORDINATE:g} m away")
    if _is_rotation(rows) and math.isfinite(sum(last_row)):
        return X
    linear, position = X[:3, :3], X[:3, 3]
    if np.isfinite(X).all():
        with np.errstate(all="ignore"):
            forward = linear[:, 2] / np.linalg.norm(linear[:, 2])
            down = linear[:, 1] / np.linalg.norm(linear[:, 1])
            down -= forward * (forward @ down)
            length = np.linalg.norm(down)
            if length > _MIN_ANGLE:
                down /= length
                pose = np.eye(4)
                pose[:3] = np.column_stack((np.cross(down, forward), down, forward, position))
                if np.linalg.det(pose[:3, :3]) > 0.5:  # 0 or NaN where a length overflowed
                    return pose
    raise RequestError(400, f"scene: the transform of the camera node {name!r} is singular")


def _is_rotation(rows: Sequence[Sequence[float]]) -> bool:
    """Return True if the first three columns of three rows are a rotation matrix. NumPy would take twice as long."""
    (a, b, c, _), (d, e, f, _), (g, h, i, _) = rows
    deviations = (
        *(a * a + d * d + g * g - 1.0, b * b + e * e + h * h - 1.0, c * c + f * f + i * i - 1.0),
        *(a * b + d * e + g * h, b * c + e * f + h * i, c * a + f * d + i * g),
    )
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    # The determinant is NaN if a value is; the comparison is false then.
    return max(map(abs, deviations)) < _RIGID_TOLERANCE and determinant > 0.0
