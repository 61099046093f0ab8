"""Annotations of an image: visible and amodal pixels of each object. Amodal pixels are its silhouette, if drawn alone.

Silhouettes, boxes and visible fractions follow the BOP toolkit: each object is drawn alone on a canvas that is three
times as wide and high as the image, so that silhouettes of truncated objects are whole.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from gateway.datasets.annotated_scene import AnnotatedObject, AnnotatedScene
from renderers.camera import Camera
from renderers.interface import Frame, Look, Output, Renderer
from renderers.raster.layout import MAX_SIDE
from renderers.stop import check_stop
from scenegate.datasets.boxes import box_corners, box_of
from scenegate.datasets.manifest import ObjectRecord, Silhouette, pose_rows

T = TypeVar("T", bound=np.generic)

ANNOTATION_OUTPUTS: Final = Output.DEPTH | Output.INSTANCE
"""Images that annotations are made from."""
_DEPTH_TOLERANCE: Final = 1e-4
"""Relative error of depths, with a margin."""


@dataclass(frozen=True, slots=True)
class _Window:
    """A rectangle of pixels: columns left to right - 1, rows top to bottom - 1. It may reach beyond the image."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def is_empty(self) -> bool:
        return self.left >= self.right or self.top >= self.bottom

    def intersection(self, other: _Window) -> _Window:
        """Return the common pixels."""
        left, top = max(self.left, other.left), max(self.top, other.top)
        return _Window(left, top, min(self.right, other.right), min(self.bottom, other.bottom))

    def part_of(self, image: NDArray[T], origin: _Window) -> NDArray[T]:
        """Return this part of an image whose first pixel is that of ``origin``, as a view."""
        rows = slice(self.top - origin.top, self.bottom - origin.top)
        return image[rows, self.left - origin.left : self.right - origin.left]

    def box_of(self, mask: NDArray[np.bool_]) -> tuple[int, int, int, int] | None:
        """Return the box (x, y, width, height) of the pixels of a mask of this window; None if there are none."""
        box = box_of(mask)
        return None if box is None else (self.left + box[0], self.top + box[1], *box[2:])


@dataclass(frozen=True, slots=True, eq=False)
class Annotations:
    """Annotations of an image."""

    objects: tuple[ObjectRecord, ...]
    """Objects that are visible, or would be if nothing hid them."""
    instance: NDArray[np.uint16]
    """(H, W): ``ObjectRecord.instance`` in each pixel; 0: none."""
    silhouettes: tuple[Silhouette, ...]
    """Silhouettes of the objects, in the same order; empty without ``with_masks``."""


def annotate(
    renderer: Renderer, scene: AnnotatedScene, camera: Camera, frame: Frame, look: Look, *, with_masks: bool
) -> Annotations:
    """Annotate a frame with ``ANNOTATION_OUTPUTS``, rendered with this camera and look; silhouettes ``with_masks``."""
    assert frame.instance is not None
    assert frame.depth is not None
    instance = scene.instance_of[frame.instance]
    image = _Window(0, 0, camera.width, camera.height)
    records: list[ObjectRecord] = []
    silhouettes: list[Silhouette] = []
    X_camera_world = camera.X_camera_world
    for item in scene.objects:
        check_stop()
        X_camera_object = X_camera_world @ item.object_frame.X_world_object
        window, max_depth = _window_of(item, X_camera_object, camera)
        inside = window.intersection(image)
        if inside.is_empty:
            continue
        ids = inside.part_of(instance, image)
        visible = ids == item.instance
        nearer = (inside.part_of(frame.depth, image) <= max_depth) & ~visible
        if window == inside and visible.any() and not nearer.any():
            silhouette = visible  # nothing hides it
        else:
            silhouette = _draw_alone(renderer, item, camera, window, look)
            inside.part_of(silhouette, window)[visible] = True  # rounding may move an edge by a pixel
        in_image = inside.part_of(silhouette, window)
        if not in_image.any():
            continue
        visible_pixels, amodal_pixels = int(np.count_nonzero(visible)), int(np.count_nonzero(silhouette))
        low, high = map(tuple, item.box.tolist())
        records.append(
            ObjectRecord(
                instance=item.instance,
                path=item.path,
                model=item.model,
                class_id=item.class_id,
                X_world_object=pose_rows(item.object_frame.X_world_object),
                X_camera_object=pose_rows(X_camera_object),
                scale=item.object_frame.scale,
                box_3d=(low, high),
                box_visible=inside.box_of(visible),
                box_amodal=window.box_of(silhouette),
                visible_pixels=visible_pixels,
                amodal_pixels=amodal_pixels,
                visible_fraction=visible_pixels / amodal_pixels,
                truncation=1.0 - int(np.count_nonzero(in_image)) / amodal_pixels,
            )
        )
        if with_masks:
            counts = _run_lengths(in_image, inside, camera.height, camera.width)
            silhouettes.append(Silhouette(instance=item.instance, size=(camera.height, camera.width), counts=counts))
    return Annotations(tuple(records), instance, tuple(silhouettes))


def _window_of(item: AnnotatedObject, X_camera_object: NDArray[np.float64], camera: Camera) -> tuple[_Window, float]:
    """Return the window of the canvas that holds all pixels of an object, and an upper bound of its depth.

    The depth is in metres from ``camera.depth_origin``, as in depth images. An object out of the depth range has an
    empty window.
    """
    margin_x = min(camera.width, (MAX_SIDE - camera.width) // 2)
    margin_y = min(camera.height, (MAX_SIDE - camera.height) // 2)
    canvas = _Window(-margin_x, -margin_y, camera.width + margin_x, camera.height + margin_y)
    corners = box_corners(item.box) @ X_camera_object[:3, :3].T + X_camera_object[:3, 3]
    z = corners[:, 2]
    farthest = float(z.max())
    if farthest < camera.near or z.min() > camera.far:
        return _Window(0, 0, 0, 0), 0.0
    max_depth = farthest * (1.0 + _DEPTH_TOLERANCE) - camera.depth_origin
    if z.min() < camera.near or not np.isfinite(corners).all():
        return canvas, max_depth
    pixels = corners[:, :2] / z[:, None] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    first = np.floor(pixels.min(axis=0)) - item.margin
    last = np.ceil(pixels.max(axis=0)) + item.margin
    left, top, right, bottom = np.clip((*first, *last), -MAX_SIDE, 2 * MAX_SIDE).astype(int).tolist()
    return _Window(left, top, right, bottom).intersection(canvas), max_depth


def _draw_alone(
    renderer: Renderer, item: AnnotatedObject, camera: Camera, window: _Window, look: Look
) -> NDArray[np.bool_]:
    """Return the amodal mask of an object in a window: the pixels that it covers if drawn alone."""
    width, height = window.right - window.left, window.bottom - window.top
    window_camera = replace(camera, width=width, height=height, cx=camera.cx - window.left, cy=camera.cy - window.top)
    depth = renderer.render(item.draw_list, window_camera, Output.DEPTH, look).depth
    assert depth is not None
    return np.isfinite(depth)


def _run_lengths(mask: NDArray[np.bool_], window: _Window, height: int, width: int) -> tuple[int, ...]:
    """Return ``Silhouette.counts`` of a mask of a window of an image."""
    columns = np.zeros((window.right - window.left, height), np.bool_)
    columns[:, window.top : window.bottom] = mask.T
    changes = np.flatnonzero(np.diff(columns.ravel(), prepend=False, append=False)) + window.left * height
    last = width * height
    return tuple(np.diff(changes[changes < last], prepend=0, append=last).tolist())
