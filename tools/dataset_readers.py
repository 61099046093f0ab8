"""Read a small dataset in each format with the packages of docs/dataset-formats.md, and compare all objects.

    python -m tools.dataset_readers [READER …]

uv and npm install the packages in throw-away environments; torchvision takes 3 GB. The first samples have no object,
the others two to five: hidden ones, with holes, and in two parts. Each model is a class.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np
import trimesh
from numpy.typing import NDArray

from scenegate.datasets import Dataset, Sample
from scenegate.datasets.dataset import NO_BOX
from scenegate.datasets.formats import FORMATS

TYPES: Final = "color,depth,instance,class,amodal,flow"
READERS: Final = {
    "bop_toolkit_lib": (
        "bop",
        "bop_toolkit_lib@git+https://github.com/thodan/bop_toolkit@cea62d651c7e395b2e1962b9749e4e89693c6ac4",
    ),
    "pycocotools": ("coco", "pycocotools==2.0.11"),
    "torchvision": ("coco", "torchvision==0.28.0 pycocotools==2.0.11"),
    "supervision": ("coco", "supervision==0.31.2 opencv-python-headless==5.0.0.93"),
    "datumaro": ("coco", "datumaro==1.13.12"),
    "webdataset": ("webdataset", "webdataset==1.0.2 pillow==12.3.0 pycocotools==2.0.11"),
    "datasets": ("webdataset", "datasets==5.2.0 pillow==12.3.0 pycocotools==2.0.11"),
    "h5py": ("hdf5", "h5py==3.16.0"),
    "pyfive": ("hdf5", "pyfive==1.3.0"),
    "jsfive": ("hdf5", "jsfive@0.4.2"),
}
"""Format and packages by the name of a reader, which has a function of this name in ``PROGRAM``."""
PROGRAM: Final = """
import json, os, sys
import numpy as np

def bop_toolkit_lib():
    from bop_toolkit_lib import inout
    for scene in sorted(os.listdir("bop/train_pbr")):
        folder = f"bop/train_pbr/{scene}"
        infos = inout.load_json(f"{folder}/scene_gt_info.json", keys_to_int=True)
        for number, found in inout.load_scene_gt(f"{folder}/scene_gt.json").items():
            masks, amodal = ([inout.load_im(f"{folder}/{name}/{number:06d}_{k:06d}.png") > 0 for k in range(len(found))]
                             for name in ("mask_visib", "mask"))
            X = [np.block([[each["cam_R_m2c"], each["cam_t_m2c"] / 1000], [np.eye(4)[3]]]) for each in found]
            boxes = [np.add(each["bbox_visib"], (0, 0, *2 * [each["px_count_visib"] > 0])) for each in infos[number]]
            yield {"classes": [each["obj_id"] for each in found], "poses": X, "boxes": boxes, "masks": masks,
                   "amodal": amodal, "color": inout.load_im(f"{folder}/rgb/{number:06d}.png")}

def pycocotools():
    from pycocotools.coco import COCO
    coco = COCO("coco/annotations.json")
    for number in sorted(coco.getImgIds()):
        found = coco.loadAnns(coco.getAnnIds(imgIds=number))
        yield {"classes": [each["category_id"] for each in found], "boxes": [each["bbox"] for each in found],
               "masks": [coco.annToMask(each) for each in found]}

def torchvision():
    from torchvision.datasets import CocoDetection, wrap_dataset_for_transforms_v2
    dataset = CocoDetection("coco/images", "coco/annotations.json")
    for _, found in wrap_dataset_for_transforms_v2(dataset, target_keys=("boxes", "masks", "labels")):
        labels, boxes, masks = (found.get(name, ()) for name in ("labels", "boxes", "masks"))
        yield {"classes": labels, "boxes": sizes(boxes), "masks": masks}

def supervision():
    from supervision import DetectionDataset
    dataset = DetectionDataset.from_coco("coco/images", "coco/annotations.json", force_masks=True)
    for _, _, found in sorted(dataset, key=lambda item: item[0]):
        yield {"classes": np.array(found.class_id) + 1, "boxes": sizes(found.xyxy),
               "masks": found.mask if len(found) else ()}

