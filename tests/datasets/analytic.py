"""A dataset of two boxes that are seen by ray casting in NumPy: annotations without the renderer."""

import hashlib
import io
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from scenegate.datasets import manifest
from scenegate.datasets.manifest import CameraRecord, ImageFile, ImageType, ObjectRecord, SampleRecord
from scenegate.png import encode_png
from tests.datasets.conftest import SETTINGS

WIDTH, HEIGHT, FOCAL = 64, 48, 60.0
TYPES: tuple[ImageType, ...] = ("color", "depth", "instance", "class", "amodal")
HALF = np.array((0.05, 0.04, 0.03))
"""Half the size of the model in metres; its frame is in a corner of it."""
CENTER = np.array((0.05, 0.04, 0.03))
BACKGROUND = 200
QUADS = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


@dataclass(frozen=True)
class Box:
    """A box of the model in the world."""

    X_world_object: NDArray[np.float64]
    scale: NDArray[np.float64] = field(default_factory=lambda: np.ones(3))
    class_id: int = 1


def pose(x: float, y: float, z: float, turn: float = 0.0) -> NDArray[np.float64]:
    """A translation in metres after a turn around z and x in radians."""
    c, s = np.cos(turn), np.sin(turn)
    X = np.eye(4)
    X[:3, :3] = np.array(((c, -s, 0), (s, c, 0), (0, 0, 1))) @ np.array(((1, 0, 0), (0, c, -s), (0, s, c)))
    X[:3, 3] = (x, y, z)
    return X


CAMERA = np.array(((1.0, 0, 0, 0), (0, -1.0, 0, 0), (0, 0, -1.0, 0.6), (0, 0, 0, 1)))
"""Looks down on the scene from 0.6 m."""
BOXES = (Box(pose(-0.02, -0.05, 0.0, 0.4)), Box(pose(0.03, -0.02, 0.1, -0.3), np.array((1.5, 1.0, 0.5)), 2))
"""The second one hides a part of the first."""
ASIDE = (Box(pose(0.27, 0.0, 0.0, 0.2)), Box(pose(-0.1, 0.0, -0.2, 0.1), class_id=2))
"""The first one is partly outside of the image."""


def write_dataset(folder: Path, scenes: dict[str, list[tuple[Box, ...]]] | None = None) -> Path:
    """Write a dataset with a sample for each set of boxes."""
    scenes = {"pile": [BOXES, ASIDE], "single": [BOXES[:1]]} if scenes is None else scenes
    model = _model(folder)
    description = manifest.DatasetRecord(
        generator="test",
        renderer="none",
        settings=msgspec.structs.replace(SETTINGS, types=TYPES, width=WIDTH, height=HEIGHT),
        conventions={},
        classes={"1": "brick", "2": "plate"},
    )
    lines = []
    for name, samples in scenes.items():
        scene = folder / "scenes" / name
        scene.mkdir(parents=True)
        record = manifest.SceneRecord(
            scene=name, sha256="0" * 64, sources=(), generator="", warnings=(), labels={}, models={"block": model}
        )
        (scene / "scene.json").write_bytes(manifest.encode_indented(record))
        lines += [manifest.encode(_sample(folder, name, f"view-{k}", boxes)) for k, boxes in enumerate(samples)]
    (folder / "manifest.jsonl").write_bytes(b"".join(line + b"\n" for line in lines))
    (folder / "dataset.json").write_bytes(manifest.encode_indented(description))
    return folder


def hit_depth(box: Box, x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.float64]:
    """Depth at which rays (x, y, 1) in the optical frame enter a box; inf where they miss it."""
    X = np.linalg.inv(box.X_world_object) @ CAMERA
    rays = np.stack((*np.broadcast_arrays(x, y), np.ones(np.broadcast(x, y).shape)), axis=-1) @ X[:3, :3].T
    center, half = CENTER * box.scale, HALF * box.scale
    with np.errstate(divide="ignore"):
        a, b = (center - half - X[:3, 3]) / rays, (center + half - X[:3, 3]) / rays
    enter, leave = np.minimum(a, b).max(axis=-1), np.maximum(a, b).min(axis=-1)
    return np.where((enter <= leave) & (enter > 0.0), enter, np.inf)


