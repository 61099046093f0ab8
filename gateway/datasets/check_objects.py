"""Check the annotations of a sample against its images, for ``check``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.scene.transforms import is_rotation
from scenegate.datasets.boxes import box_of
from scenegate.datasets.manifest import SCENE_FILE, ImageType, Masks, ObjectRecord, SampleRecord, SceneRecord

MAX_POSE_ERROR: Final = 1e-6
"""Maximum difference between numbers of a pose and the product of the two others, relative to the distances."""


def object_problems(
    sample: SampleRecord,
    classes: Mapping[str, str],
    scene: SceneRecord | None,
    pixels: Mapping[ImageType, NDArray[Any]],
    masks: Masks | None,
) -> Iterator[str]:
    """Yield the errors of the annotated objects of a sample, as far as its scene and its images can be read."""
    instances = [each.instance for each in sample.objects]
    if len(set(instances)) < len(instances) or 0 in instances:
        yield "objects: two have the same instance, or one has 0"
    for each in sample.objects:
        yield from (f"object {each.instance}: {problem}" for problem in _record_problems(each, sample, classes, scene))
    ids = pixels.get("instance")
    if ids is None:
        return
    if unknown := {*np.unique(ids).tolist()} - {0, *instances}:
        yield f"the instance image has values without an object: {', '.join(map(str, sorted(unknown)[:5]))}"
    class_of = np.zeros(1 << 16, np.uint16)
    for each in sample.objects:
        yield from (f"object {each.instance}: {problem}" for problem in _pixel_problems(each, ids, masks))
        class_of[each.instance & 0xFFFF] = each.class_id & 0xFFFF
    if "class" in pixels and (pixels["class"] != class_of[ids]).any():
        yield "the class image does not follow from the instance image"


def _record_problems(
    each: ObjectRecord, sample: SampleRecord, classes: Mapping[str, str], scene: SceneRecord | None
) -> Iterator[str]:
    """Yield what is wrong with an object without its pixels."""
    if str(each.class_id) not in classes:
        yield f"class_id = {each.class_id} is not one of the classes"
    model = None if scene is None else scene.models.get(each.model)
    if model is not None:
        with np.errstate(over="ignore"):
            expected_box = np.sort(np.array(model.box) * each.scale, axis=0)
        if not np.allclose(each.box_3d, expected_box, rtol=1e-6, atol=MAX_POSE_ERROR):
            yield "box_3d is not that of the model times scale"
    elif scene is not None:
        yield f"model {each.model!r} is not in {SCENE_FILE}"
    X_world_object, X_camera_object = np.array(each.X_world_object), np.array(each.X_camera_object)
    expected = np.array(sample.camera.X_world_camera) @ X_camera_object
    if not (np.abs(expected - X_world_object) <= MAX_POSE_ERROR * (1.0 + np.abs(expected).max())).all():
        yield "X_world_object is not X_world_camera X_camera_object"
    if not is_rotation(X_world_object[:3, :3], MAX_POSE_ERROR):
        yield "X_world_object is not a rotation and translation"
    if not (np.array(each.box_3d[0]) <= np.array(each.box_3d[1])).all() or 0.0 in each.scale:
        yield "box_3d or scale is empty"
    if each.box_amodal is not None:
        x, y, width, height = each.box_amodal
        camera = sample.camera
        is_across = -camera.width <= x < x + width <= 2 * camera.width
        if not is_across or not -camera.height <= y < y + height <= 2 * camera.height:
            yield f"box_amodal {each.box_amodal} is empty, or reaches beyond the image by more than its size"
    if not 0 <= each.visible_pixels <= each.amodal_pixels or not 0.0 <= each.truncation <= 1.0:
        yield "visible_pixels, amodal_pixels or truncation is out of range"
    elif each.visible_fraction != (each.visible_pixels / each.amodal_pixels if each.amodal_pixels else 0.0):
        yield "visible_fraction is not visible_pixels / amodal_pixels"


def _pixel_problems(each: ObjectRecord, ids: NDArray[Any], masks: Masks | None) -> Iterator[str]:
    """Yield the differences between an object and the images of its pixels."""
    visible = ids == each.instance
    if np.count_nonzero(visible) != each.visible_pixels:
        yield f"visible_pixels = {each.visible_pixels}, the instance image has {np.count_nonzero(visible)}"
    if box_of(visible) != each.box_visible:
        yield f"box_visible is {each.box_visible}, that of the instance image is {box_of(visible)}"
    if masks is None:
        return
    if str(each.instance) not in masks.counts:
        yield "it has no silhouette"
        return
    silhouette = masks.mask(str(each.instance))
    if (visible & ~silhouette).any():
        yield "visible pixels are outside of its silhouette"
    inside = (1.0 - each.truncation) * each.amodal_pixels
    if abs(np.count_nonzero(silhouette) - inside) > 0.5:
        yield f"{inside:.0f} pixels of its silhouette are in the image, {np.count_nonzero(silhouette)} in the file"