def datumaro():
    from datumaro import Dataset
    os.makedirs("datumaro/annotations")
    os.symlink("../coco/images", "datumaro/images")
    os.symlink("../../coco/annotations.json", "datumaro/annotations/instances_default.json")
    for item in sorted(Dataset.import_from("datumaro", "coco"), key=lambda item: item.id):
        found = sorted(item.annotations, key=lambda each: each.id)
        masks, boxes = ([each for each in found if each.type.name == name] for name in ("mask", "bbox"))
        yield {"classes": [each.label + 1 for each in masks], "boxes": [each.get_bbox() for each in boxes],
               "masks": [each.image for each in masks]}

def webdataset():
    from webdataset import WebDataset
    yield from map(of_shard, in_order(WebDataset("webdataset/shard-000000.tar", shardshuffle=False).decode("rgb8")))

def datasets():
    from datasets import load_dataset
    options = {"data_files": "webdataset/*.tar", "split": "train"}
    tables = [load_dataset("webdataset", **options, streaming=streaming) for streaming in (True, False)]
    for streamed, sample in zip(*map(in_order, tables), strict=True):
        assert all(repr(streamed[name]) == repr(sample[name]) for name in ("json", "amodal.json"))
        yield of_shard(sample)

def in_order(samples):
    return sorted(samples, key=lambda sample: sample["__key__"])

def of_shard(sample):
    from pycocotools import mask
    found, silhouettes = sample["json"]["objects"], sample["amodal.json"]
    return {"classes": [each["class_id"] for each in found], "poses": [each["X_camera_object"] for each in found],
            "boxes": [each["box_visible"] or (-1, -1, -1, -1) for each in found],
            "masks": [np.array(sample["instance.npy.gz"]) == each["instance"] for each in found],
            "amodal": [mask.decode(mask.frPyObjects(each, *each["size"])) for each in silhouettes],
            "color": sample["color.png"], "depth": sample["depth.npy.gz"], "flow": sample["flow.npy.gz"]}

def h5py(package="h5py"):
    for sample_id in sys.argv[2:]:
        group = __import__(package).File("hdf5/samples.hdf5")[sample_id]
        found, images = group["objects"], {name: group[name][:] for name in ("color", "depth", "amodal")}
        yield {"classes": found["class_id"][:], "poses": found["X_camera_object"][:], "boxes": found["box_visible"][:],
               "masks": [group["instance"][:] == each for each in found["instance"][:]], **images}

def pyfive():
    return h5py("pyfive")

def sizes(corners):
    corners = np.array(corners).reshape(-1, 4)
    return np.hstack((corners[:, :2], corners[:, 2:] - corners[:, :2]))

samples = [{name: np.array(values, float).ravel().tolist() for name, values in sample.items()}
           for sample in globals()[sys.argv[1]]()]
