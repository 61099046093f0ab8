"""Render loaded scenes and recorded requests to encoded images, also ``albedo``, ``stereo`` and ``flow``."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, reduce
from operator import or_
from pathlib import Path
from typing import TYPE_CHECKING, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.adapters.render.config import RenderConfig
from gateway.adapters.render.pipeline import Pipeline, camera_of, posted_document
from gateway.adapters.render.request import RenderRequest
from gateway.datasets.annotated_scene import AnnotatedScene
from gateway.datasets.annotations import ANNOTATION_OUTPUTS, annotate
from gateway.datasets.scenes import LoadedScene
from gateway.scene.draw.bounds import MIN_SUSPECT, corners_of, loose_bounds, scale_hint
from gateway.scene.draw.style import STUDIO_SAMPLES, Style
from renderers.camera import Camera
from renderers.depth_range import depth_in_millimetres
from renderers.drawlist import AlphaMode, DrawList, Material, Topology
from renderers.encode import jpeg_rgb, png_gray16, png_label, png_rgb, tiff_float32
from renderers.fxaa import fxaa
from renderers.interface import VTK_LOOKS, Frame, Look, Output, Renderer
from renderers.light_rig import STUDIO, Rig
from scenegate.datasets.dataset import FLOW_MAGIC, UNKNOWN_FLOW
from scenegate.datasets.manifest import ImageType, ObjectRecord, Settings

if TYPE_CHECKING:
    from gateway.adapters.stereo.device.profile import DepthMode, Profile

OUTPUTS: Final[dict[ImageType, Output]] = {
    "color": Output.COLOR,
    "depth": Output.DEPTH,
    "label": Output.LABEL,
    "normal": Output.NORMAL,
}
"""The renderer's output for each type of image that is one."""
SINGLE_IMAGE_TYPES: Final[tuple[ImageType, ...]] = (*OUTPUTS, "albedo")
"""Types of images that need neither objects nor a second camera. Each can be rendered without a dataset."""
IMAGE_FORMATS: Final[dict[ImageType, tuple[str, ...]]] = {
    "color": ("png", "jpg", "jpeg"),
    "depth": ("tiff", "tif", "png"),
    "label": ("png",),
    "instance": ("png",),
    "class": ("png",),
    "normal": ("png",),
    "albedo": ("png",),
    "amodal": ("json",),
    "flow": ("flo",),
    "stereo": ("png",),
    "measured": ("png",),
}
"""Suffixes of the file formats of each type of image. The first is the default."""

_NEAR_SHARE: Final = 0.03
"""Share of a scene's length within which a camera inside of it usually sees something, such as the ground."""


def style_of(settings: Settings) -> Style:
    """Return the style that a dataset's settings describe. Raises RigFileError if the rig file is invalid."""
    return Style(
        settings.look,  # type: ignore[arg-type]  # checked by the command
        settings.background,
        settings.antialias,  # type: ignore[arg-type]  # as the look
        settings.samples,  # type: ignore[arg-type]  # as the look
        STUDIO if settings.rig is None else _rig(settings.rig),
        settings.alpha_threshold,
    )


def _rig(path: str) -> Rig:
    from gateway.files.assets.light_rig_file import cached_rig

    return cached_rig(Path(path))


def rig_warning(scene: LoadedScene, settings: Settings) -> str | None:
    """Return a warning if a scene does not use the lights of ``--rig``, or is black as neither of them has one.

    None without ``--rig``, or if ``--look`` excludes them for all scenes. Raises RigFileError if the file is invalid.
    """
    if settings.rig is None or "color" not in settings.types or settings.look not in ("auto", "studio"):
        return None
    if settings.look == "auto" and (scene.request is not None or scene.look != "studio"):
        return "drawn as Drake shows it, without --rig; --look studio takes it"
    rig = _rig(settings.rig)
    if scene.draw_list.lights and rig.lights and rig.scene_lights:
        return "its own lights replace those of --rig; scene_lights = false in the rig's file keeps them"
    if rig.is_dark and not (scene.draw_list.lights and rig.scene_lights):
        return "drawn black: the rig has neither [[lights]] nor [surroundings] (--rig)"
    return None


