"""A scene file to one picture file."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from gateway.render.depth import millimetres
from gateway.render.labels import labels_of
from gateway.scene.cameras import DEFAULT_FOVY, CameraError, parse_camera, resolve_camera
from gateway.scene.flatten import flatten
from gateway.scene.labels import LabelTable
from gateway.scene.scenefile import SceneFile, Up, read_scene_file
from renderers.camera import Camera
from renderers.drawlist import DrawList
from renderers.encode import jpeg_rgb, png_gray16, png_label, png_rgb, tiff_float32
from renderers.port import Frame, Look, LookName, Output, Renderer

ImageType = Literal["color", "depth", "label"]
OUTPUTS: Final[dict[ImageType, Output]] = {"color": Output.COLOR, "depth": Output.DEPTH, "label": Output.LABEL}
SUFFIXES: Final[dict[ImageType, tuple[str, ...]]] = {
    "color": (".png", ".jpg", ".jpeg"),
    "depth": (".tiff", ".tif", ".png"),
    "label": (".png",),
}
"""By type of picture, the first is the default."""


class PictureError(ValueError):
    """A picture cannot be made; the message says of what and why."""


@dataclass(frozen=True, slots=True)
class Wish:
    """How all pictures of one command are made."""

    image_type: ImageType
    width: int
    height: int
    camera: str | None = None
    """The camera grammar; None: the file's own first camera, or ``fit`` when it has none."""
    look: Literal["auto", "phong", "pbr", "plain"] = "auto"
    up: Up = "auto"
    background: tuple[int, int, int] = Look().background


def write_picture(renderer: Renderer, source: Path, target: Path, wish: Wish) -> tuple[str, ...]:
    """Draws ``source`` into ``target``; a label picture gets a ``.labels.json`` beside it.

    Returns:
        What was ignored or repaired in the file.

    Raises:
        SceneFileError, CameraError, PictureError, ImageError, OSError: with a sentence.
    """
    if target.suffix.lower() not in SUFFIXES[wish.image_type]:
        suffixes = " or ".join(SUFFIXES[wish.image_type])
        raise PictureError(f"{target}: a {wish.image_type} picture is written as {suffixes}")
    scene = read_scene_file(source, up=wish.up)
    labels = LabelTable()
    if scene.from_drake:  # its client sends labels as colours
        drawn = flatten(scene.root, label_of=labels_of(scene.root))
    else:
        drawn = flatten(scene.root, label_of=lambda path, _: labels.label_of(path))
    camera = _camera(scene, wish, drawn)
    look: LookName = wish.look if wish.look != "auto" else "phong" if scene.generator == "VTK" else "pbr"
    with renderer.render(drawn, camera, OUTPUTS[wish.image_type], Look(look, wish.background)) as frame:
        data = _encoded(frame, target.suffix.lower())
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(data)
    if wish.image_type == "label" and not scene.from_drake:
        names = {str(label): list(path) for label, path in labels.known().items()}
        target.with_suffix(".labels.json").write_text(json.dumps(names, indent=1) + "\n", "utf-8")
    return scene.warnings


def _camera(scene: SceneFile, wish: Wish, drawn: DrawList) -> Camera:
    if wish.camera is not None or not scene.cameras:
        spec = parse_camera(wish.camera or "fit")
        return resolve_camera(spec, scene.root, wish.width, wish.height, drawn=drawn)
    own = scene.cameras[0]
    focal = 0.5 * wish.height / math.tan(0.5 * (own.yfov or math.radians(DEFAULT_FOVY)))
    far = own.zfar if own.zfar is not None else math.inf
    centre = (0.5 * wish.width, 0.5 * wish.height)
    try:
        return Camera(wish.width, wish.height, focal, focal, *centre, own.znear, far, own.X_world_camera)
    except ValueError as error:
        raise CameraError(f"the file's camera {own.name!r}: {error}") from None


def _encoded(frame: Frame, suffix: str) -> bytes:
    if frame.color is not None:
        return png_rgb(frame.color) if suffix == ".png" else jpeg_rgb(frame.color)
    if frame.label is not None:
        return png_label(frame.label)
    assert frame.depth is not None
    return png_gray16(millimetres(frame.depth)) if suffix == ".png" else tiff_float32(frame.depth)
