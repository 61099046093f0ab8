"""COCO: ``annotations.json`` and ``images/``; an annotation for each object with visible pixels.

Boxes and masks are those of the visible pixels, masks as RLE. The keypoints of an object are the origin of its frame
and the corners of its 3D box.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as coco_mask

from scenegate.datasets.boxes import CORNERS, EDGES, box_corners
from scenegate.datasets.dataset import PIXEL_CENTER, Dataset, Sample
from scenegate.datasets.manifest import ObjectRecord

KEYPOINTS: Final = ("origin", *(f"corner_{x}{y}{z}" for x, y, z in CORNERS))
"""Names of an object's keypoints."""
SKELETON: Final = tuple((2 + i, 2 + k) for i, k in EDGES)
"""Edges of the box: numbers of keypoints from 1."""
OUTSIDE, HIDDEN, VISIBLE = 0, 1, 2
"""COCO's flags of keypoints: not labelled, labelled and hidden, labelled and visible."""


def write(dataset: Dataset, folder: Path, samples: Iterator[Sample]) -> None:
    """Write the samples of a dataset into a folder."""
    categories = [
        {"id": int(class_id), "name": name, "supercategory": "", "keypoints": KEYPOINTS, "skeleton": SKELETON}
        for class_id, name in sorted(dataset.description.classes.items(), key=lambda item: int(item[0]))
    ]
    images: list[dict[str, Any]] = []
    encode = msgspec.json.encode
    (folder / "images").mkdir()
    annotation_id = 0
    with (folder / "annotations.json").open("wb") as file:
        # Annotations are most of the file; they are not kept in memory.
        file.write(
            b'{"info":' + encode({"description": dataset.description.generator}) + b',"licenses":[],"categories":'
        )
        file.write(encode(categories) + b',"annotations":[')
        for index, sample in enumerate(samples):
            name = f"{index:06d}{sample.path('color').suffix}"
            (folder / "images" / name).write_bytes(sample.file_bytes("color"))
            camera = sample.record.camera
            images.append({"id": index, "file_name": name, "width": camera.width, "height": camera.height})
            instances = sample.instance
            for record in sample.objects:
                if record.visible_pixels:
                    annotation_id += 1
                    annotation = {"id": annotation_id, "image_id": index, **_annotation(sample, record, instances)}
                    file.write((b"\n" if annotation_id == 1 else b",\n") + encode(annotation))
        file.write(b'],\n"images":' + encode(images) + b"}\n")


def _annotation(sample: Sample, record: ObjectRecord, instances: NDArray[np.uint16]) -> dict[str, Any]:
    """Return an object's annotation without its numbers."""
    rle = coco_mask.encode(np.asfortranarray(instances == record.instance, np.uint8))
    points = _keypoints(sample, record, instances)
    return {
        "category_id": record.class_id,
        "iscrowd": 0,
        "area": record.visible_pixels,
        "bbox": record.box_visible,
        "segmentation": {"size": rle["size"], "counts": rle["counts"].decode("ascii")},
        "keypoints": [value for point in points for value in point],
        "num_keypoints": sum(flag != OUTSIDE for *_, flag in points),
    }


def _keypoints(sample: Sample, record: ObjectRecord, instances: NDArray[np.uint16]) -> list[tuple[float, float, int]]:
    """Return COCO's coordinates and flag of each keypoint of an object. Points outside of the image are at (0, 0).

    A point is hidden if another object is seen at its pixel, or something else that is nearer.
    """
    points = np.vstack(((0.0, 0.0, 0.0), box_corners(record.box_3d)))
    X = np.array(record.X_camera_object)
    in_camera = points @ X[:3, :3].T + X[:3, 3]
    keypoints: list[tuple[float, float, int]] = []
    height, width = instances.shape
    depth = sample.depth + sample.record.camera.depth_origin if "depth" in sample.record.images else None
    for x, y, z in (in_camera @ sample.K.T).tolist():
        u, v = (x / z, y / z) if z > 0.0 else (-1.0, -1.0)
        if not (0.0 <= u < width and 0.0 <= v < height):
            keypoints.append((0.0, 0.0, OUTSIDE))
            continue
        pixel = int(v), int(u)
        is_behind = instances[pixel] != 0 if depth is None else depth[pixel] < z
        is_hidden = is_behind and instances[pixel] != record.instance
        flag = HIDDEN if is_hidden else VISIBLE
        keypoints.append((round(u - PIXEL_CENTER, 3), round(v - PIXEL_CENTER, 3), flag))
    return keypoints