def view_hint(renderer: Renderer, scene: LoadedScene, camera: Camera) -> str | None:
    """Return a hint if a camera sees nothing of a scene, or only the inside of what may be in millimetres, or None."""
    bounds = loose_bounds(scene.draw_list)
    if bounds is None:
        return None
    X = camera.X_camera_world
    x, y, z = (corners_of(bounds) @ X[:3, :3].T + X[:3, 3]).T
    u, v = camera.fx * x + camera.cx * z, camera.fy * y + camera.cy * z
    if (
        (z > camera.near) & (z < camera.far) & (u > 0.0) & (u < camera.width * z) & (v > 0.0) & (v < camera.height * z)
    ).all():
        return None
    depth = renderer.render(scene.draw_list, camera, Output.DEPTH, BASE_COLOR_LOOK).depth
    assert depth is not None
    nearest, span = float(depth.min()), float((bounds[1] - bounds[0]).max())
    if not np.isfinite(nearest):
        return f"nothing in view; {scale_hint(bounds)}"
    eye = camera.X_world_camera[:3, 3]
    is_inside = bool(((bounds[0] < eye) & (eye < bounds[1])).all())
    if is_inside and span >= MIN_SUSPECT and nearest > _NEAR_SHARE * span:
        return f"nothing near the camera, which is inside of something; {scale_hint(bounds)}"
    return None


@dataclass(frozen=True, slots=True, eq=False)
class SampleInputs:
    """Inputs of a sample: scene, cameras and sensor."""

    scene: LoadedScene
    camera: Camera
    annotated: AnnotatedScene | None = None
    """Objects of the scene; None: samples are not annotated."""
    next_camera: Camera | None = None
    """Camera of the next view, for ``flow``; None: there is none."""
    next_scene: LoadedScene | None = None
    """Scene of the next view, if its objects have moved."""
    baseline: float = 0.0
    """Distance of the right camera in metres, for ``stereo``."""
    profile: Profile | None = None
    """Profile of the camera that measures depth, for ``measured``."""
    depth_mode: DepthMode | None = None
    """Source of its depth; None: the profile's."""
    noise_seed: int = 0
    """Seed of that camera's noise."""


def render_images(
    renderer: Renderer, scene: LoadedScene, camera: Camera, formats: Mapping[ImageType, str], style: Style
) -> dict[ImageType, bytes]:
    """Render images of a scene that need neither objects nor a second camera; as ``render_sample``."""
    return render_sample(renderer, SampleInputs(scene, camera), formats, style)[0]


def render_sample(
    renderer: Renderer, inputs: SampleInputs, formats: Mapping[ImageType, str], style: Style
) -> tuple[dict[ImageType, bytes], tuple[ObjectRecord, ...]]:
    """Render the images of a sample; return them encoded, by type, and the annotated objects.

    One call of the renderer makes all but ``albedo``, ``stereo`` and ``measured``. Objects that others may hide take
    one more each. There is no ``flow`` without a next camera. ``formats`` has one of ``IMAGE_FORMATS`` by type. Raises
    ImageError, or ValueError if the image is too large.
    """
    scene, camera = inputs.scene, inputs.camera
    look = style.look_for(scene.look)
    if scene.scenario is not None:
        look = scene.scenario.scenery.look(look)
    outputs = reduce(or_, (OUTPUTS.get(image_type, Output(0)) for image_type in formats))
    if inputs.annotated is not None:
        outputs |= ANNOTATION_OUTPUTS
    if "flow" in formats:
        outputs |= Output.DEPTH if inputs.next_scene is None else Output.DEPTH | Output.INSTANCE
    frame = renderer.render(scene.draw_list, camera, outputs, look) if outputs else Frame()
    _finish(frame, scene, camera, renderer, look, style)
    images = {name: _encode(frame, name, file_format) for name, file_format in formats.items() if name in OUTPUTS}
    if "albedo" in formats:
        albedo = renderer.render(unlit(scene.draw_list, look), camera, Output.COLOR, BASE_COLOR_LOOK)
        images["albedo"] = _encode(albedo, "color", formats["albedo"])
    if "stereo" in formats:
        right_view = right_camera(camera, inputs.baseline)
        right = renderer.render(scene.draw_list, right_view, Output.COLOR, look)
        _finish(right, scene, right_view, renderer, look, style)
        images["stereo"] = _encode(right, "color", formats["stereo"])
    if "measured" in formats and inputs.profile is not None:
        from gateway.datasets.measured_depth import measured_depth

        depth_mode = inputs.depth_mode or inputs.profile.depth.mode
        measured = measured_depth(
            renderer, inputs.profile, depth_mode, scene.draw_list, camera, look, inputs.noise_seed
        )
        images["measured"] = png_gray16(measured)
    if "flow" in formats and inputs.next_camera is not None:
        images["flow"] = _flow(frame, inputs, inputs.next_camera)
    if inputs.annotated is None:
        return images, ()
    found = annotate(renderer, inputs.annotated, camera, frame, look, with_masks="amodal" in formats)
    if "instance" in formats:
        images["instance"] = png_gray16(found.instance)
    if "class" in formats:
        images["class"] = png_gray16(inputs.annotated.class_of[found.instance])
    if "amodal" in formats:
        images["amodal"] = msgspec.json.encode(found.silhouettes)
    return images, found.objects


