"""``scenegate render`` with an image as output: one scene, one view, one type."""

from pathlib import Path

from gateway.datasets.rendering import (
    IMAGE_FORMATS,
    SINGLE_IMAGE_TYPES,
    render_images,
    rig_warning,
    style_of,
    view_hint,
)
from gateway.datasets.scene_sources import SourceKind, find_sources
from gateway.datasets.scenes import SceneError, load_options, load_scene
from gateway.datasets.views import View, camera_of
from renderers.raster import CpuRenderer
from renderers.stop import run_within
from scenegate.cli.output import print_note
from scenegate.datasets import manifest
from scenegate.datasets.manifest import Settings
from scenegate.regular_files import write_whole


def render_image(
    path: Path, out: Path, settings: Settings, views: tuple[View, ...], threads: int, timeout: float
) -> None:
    """Write one image in at most ``timeout`` seconds (0: no limit); a label image gets a ``.labels.json`` beside it.

    Raises ValueError for several views or a scene that cannot be rendered; OSError if the image cannot be written in
    time.
    """
    error = TimeoutError(f"{out}: it took longer than --timeout = {timeout:g} s")
    run_within(timeout, lambda: _render_image(path, out, settings, views, threads), error)


def _render_image(path: Path, out: Path, settings: Settings, views: tuple[View, ...], threads: int) -> None:
    if len(views) > 1:
        raise ValueError(f"{out} is one image: for more cameras name a folder with -o")
    (image_type,) = settings.types
    if image_type not in SINGLE_IMAGE_TYPES:
        raise ValueError(f"--type {image_type} is for datasets; name a folder with -o")
    suffix = out.suffix[1:].lower()
    if suffix not in IMAGE_FORMATS[image_type]:
        allowed = " or ".join(f".{name}" for name in IMAGE_FORMATS[image_type])
        raise ValueError(f"{out}: a {image_type} image is written as {allowed}")
    source = find_sources([path], range(1) if path.suffix.lower() == ".toml" else None)[0]
    if source.kind is SourceKind.REQUEST:
        raise ValueError(f"{path}: a recorded request contains its own camera and type; name a folder with -o")
    try:
        scene = load_scene(source, load_options(settings))
    except SceneError as error:
        raise ValueError(f"{path}: {error}") from None
    view = views[0] if views else scene.first_view
    scene, view = scene.at_frame_of(view)
    camera = camera_of(
        view, scene.root, scene.draw_list, scene.file_camera, settings.width, settings.height, settings.fovy
    )
    renderer = CpuRenderer(threads)
    images = render_images(renderer, scene, camera, {image_type: suffix}, style_of(settings))
    out.parent.mkdir(parents=True, exist_ok=True)
    write_whole(out, images[image_type])
    if image_type == "label":
        write_whole(out.with_suffix(".labels.json"), manifest.encode_indented(scene.description.labels))
    for warning in (*scene.description.warnings, rig_warning(scene, settings), view_hint(renderer, scene, camera)):
        if warning is not None:
            print_note(f"{path}: {warning}")
