"""WebDataset: tar files ``shard-000000.tar`` … with the image files and the manifest's record of each sample.

for sample in webdataset.WebDataset("out/shard-{000000..000009}.tar").decode("rgb8"):
    sample["color.png"], sample["depth.npy.gz"], sample["json"]["camera"], sample["json"]["objects"]

The package's decoders of images make 8-bit RGB of all of them, so images with other numbers are arrays. Hugging Face's
``datasets`` takes the types of all columns from the first samples, so the first one has objects, if any has.
"""

from __future__ import annotations

import gzip
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
import webdataset

from scenegate.datasets import manifest
from scenegate.datasets.dataset import Dataset, Sample
from scenegate.datasets.manifest import ImageType

FILE_TYPES: Final[tuple[ImageType, ...]] = ("color", "label", "normal", "albedo", "stereo", "amodal")
"""Types of images whose files are copied: 8-bit RGB, and JSON. The others are written as compressed arrays."""
SHARD_SAMPLES: Final = 1000
"""Maximum number of samples in a shard."""
SHARD_BYTES: Final = 1e9
"""Size of a shard after which the next one begins; storage services read files of this size at full speed."""


def write(dataset: Dataset, folder: Path, samples: Iterator[Sample]) -> None:
    """Write the samples of a dataset into a folder."""
    (folder / manifest.DATASET_FILE).write_bytes(manifest.encode_indented(dataset.description))
    # Absolute: webdataset runs what follows "pipe:" at the start of a name.
    pattern = str(folder.absolute()).replace("%", "%%") + "/shard-%06d.tar"
    with webdataset.ShardWriter(
        pattern, maxcount=SHARD_SAMPLES, maxsize=SHARD_BYTES, verbose=0, encoder=False, mtime=0.0
    ) as writer:
        first = next((k for k, each in enumerate(dataset) if any(o.visible_pixels for o in each.objects)), 0)
        if len(dataset):
            writer.write(_files(first, dataset[first]))
        for index, sample in enumerate(samples):
            if index != first:
                writer.write(_files(index, sample))


def _files(index: int, sample: Sample) -> dict[str, str | bytes]:
    """Return the files of a sample by extension, and its key. Paths are text: loaders want lists of one type."""
    objects = tuple(msgspec.structs.replace(each, path=tuple(map(str, each.path))) for each in sample.objects)
    record = msgspec.structs.replace(sample.record, objects=objects)
    files = dict(_file(sample, image_type) for image_type in sample.record.images)
    return {"__key__": f"{index:08d}", "json": manifest.encode(record), **files}


def _file(sample: Sample, image_type: ImageType) -> tuple[str, bytes]:
    """Return the extension and content of a file with an image."""
    if image_type in FILE_TYPES:
        return f"{image_type}{sample.path(image_type).suffix}", sample.file_bytes(image_type)
    data = io.BytesIO()
    np.save(data, sample.image(image_type))
    return f"{image_type}.npy.gz", gzip.compress(data.getvalue(), 1, mtime=0)