def _flow(frame: Frame, inputs: SampleInputs, next_camera: Camera) -> bytes:
    """Return the flow file of a frame, which has depth and, if objects move, instances."""
    assert frame.depth is not None
    X_next_camera = None
    if inputs.next_scene is not None and frame.instance is not None:
        motions = instance_motions(inputs.scene.draw_list, inputs.camera, inputs.next_scene.draw_list, next_camera)
        X_next_camera = motions[frame.instance]
    return flow_file(flow_between(frame.depth, inputs.camera, next_camera, X_next_camera))


def _finish(frame: Frame, scene: LoadedScene, camera: Camera, renderer: Renderer, look: Look, style: Style) -> None:
    """Smooth the colour image of a frame, and add the background and the sensor of a scenario's scene."""
    if frame.color is None:
        return
    # FXAA would blur points, which may be one pixel wide.
    has_points = any(instance.mesh.topology is Topology.POINTS for instance in scene.draw_list.instances)
    if style.applies_fxaa(look) and not has_points:
        fxaa(frame.color)
    if scene.scenario is not None:
        frame.color = scene.scenario.scenery.finish(frame.color, scene.draw_list, camera, renderer, look)


def _encode(frame: Frame, image_type: ImageType, file_format: str) -> bytes:
    """Encode an image of a frame, one of ``OUTPUTS``, in one of ``IMAGE_FORMATS``."""
    if image_type == "color":
        assert frame.color is not None
        return png_rgb(frame.color) if file_format == "png" else jpeg_rgb(frame.color)
    if image_type == "label":
        assert frame.label is not None
        return png_label(frame.label)
    if image_type == "normal":
        assert frame.normal is not None
        return png_rgb((np.rint(frame.normal * np.float32(127.0)) + np.float32(128.0)).astype(np.uint8))
    assert frame.depth is not None
    return png_gray16(depth_in_millimetres(frame.depth)) if file_format == "png" else tiff_float32(frame.depth)


def render_request(renderer: Renderer, request: RenderRequest, settings: Settings) -> tuple[Camera, ImageType, bytes]:
    """Render a request as the endpoint does; return camera, type and encoded image. Raises RequestError."""
    style = style_of(settings)
    samples = style.samples or (STUDIO_SAMPLES if style.look == "studio" else 1)  # whatever the requests choose
    config = RenderConfig(
        style=replace(style, samples=samples),
        depth_format="png" if settings.depth_format == "png" else "tiff",
        scene_cache_count=1,
    )
    pipeline = Pipeline(renderer, config)
    image = pipeline.render(request)
    camera = camera_of(request, pipeline.scenes.get(posted_document(request, pipeline.scenes)))
    return camera, request.image_type, image.body


BASE_COLOR_LOOK: Final = Look(
    "studio", (0, 0, 0), 1, Rig(surroundings=None, scene_lights=False, auto_exposure=False, tone="none", shadow_size=0)
)
"""Look that shows unlit materials as they are."""


