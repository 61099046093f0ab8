"""BOP: the format of the benchmark for 6D object pose estimation, as the public BOP toolkit reads and computes it.

A scene of the dataset is a scene of BOP in ``train_pbr``. An object of BOP is a model with a scale. Lengths are in
millimetres. ``cam_K`` counts pixels as OpenCV does: the centre of the top left pixel is (0, 0), ours is (0.5, 0.5).
"""

import json
import math
from collections.abc import Iterator, Mapping
from itertools import groupby
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenegate.datasets.dataset import NO_BOX, PIXEL_CENTER, Dataset, Sample
from scenegate.datasets.manifest import CameraRecord, ModelRecord, ObjectRecord, RecordError, path_inside
from scenegate.datasets.ply import encode_ply, read_ply
from scenegate.png import encode_png

SPLIT: Final = "train_pbr"
"""Folder of the scenes, by BOP's name for rendered training images."""
MILLIMETRES: Final = 1000.0
FINE_DEPTH, COARSE_DEPTH = 0.1, 1.0
"""Millimetres of one unit of depth images. The fine one is used if its numbers reach all far planes."""
MAX_DEPTH_UNITS: Final = 65535
SCALE_DIGITS: Final = 6
"""Objects of one model whose scales agree in this many decimals are one object of BOP."""
BLOCK_PAIRS: Final = 1 << 20
"""Number of pairs of points whose distances are computed at a time, in about 50 MB."""


class ModelKey(NamedTuple):
    """A model of the dataset with a scale: an object of BOP."""

    name: str
    path: str
    """``ModelRecord.path``."""
    scale: tuple[float, float, float]
    """``ObjectRecord.scale``, rounded."""


def _model_key(record: ObjectRecord, models: Mapping[str, ModelRecord]) -> ModelKey:
    """Return the model of an object. Raises RecordError if the scene has no such model."""
    if record.model not in models:
        raise RecordError(f"scene.json has no model {record.model!r}, which instance {record.instance} has")
    x, y, z = (round(value, SCALE_DIGITS) for value in record.scale)
    return ModelKey(record.model, models[record.model].path, (x, y, z))


def write(dataset: Dataset, folder: Path, samples: Iterator[Sample]) -> None:
    """Write the samples of a dataset into a folder."""
    object_ids, depth_scale = _plan(dataset)
    _write_models(dataset.folder, folder / "models", object_ids)
    scene_names: dict[str, str] = {}
    last_camera: CameraRecord | None = None
    for scene_number, (scene, views) in enumerate(groupby(samples, key=lambda sample: sample.record.scene)):
        scene_names[f"{scene_number:06d}"] = scene
        models = dataset.scene(scene).models
        last_camera = _write_scene(folder / SPLIT / f"{scene_number:06d}", views, models, object_ids, depth_scale)
    objects = {str(object_id): {"model": key.name, "scale": key.scale} for key, object_id in object_ids.items()}
    _write_json(folder / "dataset_info.json", {"scenes": scene_names, "objects": objects})
    if last_camera is not None:  # BOP has one camera for all images
        _write_json(folder / "camera.json", {**_intrinsics(last_camera), "depth_scale": depth_scale})


def _plan(dataset: Dataset) -> tuple[dict[ModelKey, int], float]:
    """Return BOP's numbers of the models of a dataset, from 1, and the unit of depth images in millimetres."""
    keys: set[ModelKey] = set()
    far = 0.0
    for scene, views in groupby(dataset, key=lambda sample: sample.record.scene):
        models = dataset.scene(scene).models
        for sample in views:
            camera = sample.record.camera
            far = max(far, math.inf if camera.far is None else camera.far)
            keys.update(_model_key(record, models) for record in sample.objects)
    object_ids = {key: object_id for object_id, key in enumerate(sorted(keys), 1)}
    fits_fine_depth = far * MILLIMETRES <= MAX_DEPTH_UNITS * FINE_DEPTH
    return object_ids, FINE_DEPTH if fits_fine_depth else COARSE_DEPTH


def _write_scene(
    folder: Path,
    views: Iterator[Sample],
    models: Mapping[str, ModelRecord],
    object_ids: Mapping[ModelKey, int],
    depth_scale: float,
) -> CameraRecord:
    """Write the images and annotations of a scene; return its last camera."""
    for name in ("rgb", "depth", "mask", "mask_visib"):
        (folder / name).mkdir(parents=True)
    cameras: dict[str, Any] = {}
    poses: dict[str, Any] = {}
    infos: dict[str, Any] = {}
    for image_number, sample in enumerate(views):
        key, file_name = str(image_number), f"{image_number:06d}"
        suffix = sample.path("color").suffix
        (folder / "rgb" / f"{file_name}{suffix}").write_bytes(sample.file_bytes("color"))
        depth_units = _depth_units(sample, depth_scale)
        (folder / "depth" / f"{file_name}.png").write_bytes(encode_png(depth_units))
        camera = sample.record.camera
        cameras[key] = _camera_entry(camera, depth_scale)
        poses[key] = [_pose_entry(record, object_ids[_model_key(record, models)]) for record in sample.objects]
        infos[key] = []
        instance_image = sample.instance
        for object_index, record in enumerate(sample.objects):
            amodal_mask = sample.amodal_mask(record.instance)
            visible_mask = instance_image == record.instance
            for mask_folder, mask in (("mask", amodal_mask), ("mask_visib", visible_mask)):
                path = folder / mask_folder / f"{file_name}_{object_index:06d}.png"
                path.write_bytes(encode_png(np.where(mask, np.uint8(255), np.uint8(0))))
            infos[key].append(_info_entry(record, int(np.count_nonzero(depth_units[amodal_mask]))))
    for name, content in (("scene_camera", cameras), ("scene_gt", poses), ("scene_gt_info", infos)):
        _write_json(folder / f"{name}.json", content)
    return camera