def _sample(folder: Path, scene: str, view: str, boxes: tuple[Box, ...]) -> SampleRecord:
    cx, cy = WIDTH / 2.0, HEIGHT / 2.0
    # A canvas of three times the size, as the BOP toolkit has it for silhouettes.
    columns, rows = np.arange(-WIDTH, 2 * WIDTH), np.arange(-HEIGHT, 2 * HEIGHT)
    x, y = (columns + 0.5 - cx) / FOCAL, (rows[:, None] + 0.5 - cy) / FOCAL
    inside = np.s_[HEIGHT : 2 * HEIGHT, WIDTH : 2 * WIDTH]
    all_depths = [hit_depth(box, x, y) for box in boxes]
    depths = np.array([*(depth[inside] for depth in all_depths), np.full((HEIGHT, WIDTH), np.inf)])  # the background
    depth = depths.min(axis=0)
    instance = np.where(np.isfinite(depth), depths.argmin(axis=0) + 1, 0).astype(np.uint16)
    class_ids = np.array([0, *(box.class_id for box in boxes)], np.uint16)[instance]
    color = np.full((HEIGHT, WIDTH, 3), BACKGROUND, np.uint8)
    color[instance > 0] = np.stack((instance * 60, class_ids * 90, instance * 0), axis=-1)[instance > 0]
    silhouettes = [
        manifest.Silhouette(instance=k, size=(HEIGHT, WIDTH), counts=_runs(np.isfinite(mask)))
        for k, mask in enumerate(depths[:-1], 1)
    ]
    files: dict[ImageType, tuple[str, bytes]] = {
        "color": ("png", encode_png(color)),
        "depth": ("tiff", _tiff(depth.astype(np.float32))),
        "instance": ("png", encode_png(instance)),
        "class": ("png", encode_png(class_ids)),
        "amodal": ("json", msgspec.json.encode(silhouettes)),
    }
    images: dict[ImageType, ImageFile] = {}
    for image_type, (suffix, data) in files.items():
        path = f"scenes/{scene}/{view}.{image_type}.{suffix}"
        (folder / path).write_bytes(data)
        images[image_type] = ImageFile(path, hashlib.sha256(data).hexdigest(), len(data))
    objects = tuple(_object(k, box, np.isfinite(all_depths[k - 1]), instance == k) for k, box in enumerate(boxes, 1))
    size: Any = {"width": WIDTH, "height": HEIGHT, "fx": FOCAL, "fy": FOCAL, "cx": cx, "cy": cy}
    camera = CameraRecord(**size, near=0.01, far=2.0, X_world_camera=_rows(CAMERA))
    names: Any = {"id": f"{scene}/{view}", "scene": scene, "view": view, "view_description": ""}
    return SampleRecord(**names, scene_sha256="0" * 64, camera=camera, images=images, objects=objects)


def _object(number: int, box: Box, silhouette: NDArray[np.bool_], visible: NDArray[np.bool_]) -> ObjectRecord:
    in_image = silhouette[HEIGHT : 2 * HEIGHT, WIDTH : 2 * WIDTH]
    low, high = (CENTER - HALF) * box.scale, (CENTER + HALF) * box.scale
    return ObjectRecord(
        instance=number,
        path=("boxes", number),
        model="block",
        class_id=box.class_id,
        X_world_object=_rows(box.X_world_object),
        X_camera_object=_rows(np.linalg.inv(CAMERA) @ box.X_world_object),
        scale=_triple(box.scale),
        box_3d=(_triple(low), _triple(high)),
        box_visible=_box(visible, 0, 0),
        box_amodal=_box(silhouette, -WIDTH, -HEIGHT),
        visible_pixels=int(visible.sum()),
        amodal_pixels=int(silhouette.sum()),
        visible_fraction=float(visible.sum() / silhouette.sum()),
        truncation=float(1.0 - in_image.sum() / silhouette.sum()),
    )


def _model(folder: Path) -> manifest.ModelRecord:
    corners = np.array([CENTER + HALF * signs for signs in product((-1, 1), repeat=3)], "<f4")
    triangles = [t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))]
    faces = np.array([(3, t) for t in triangles], [("n", "u1"), ("v", "<i4", 3)])
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment metres\n"
        "element vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    data = header.encode() + corners.tobytes() + faces.tobytes()
    (folder / "models").mkdir(parents=True)
    (folder / "models" / "block.ply").write_bytes(data)
    box = (_triple(CENTER - HALF), _triple(CENTER + HALF))
    return manifest.ModelRecord(path="models/block.ply", sha256=hashlib.sha256(data).hexdigest(), box=box)


def _runs(mask: NDArray[np.bool_]) -> tuple[int, ...]:
    """Runs of a mask down its columns, the first one outside."""
    flat = np.concatenate(([False], mask.T.ravel()))
    changes = np.flatnonzero(flat[1:] != flat[:-1])
    return tuple(np.diff([0, *changes, mask.size]).tolist())


def _box(mask: NDArray[np.bool_], left: int, top: int) -> tuple[int, int, int, int] | None:
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return None
    x, y, right, bottom = int(columns[0]), int(rows[0]), int(columns[-1]), int(rows[-1])
    return x + left, y + top, right - x + 1, bottom - y + 1


def _tiff(pixels: NDArray[np.float32]) -> bytes:
    data = io.BytesIO()
    Image.fromarray(pixels).save(data, "TIFF")
    return data.getvalue()


def _triple(values: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def _rows(X: NDArray[np.float64]) -> Any:
    return tuple(map(tuple, X.tolist()))
