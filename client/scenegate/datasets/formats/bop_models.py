"""Models of BOP: a PLY file in millimetres for each model and scale of a dataset, and ``models_info.json``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenegate.datasets.manifest import ModelRecord, ObjectRecord, RecordError, path_inside
from scenegate.datasets.ply import encode_ply, read_ply

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


def model_key(record: ObjectRecord, models: Mapping[str, ModelRecord]) -> ModelKey:
    """Return the model of an object.

    Raises:
        RecordError: the scene has no such model.
    """
    if record.model not in models:
        raise RecordError(f"scene.json has no model {record.model!r}, which instance {record.instance} has")
    x, y, z = (round(value, SCALE_DIGITS) for value in record.scale)
    return ModelKey(record.model, models[record.model].path, (x, y, z))


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


def write_models(dataset_folder: Path, folder: Path, object_ids: Mapping[ModelKey, int]) -> None:
    """Write the models of a dataset into a folder.

    Raises:
        RecordError: a model cannot be read, has no finite vertex, or lies outside of the dataset.
    """
    folder.mkdir()
    infos: dict[str, dict[str, float]] = {}
    for key, object_id in object_ids.items():
        points, triangles = read_ply(path_inside(dataset_folder, key.path))
        points = (points * np.array(key.scale) * 1000.0).astype(np.float32).astype(np.float64)  # as the file has them
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
