"""WebDataset: tar files ``shard-000000.tar`` … with the image files and the manifest's record of each sample.

for sample in webdataset.WebDataset("out/shard-{000000..000009}.tar").decode("rgb8"):
    sample["color.png"], sample["depth.npy.gz"], sample["json"]["camera"], sample["json"]["objects"]

The package's decoders of images make 8-bit RGB of all of them, so images with other numbers are arrays. Hugging Face's
``datasets`` takes the types of all columns from the first five samples: the first ones have what others lack.
"""

import gzip
import io
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
import webdataset
from numpy.typing import NDArray

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
        types = dataset.description.settings.types
        first = _complete_samples(dataset)
        for index in first:
            writer.write(_files(index, dataset[index], types))
        for index, sample in enumerate(samples):
            if index not in first:
                writer.write(_files(index, sample, types))


def _complete_samples(dataset: Dataset) -> list[int]:
    """Return the numbers of up to three samples that together have all that is None, or missing, in others."""
    types = len(dataset.description.settings.types)
    tests: tuple[Callable[[Sample], bool], ...] = (
        lambda sample: any(record.visible_pixels for record in sample.objects),
        lambda sample: sample.record.camera.far is not None,
        lambda sample: len(sample.record.images) == types,
    )
    found = (next((k for k, sample in enumerate(dataset) if test(sample)), None) for test in tests)
    return list(dict.fromkeys(k for k in found if k is not None))


def _files(index: int, sample: Sample, types: Sequence[ImageType]) -> dict[str, str | bytes]:
    """Return the files of a sample by extension, and its key. Paths are text: loaders want lists of one type."""
    objects = tuple(msgspec.structs.replace(each, path=tuple(map(str, each.path))) for each in sample.objects)
    record = msgspec.structs.replace(sample.record, objects=objects)
    files = dict(_file(sample, image_type) for image_type in sample.record.images)
    if "flow" in types and "flow" not in sample.record.images:  # the last view of a scene
        camera = sample.record.camera
        files |= [_array_file("flow", np.full((camera.height, camera.width, 2), np.nan, np.float32))]
    return {"__key__": f"{index:08d}", "json": manifest.encode(record), **files}


def _file(sample: Sample, image_type: ImageType) -> tuple[str, bytes]:
    """Return the extension and content of a file with an image."""
    if image_type in FILE_TYPES:
        return f"{image_type}{sample.path(image_type).suffix}", sample.file_bytes(image_type)
    return _array_file(image_type, sample.image(image_type))


def _array_file(image_type: ImageType, pixels: NDArray[Any]) -> tuple[str, bytes]:
    """Return the extension and content of a file with an array."""
    data = io.BytesIO()
    np.save(data, pixels)
    return f"{image_type}.npy.gz", gzip.compress(data.getvalue(), 1, mtime=0)