def _depth_units(sample: Sample, scale: float) -> NDArray[np.uint16]:
    """Return the depth image in units of ``scale`` millimetres from the camera; 0: background, or too far."""
    units = np.rint((sample.depth + sample.record.camera.depth_origin) * (MILLIMETRES / scale))
    return np.where(units <= MAX_DEPTH_UNITS, units, 0.0).astype(np.uint16)


def _intrinsics(camera: CameraRecord) -> dict[str, float]:
    """Return the content of ``camera.json`` for a camera, without the depth scale."""
    return {
        "cx": camera.cx - PIXEL_CENTER,
        "cy": camera.cy - PIXEL_CENTER,
        "fx": camera.fx,
        "fy": camera.fy,
        "height": camera.height,
        "width": camera.width,
    }


def _camera_entry(camera: CameraRecord, depth_scale: float) -> dict[str, Any]:
    """Return an image's entry in ``scene_camera.json``."""
    intrinsics = _intrinsics(camera)
    X = np.array(camera.X_world_camera)
    R = X[:3, :3].T
    return {
        "cam_K": [intrinsics["fx"], 0.0, intrinsics["cx"], 0.0, intrinsics["fy"], intrinsics["cy"], 0.0, 0.0, 1.0],
        "cam_R_w2c": R.ravel().tolist(),
        "cam_t_w2c": (-R @ X[:3, 3] * MILLIMETRES).tolist(),
        "depth_scale": depth_scale,
    }


def _pose_entry(record: ObjectRecord, object_id: int) -> dict[str, Any]:
    """Return an object's entry in ``scene_gt.json``."""
    X = np.array(record.X_camera_object)
    return {
        "cam_R_m2c": X[:3, :3].ravel().tolist(),
        "cam_t_m2c": (X[:3, 3] * MILLIMETRES).tolist(),
        "obj_id": object_id,
    }


def _info_entry(record: ObjectRecord, pixels_with_depth: int) -> dict[str, Any]:
    """Return an object's entry in ``scene_gt_info.json``."""
    return {
        "bbox_obj": _box(record.box_amodal if record.visible_pixels else None),  # the toolkit's of hidden ones is none
        "bbox_visib": _box(record.box_visible),
        "px_count_all": record.amodal_pixels,
        "px_count_valid": pixels_with_depth,
        "px_count_visib": record.visible_pixels,
        "visib_fract": record.visible_fraction,
    }


def _box(box: tuple[int, int, int, int] | None) -> tuple[int, int, int, int]:
    """Return a box as the BOP toolkit computes it: its width is the last column minus the first."""
    return NO_BOX if box is None else (box[0], box[1], box[2] - 1, box[3] - 1)


def _write_json(path: Path, content: dict[str, Any]) -> None:
    """Write a file with a line for each key."""
    lines = (f"{json.dumps(key)}: {json.dumps(value)}" for key, value in content.items())
    path.write_text("{\n" + ",\n".join(lines) + "\n}\n", "utf-8")


def diameter(points: NDArray[np.float64]) -> float:
    """Return the largest distance between two points, (N, 3).

    1. Walking from a point to the one farthest from it, a few times, finds a large distance d.
    2. With R the largest distance from the centre, both ends of a longer distance are at least d - R from it: only such
       points remain.
    3. All pairs of these are compared, in blocks.
    """
    center = (points.min(axis=0) + points.max(axis=0)) / 2.0
    radii = np.linalg.norm(points - center, axis=1)
    end = points[radii.argmax()]
    for _ in range(3):
        distances = np.linalg.norm(points - end, axis=1)
        end = points[distances.argmax()]
    largest = float(distances.max())
    points = np.unique(points[radii >= largest - radii.max()], axis=0)
    block_points = max(1, BLOCK_PAIRS // len(points))
    for begin in range(0, len(points), block_points):
        block = points[begin : begin + block_points]
        squared = ((block[:, None] - points[None, begin:]) ** 2).sum(axis=-1)
        largest = max(largest, float(np.sqrt(squared.max())))
    return largest


def _write_models(dataset_folder: Path, folder: Path, object_ids: Mapping[ModelKey, int]) -> None:
    """Write the models of a dataset into a folder. Raises RecordError for an unreadable one, or without a vertex."""
    folder.mkdir()
    infos: dict[str, dict[str, float]] = {}
    for key, object_id in object_ids.items():
        metres, triangles = read_ply(path_inside(dataset_folder, key.path))
        stored_points = (metres * np.array(key.scale) * MILLIMETRES).astype(np.float32)
        points = stored_points.astype(np.float64)
        if np.prod(key.scale) < 0.0:  # a mirrored model: its triangles face outwards again
            triangles = triangles[:, ::-1]
        (folder / f"obj_{object_id:06d}.ply").write_bytes(
            encode_ply(points, triangles, "millimetres", _normals(points, triangles))
        )
        finite = points[np.isfinite(points).all(axis=1)]
        if not len(finite):
            raise RecordError(f"{key.path}: it has no finite vertex")
        low, high = finite.min(axis=0), finite.max(axis=0)
        infos[str(object_id)] = {
            "diameter": diameter(finite),
            **{f"min_{axis}": float(value) for axis, value in zip("xyz", low, strict=True)},
            **{f"size_{axis}": float(value) for axis, value in zip("xyz", high - low, strict=True)},
        }
    (folder / "models_info.json").write_text(json.dumps(infos, indent=1) + "\n", "utf-8")


def _normals(points: NDArray[np.float64], triangles: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return unit normals of vertices, (N, 3): the means of the triangles' by their areas."""
    corners = points[triangles]
    area_vectors = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(points)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], area_vectors)
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30))