json.dump(samples, open("read.json", "w"))
"""
JAVASCRIPT: Final = """
import {readFileSync, writeFileSync} from "node:fs"
import {File} from "jsfive"
const file = new File(new Uint8Array(readFileSync("hdf5/samples.hdf5")).buffer, "samples.hdf5")
const samples = process.argv.slice(2).map((id) => {
    const read = (name) => Array.from(file.get(id).get(name).value, Number), pixels = read("instance")
    return {classes: read("objects/class_id"), poses: read("objects/X_camera_object"),
            boxes: read("objects/box_visible"), amodal: read("amodal"), color: read("color"),
            masks: read("objects/instance").flatMap((each) => pixels.map((pixel) => Number(pixel == each)))}
})
writeFileSync("read.json", JSON.stringify(samples))
"""


def main() -> None:
    wrong = False
    with tempfile.TemporaryDirectory() as name:
        dataset = write_dataset(Path(name))
        print("| reader | format | objects of samples | equal |\n|---|---|---|---|")
        for reader in sys.argv[1:] or READERS:
            format_name, packages = READERS[reader]
            try:
                samples = read(reader, Path(name), [sample.id for sample in dataset])
            except subprocess.CalledProcessError:  # its reason is on stderr
                print(f"| {packages} | {format_name} | | not read |", flush=True)
                wrong = True
                continue
            differing = differences(dataset, samples, only_visible=format_name == "coco")
            counts = " ".join(str(len(sample["classes"])) for sample in samples)
            equal = f"not {', '.join(differing)}" if differing else ", ".join(samples[0])
            print(f"| {packages} | {format_name} | {counts} | {equal} |", flush=True)
            wrong |= bool(differing)
    sys.exit(wrong)


def write_dataset(folder: Path) -> Dataset:
    """Write a dataset of three scenes, and its export in each format."""
    boxes = ((0.02, 0.3, 0.02), (0.1, 0.1, 0.1), (0.05, 0.05, 0.05), (0.3, 0.05, 0.02))
    shapes = [trimesh.creation.torus(0.08, 0.02), *map(trimesh.creation.box, boxes)]
    places = ((0.0, 0.0, 0.1), (0.0, 0.0, 0.2), (0.2, 0.0, 0.0), (0.2, 0.0, 0.0), (0.0, 0.0, -0.1))
    (folder / "scenes").mkdir()
    for name, count in (("empty", 2), ("five", 5), ("two", 2)):
        scene: Any = trimesh.Scene()
        for number in range(count):
            X = np.eye(4)
            X[:3, 3] = places[number]
            scene.add_geometry(shapes[number], f"object{number}", f"object{number}", transform=X)
        scene.export(folder / f"scenes/{name}.glb")
    views = [{"name": f"{k}", "camera": f"eye={0.4 + 0.1 * k},-0.9,0.4;target=0,0,0"} for k in range(6)]
    away = [{**view, "camera": "eye=0,-1,0;target=0,-2,0", "near": 0.1, "far": 1} for view in views]
    (folder / "cameras.json").write_text(json.dumps({"cameras": views, "scenes": {"empty.glb": away}}))
    command = [sys.executable, "-m", "scenegate"]
    options = ["--type", TYPES, "--cameras", "cameras.json", "--width", "96", "--height", "64"]
    subprocess.run([*command, "render", "scenes", "-o", "data", *options], cwd=folder, check=True)
    for name in FORMATS:
        subprocess.run([*command, "dataset", "export", "data", name, "--format", name], cwd=folder, check=True)
    return Dataset(folder / "data")


def read(reader: str, folder: Path, sample_ids: list[str]) -> list[dict[str, Any]]:
    """Return what a reader reads of each sample: flat arrays by name."""
    packages = READERS[reader][1].split()
    if reader == "jsfive":
        (folder / "read.mjs").write_text(JAVASCRIPT)
        subprocess.run(["npm", "install", "--silent", *packages], cwd=folder, check=True)
        command = ["node", "read.mjs"]
    else:
        options = [option for package in packages for option in ("--with", package)]
        uv = Path(sys.executable).with_name("uv")
        command = [str(uv), "run", "--quiet", "--no-project", *options, "python", "-c", PROGRAM, reader]
    environment = {**os.environ, "HF_HOME": str(folder / "hub"), "HF_HUB_OFFLINE": "1", "PYTHONWARNINGS": "ignore"}
    subprocess.run([*command, *sample_ids], cwd=folder, env=environment, check=True, stdout=subprocess.DEVNULL)
    samples: list[dict[str, Any]] = json.loads((folder / "read.json").read_text())
    (folder / "read.json").unlink()
    return samples


def differences(dataset: Dataset, samples: list[dict[str, Any]], *, only_visible: bool) -> list[str]:
    """Return the names of arrays that differ, with the sample."""
    return [
        f"{name} of {sample.id}"
        for sample, found in zip(dataset, samples, strict=True)
        for expected in (arrays(sample, only_visible=only_visible),)
        for name, values in found.items()
        if not same(np.ravel(expected[name]), np.array(values, float))
    ]


def same(expected: NDArray[Any], values: NDArray[Any]) -> bool:
    """Return whether flat arrays agree; BOP's lengths, in millimetres, are rounded once more."""
    return len(expected) == len(values) and np.allclose(expected, values, rtol=0.0, atol=1e-12, equal_nan=True)


def arrays(sample: Sample, *, only_visible: bool) -> dict[str, Any]:
    """Return what a reader should read of a sample."""
    objects = [each for each in sample.objects if each.visible_pixels or not only_visible]
    return {
        "classes": [each.class_id for each in objects],
        "poses": [each.X_camera_object for each in objects],
        "boxes": [each.box_visible or NO_BOX for each in objects],
        "masks": [sample.instance == each.instance for each in objects],
        "flow": np.full((*sample.depth.shape, 2), np.nan),  # of the last view of a scene
        **{image_type: sample.image(image_type) for image_type in sample.record.images},
    }


if __name__ == "__main__":
    main()
