#!/usr/bin/env bash
# Package: supervision 0.31.2.
# Wrong belief: DetectionDataset.from_coco(…).as_coco(…) keeps masks; one with a hole is written as RLE.
# Behaviour: from_coco keeps "iscrowd": 0 of the file, for which as_coco writes polygons. The outline of the hole is one
#   more polygon, and the polygons of an object are united: the hole is filled, "area" stays without it. With
#   use_iscrowd=False the mask is written as RLE, as iscrowd 1.
# Why it matters: rings, mugs with handles and fences grow when a data set is split, merged or filtered.
# Seen 2026-11-29: 148 pixels, read again 168, area 148.0.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check supervision==0.31.2 opencv-python-headless==5.0.0.93

venv/bin/python - <<'PYTHON'
import json

import numpy as np
from PIL import Image
from supervision import DetectionDataset


def write_and_read(**options: bool) -> tuple[np.ndarray, dict]:
    dataset = DetectionDataset.from_coco(".", "coco.json", force_masks=True, **options)
    assert (next(iter(dataset))[2].mask[0] == ring).all()
    dataset.as_coco(annotations_path="again.json")
    again = DetectionDataset.from_coco(".", "again.json", force_masks=True)
    return next(iter(again))[2].mask[0], json.load(open("again.json"))["annotations"][0]


ring = np.zeros((16, 20), bool)
ring[2:14, 3:17] = True
ring[6:10, 7:12] = False
down_columns = ring.T.ravel()
starts = np.flatnonzero(np.diff(down_columns)) + 1
counts = np.diff([0, *starts, ring.size]).tolist()
annotation = {"id": 1, "image_id": 1, "category_id": 1, "iscrowd": 0, "area": int(ring.sum()), "bbox": [3, 2, 14, 12]}
annotation["segmentation"] = {"size": [16, 20], "counts": counts}
image = {"id": 1, "file_name": "image.png", "width": 20, "height": 16}
categories = [{"id": 1, "name": "ring", "supercategory": ""}]
json.dump({"images": [image], "categories": categories, "annotations": [annotation]}, open("coco.json", "w"))
Image.new("RGB", (20, 16)).save("image.png")

mask, written = write_and_read()
print(f"{ring.sum()} pixels, again {mask.sum()}, area {written['area']}")
assert mask[6:10, 7:12].all()
assert written["area"] == ring.sum()
mask, written = write_and_read(use_iscrowd=False)
assert (mask == ring).all()
assert written["iscrowd"] == 1
PYTHON
