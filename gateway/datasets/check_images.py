"""Check the image files of a dataset, for ``check``. Errors are RecordErrors."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from renderers.stop import check_stop
from scenegate.datasets import NO_LABEL, Sample, manifest
from scenegate.datasets.dataset import label_numbers
from scenegate.datasets.manifest import ImageFile, ImageType, RecordError
from scenegate.regular_files import sha256_of

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


def check_file(folder: Path, image: ImageFile) -> None:
    """Raise RecordError if an image file is not that of the manifest."""
    path = manifest.path_inside(folder, image.path)
    digest = sha256_of(path, check_stop)
    if digest is None:
        raise RecordError("missing, or not a regular file that can be read")
    if digest != image.sha256:
        size = path.stat().st_size
        raise RecordError(f"changed: its SHA-256 is not that of the manifest ({size} bytes, {image.bytes} there)")


def checked_pixels(sample: Sample, image_type: ImageType, scene: manifest.SceneRecord | None) -> NDArray[Any]:
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
            raise RecordError(f"labels that {manifest.SCENE_FILE} does not know: {', '.join(unknown[:5])}")
    return pixels
