"""Check the image files of a dataset, for ``check``. Errors are RecordErrors without the name of the file."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from renderers.stop import check_stop
from scenegate.datasets import dataset, manifest
from scenegate.datasets.manifest import CameraRecord, ImageFile, ImageType, Masks, RecordError
from scenegate.regular_files import read_regular, sha256_of

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


def read_image(folder: Path, image: ImageFile) -> bytes:
    """Return the content of an image file; raises RecordError if it is not that of the manifest."""
    path = manifest.path_inside(folder, image.path)
    digest = sha256_of(path, check_stop)
    if digest is None:
        raise RecordError("missing, or not a regular file that can be read")
    if digest != image.sha256:
        size = path.stat().st_size
        raise RecordError(f"changed: its SHA-256 is not that of the manifest ({size} bytes, {image.bytes} there)")
    return read_regular(path)


def decoded(image_type: ImageType, data: bytes, camera: CameraRecord) -> NDArray[Any]:
    """Return the pixels of an image, channels as BGR; raises RecordError if they are not of the type or the camera."""
    if image_type == "flow":
        pixels: NDArray[Any] | None = dataset.decode_flow(data, "")
    else:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    if pixels is None:
        raise RecordError("not an image that can be read")
    data_type, channels = pixels.dtype.name, 1 if pixels.ndim == 2 else pixels.shape[2]
    if (data_type, channels) not in _PIXEL_FORMATS[image_type]:
        raise RecordError(f"a {image_type} image with {channels} channels of {data_type}")
    _check_size(pixels.shape[0], pixels.shape[1], camera)
    return pixels


def decoded_masks(data: bytes, camera: CameraRecord) -> Masks:
    """Return the silhouettes in a file; raises RecordError if they are invalid or not of the camera's size."""
    masks = manifest.decode_masks(data, "silhouettes")
    _check_size(*masks.size, camera)
    return masks


def _check_size(height: int, width: int, camera: CameraRecord) -> None:
    if (height, width) != (camera.height, camera.width):
        raise RecordError(f"{width}x{height} pixels, the camera has {camera.width}x{camera.height}")


def check_values(image_type: ImageType, pixels: NDArray[Any], scene: manifest.SceneRecord | None) -> None:
    """Raise RecordError for values that an image cannot have."""
    if image_type == "depth" and pixels.dtype == np.float32 and (np.isnan(pixels).any() or (pixels < 0.0).any()):
        raise RecordError("depth that is negative or not a number")
    if image_type == "label" and scene is not None and scene.labels:
        bgr = pixels.astype(np.uint32)
        labels = np.unique(bgr[..., 2] | bgr[..., 1] << 8 | bgr[..., 0] << 16)
        unknown = [label for label in labels.tolist() if label != dataset.NO_LABEL and str(label) not in scene.labels]
        if unknown:
            raise RecordError(f"labels that {manifest.SCENE_FILE} does not know: {', '.join(map(str, unknown[:5]))}")
