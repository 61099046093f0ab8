"""Check a sample of a dataset: its record, its image files and the annotations of its objects, for ``check``."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.datasets.views import MAX_ROTATION_ERROR, REQUEST_VIEW_NAME, check_pose
from gateway.scene.draw.cameras import CameraError
from gateway.scene.tree.transforms import is_rotation
from renderers.stop import check_stop
from scenegate.datasets import NO_LABEL, Sample, manifest
from scenegate.datasets.boxes import box_of
from scenegate.datasets.dataset import label_numbers
from scenegate.datasets.manifest import (
    SCENE_FILE,
    CameraRecord,
    ImageFile,
    ImageType,
    ObjectRecord,
    RecordError,
    SampleRecord,
    SceneRecord,
    Silhouette,
)
from scenegate.regular_files import sha256_of

MAX_FOCAL_PIXELS: Final = 1e12
"""Maximum focal length. Those of orthographic cameras, which are far away, are large."""
MAX_POSE_ERROR: Final = 1e-6
"""Maximum difference between numbers of a pose and the product of the two others, relative to the distances."""
_PIXEL_FORMATS: Final[dict[ImageType, tuple[tuple[str, int], ...]]] = {
    "color": (("uint8", 3),),
    "depth": (("float32", 1), ("uint16", 1)),
    "label": (("uint8", 3),),
    "instance": (("uint16", 1),),
    "class": (("uint16", 1),),
    "normal": (("uint8", 3),),
    "albedo": (("uint8", 3),),
    "flow": (("float32", 2),),
    "stereo": (("uint8", 3),),
    "measured": (("uint16", 1),),
}
"""Allowed data types and numbers of channels of each type of image."""


def sample_problems(
    folder: Path, sample: SampleRecord, description: manifest.DatasetRecord, scene: SceneRecord | None
) -> Iterator[str]:
    """Yield the errors of a sample, its camera and its images."""
    if sample.id != f"{sample.scene}/{sample.view}":
        yield f"the id is not that of scene {sample.scene} and view {sample.view}"
    if scene is not None and sample.scene_sha256 != scene.sha256:
        yield "it was drawn of another state of the scene than its scene.json tells"
    yield from _camera_problems(sample.camera)
    is_request = sample.view == REQUEST_VIEW_NAME
    for image_type in description.settings.types:
        if image_type not in sample.images and not is_request and image_type != "flow":  # the last view has none
            yield f"the {image_type} image is missing in the manifest"
    reader = Sample(folder, sample)
    pixels: dict[ImageType, NDArray[Any]] = {}
    silhouettes: Mapping[int, Silhouette] | None = None
    for image_type, image in sample.images.items():
        try:
            _check_file(folder, image)
            if image_type == "amodal":
                silhouettes = reader.silhouettes
            else:
                pixels[image_type] = _checked_pixels(reader, image_type, scene)
        except RecordError as error:
            yield f"{image.path}: {str(error).removeprefix(f'{folder / image.path}: ')}"
    yield from _object_problems(sample, description.classes, scene, pixels, silhouettes)


def _camera_problems(camera: CameraRecord) -> Iterator[str]:
    if not all(0.0 < focal <= MAX_FOCAL_PIXELS for focal in (camera.fx, camera.fy)):
        yield f"camera: focal lengths ({camera.fx}, {camera.fy}) must be above 0, up to {MAX_FOCAL_PIXELS:.0e}"
    if not camera.near > 0.0 or (camera.far is not None and not camera.near < camera.far):
        yield f"camera: planes near={camera.near}, far={camera.far}"
    try:
        check_pose(camera.X_world_camera, 3 * MAX_ROTATION_ERROR)
    except CameraError as error:
        yield f"camera: {error}"


def _check_file(folder: Path, image: ImageFile) -> None:
    """Raise RecordError if an image file is not that of the manifest."""
    path = manifest.path_inside(folder, image.path)
    digest = sha256_of(path, check_stop)
    if digest is None:
        raise RecordError("missing, or not a regular file that can be read")
    if digest != image.sha256:
        size = path.stat().st_size
        raise RecordError(f"changed: its SHA-256 is not that of the manifest ({size} bytes, {image.bytes} there)")


def _checked_pixels(sample: Sample, image_type: ImageType, scene: SceneRecord | None) -> NDArray[Any]:
    """Return the pixels of an image as its file has them; raise RecordError for those that it cannot have."""
    pixels: NDArray[Any] = sample.flow if image_type == "flow" else sample.stored(image_type)
    data_type, channels = pixels.dtype.name, 1 if pixels.ndim == 2 else pixels.shape[2]
    if (data_type, channels) not in _PIXEL_FORMATS[image_type]:
        raise RecordError(f"a {image_type} image with {channels} channels of {data_type}")
    if image_type == "depth" and pixels.dtype == np.float32 and (np.isnan(pixels).any() or (pixels < 0.0).any()):
        raise RecordError("depth that is negative or not a number")
    if image_type == "label" and scene is not None and scene.labels:
        labels = np.unique(label_numbers(pixels)).tolist()
        unknown = [str(label) for label in labels if label != NO_LABEL and str(label) not in scene.labels]
        if unknown:
            raise RecordError(f"labels that {SCENE_FILE} does not know: {', '.join(unknown[:5])}")
    return pixels


def _object_problems(
    sample: SampleRecord,
    classes: Mapping[str, str],
    scene: SceneRecord | None,
    pixels: Mapping[ImageType, NDArray[Any]],
    silhouettes: Mapping[int, Silhouette] | None,
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
        yield from (f"object {each.instance}: {problem}" for problem in _pixel_problems(each, ids, silhouettes))
        class_of[each.instance & 0xFFFF] = each.class_id & 0xFFFF
    if "class" in pixels and (pixels["class"] != class_of[ids]).any():
        yield "the class image does not follow from the instance image"


def _record_problems(
    each: ObjectRecord, sample: SampleRecord, classes: Mapping[str, str], scene: SceneRecord | None
) -> Iterator[str]:
    """Yield the errors of an object's record, without its pixels."""
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


def _pixel_problems(
    each: ObjectRecord, ids: NDArray[Any], silhouettes: Mapping[int, Silhouette] | None
) -> Iterator[str]:
    """Yield the differences between an object and the images of its pixels."""
    visible = ids == each.instance
    if np.count_nonzero(visible) != each.visible_pixels:
        yield f"visible_pixels = {each.visible_pixels}, the instance image has {np.count_nonzero(visible)}"
    if box_of(visible) != each.box_visible:
        yield f"box_visible is {each.box_visible}, that of the instance image is {box_of(visible)}"
    if silhouettes is None:
        return
    if each.instance not in silhouettes:
        yield "it has no silhouette"
        return
    silhouette = silhouettes[each.instance].mask
    if (visible & ~silhouette).any():
        yield "visible pixels are outside of its silhouette"
    inside = (1.0 - each.truncation) * each.amodal_pixels
    if abs(np.count_nonzero(silhouette) - inside) > 0.5:
        yield f"{inside:.0f} pixels of its silhouette are in the image, {np.count_nonzero(silhouette)} in the file"