@lru_cache(maxsize=2)
def unlit(draw_list: DrawList, look: Look) -> DrawList:
    """Return a draw list of unlit materials, with the cut-outs that the depth image has under a look."""
    materials = {id(each.material): each.material for each in draw_list.instances}
    unlit_materials = {key: _unlit_material(material, look) for key, material in materials.items()}
    instances = tuple(replace(each, material=unlit_materials[id(each.material)]) for each in draw_list.instances)
    return DrawList(instances, draw_list.images)


def _unlit_material(material: Material, look: Look) -> Material:
    """Return a material that shows the base colour on both sides."""
    mode, cutoff = material.alpha_mode, material.alpha_cutoff
    if look.name in VTK_LOOKS or (mode is AlphaMode.BLEND and look.alpha_threshold == 0.0):
        mode = AlphaMode.OPAQUE
    elif mode is AlphaMode.BLEND:
        mode, cutoff = AlphaMode.MASK, look.alpha_threshold
    return replace(material, unlit=True, alpha_mode=mode, alpha_cutoff=cutoff, double_sided=True)


def right_camera(camera: Camera, baseline: float) -> Camera:
    """Return the right camera of a rectified pair, given the left one and the distance in metres."""
    X_world_right = camera.X_world_camera.copy()
    X_world_right[:3, 3] += baseline * X_world_right[:3, 0]
    return replace(camera, X_world_camera=X_world_right)


def instance_motions(scene: DrawList, camera: Camera, next_scene: DrawList, next_camera: Camera) -> NDArray[np.float64]:
    """Return the transform of each instance from the frame of a camera to that of the next one, (I + 1, 4, 4).

    The scenes have the same instances. The last transform is for pixels without an instance. An instance that is flat,
    and has no inverse, counts as at rest.
    """
    motions = np.tile(np.eye(4), (len(scene.instances) + 1, 1, 1))
    for index, (now, then) in enumerate(zip(scene.instances, next_scene.instances, strict=True)):
        if now.X_world_mesh is not then.X_world_mesh and abs(np.linalg.det(now.X_world_mesh[:3, :3])) > 0.0:
            motions[index] = then.X_world_mesh @ np.linalg.inv(now.X_world_mesh)
    return np.asarray(next_camera.X_camera_world @ motions @ camera.X_world_camera)


def flow_between(
    depth: NDArray[np.float32], camera: Camera, next_camera: Camera, X_next_camera: NDArray[np.float64] | None = None
) -> NDArray[np.float32]:
    """Return the flow from one camera to the next, (H, W, 2): pixels to the right and down.

    Surfaces that the next camera does not see, because others hide them or they are outside of its image, have a flow,
    too. It is NaN for the background and for what is behind the next camera. ``depth`` is an image of ``camera``, (H,
    W), in metres. ``X_next_camera``, (H, W, 4, 4), leads from the frame of ``camera`` to that of ``next_camera`` for
    the surface in each pixel; None: the scene is at rest.
    """
    columns = np.arange(camera.width) + 0.5
    rows = np.arange(camera.height)[:, None] + 0.5
    X = next_camera.X_camera_world @ camera.X_world_camera if X_next_camera is None else X_next_camera
    z = depth.astype(np.float64) + camera.depth_origin
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        x, y = (columns - camera.cx) / camera.fx * z, (rows - camera.cy) / camera.fy * z
        next_x, next_y, next_z = (
            X[..., k, 0] * x + X[..., k, 1] * y + X[..., k, 2] * z + X[..., k, 3] for k in range(3)
        )
        next_z[~(next_z > 0.0)] = np.nan
        u = next_camera.fx * next_x / next_z + next_camera.cx - columns
        v = next_camera.fy * next_y / next_z + next_camera.cy - rows
    flow = np.stack((u, v), axis=-1)
    flow[~np.isfinite(flow).all(axis=-1)] = np.nan
    return flow.astype(np.float32)


def flow_file(flow: NDArray[np.float32]) -> bytes:
    """Return a flow file of the Middlebury benchmark (.flo). NaN becomes a number beyond ``UNKNOWN_FLOW``."""
    height, width = flow.shape[:2]
    values = np.nan_to_num(flow, nan=10.0 * UNKNOWN_FLOW)
    return struct.pack("<fii", FLOW_MAGIC, width, height) + values.astype("<f4").tobytes()
