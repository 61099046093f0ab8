#!/usr/bin/env bash
# Package: labelformat 0.1.17.
# Wrong belief: what pycocotools reads as a mask, other readers of COCO files read, too.
# Behaviour: iscrowd alone decides: masks as RLE are read for crowds only, and polygons for others only. The compressed text that
#   pycocotools writes is taken for a number.
# Why it matters: data sets of renderers have exact masks as RLE of single objects; each of them is an error.
# Seen 2026-11-29: of the same mask, RLE as a list of a crowd and a polygon of an object are read; the three others are errors.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check labelformat==0.1.17 numpy==2.4.6 pycocotools==2.0.11

venv/bin/python - <<'PYTHON'
import contextlib
import io
import json
from pathlib import Path

from labelformat.formats import COCOInstanceSegmentationInput
from pycocotools.coco import COCO

SIZE = [4, 4]
MASKS = {
    "text": {"size": SIZE, "counts": "52203"},
    "list": {"size": SIZE, "counts": [5, 2, 2, 2, 5]},
    "polygon": [[1, 1, 3, 1, 3, 3, 1, 3]],
}
read = {}
for name, is_crowd in (("text", 0), ("text", 1), ("list", 0), ("list", 1), ("polygon", 0)):
    annotation = {"id": 1, "image_id": 1, "category_id": 1, "iscrowd": is_crowd, "bbox": [1, 1, 2, 2], "area": 4}
    content = {
        "images": [{"id": 1, "file_name": "a.png", "width": 4, "height": 4}],
        "categories": [{"id": 1, "name": "box"}],
        "annotations": [annotation | {"segmentation": MASKS[name]}],
    }
    Path("coco.json").write_text(json.dumps(content))
    with contextlib.redirect_stdout(io.StringIO()):
        coco = COCO("coco.json")
    area = int(coco.annToMask(coco.loadAnns(1)[0]).sum())
    assert area == 4, (name, area)
    try:
        read[name, is_crowd] = len(list(COCOInstanceSegmentationInput(Path("coco.json")).get_labels())[0].objects)
    except ValueError as error:
        print(name, is_crowd, error)
        read[name, is_crowd] = 0
print(read)
assert read == {("text", 0): 0, ("text", 1): 0, ("list", 0): 0, ("list", 1): 1, ("polygon", 0): 1}
PYTHON
