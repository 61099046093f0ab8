"""Image sets as files: PNG, PLY, npz, and a preview of a set."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.generated import image_interface_pb2 as pb

_MAX_PREVIEW_SIZE = (640, 480)
"""Maximum size of one image in a preview, pixels."""


class BadImageError(ValueError):
    """Invalid image message; one sentence."""


def timestamp_text(time: pb.Time) -> str:
    """Return seconds and nanoseconds as in the file names of the vendor's client."""
    return f"{time.sec}.{time.nsec:09d}"


def pixels(image: pb.Image) -> NDArray[Any]:
    """Return the pixels of a message: (H, W) uint8 or uint16, or (H, W, 3) uint8 RGB.

    Raises:
        BadImageError: unknown encoding, or too little data.
    """
    formats = {"mono8": ("u1", 1), "mono16": ("u2", 1), "rgb8": ("u1", 3)}
    if image.encoding not in formats:
        raise BadImageError(f"the encoding {image.encoding!r} is not one of {', '.join(formats)}")
    type_code, channels = formats[image.encoding]
    dtype = np.dtype(type_code).newbyteorder(">" if image.is_bigendian else "<")
    row_bytes = image.width * channels * dtype.itemsize
    if image.step < row_bytes or len(image.data) < image.step * image.height:
        raise BadImageError(f"{len(image.data)} bytes are too few for {image.width}x{image.height} {image.encoding}")
    rows = np.frombuffer(image.data, np.uint8, image.step * image.height).reshape(image.height, image.step)[
        :, :row_bytes
    ]
    array = np.ascontiguousarray(rows).view(dtype).astype(dtype.newbyteorder("="), copy=False)
    return array.reshape((image.height, image.width, 3) if channels == 3 else (image.height, image.width))


def depth(disparity: pb.DisparityImage) -> NDArray[np.float32]:
    """Return (H, W) float32, metres, +inf where invalid."""
    units = pixels(disparity.image)
    d = units.astype(np.float32) * disparity.scale + disparity.offset
    with np.errstate(divide="ignore"):
        z = disparity.image.focal_length * disparity.baseline / d
    z[units == disparity.invalid_data_value] = np.inf
    return np.asarray(z, np.float32)


def save(image_set: pb.ImageSet, folder: Path, *, exposure: bool = False, gpio: bool = False) -> None:
    """Write every image as PNG, the mesh as PLY, and all arrays with their parameters as one npz.

    File names are those of the vendor's client: ``image_<sec>.<nsec>_left.png``. Disparity PNGs have 16 bits in units
    of ``scale`` pixels, and a parameter file (``parameter_text``).

    Args:
        image_set: received set.
        folder: existing folder.
        exposure: add the exposure of each image to the npz (``<name>_exposure_time`` in seconds, ``_gain``
            in dB, ``_gamma``, ``_noise``, ``_out1_reduction``, ``_brightness``).
        gpio: add the GPIOs of each image to the npz (``<name>_gpio_values``, ``_gpio_outputs``, ``_gpio_inputs``), and
            their bits to the file names, as the vendor's client does.

    Raises:
        BadImageError: see ``pixels``.
        OSError: a file cannot be written.
    """
    base = f"image_{timestamp_text(image_set.timestamp)}"
    arrays: dict[str, Any] = {}
    for name, image in _images(image_set).items():
        array = pixels(image)
        arrays[name] = array
        arrays[f"{name}_K"] = intrinsics(image)
        arrays[f"{name}_timestamp"] = np.int64(image.timestamp.sec * 10**9 + image.timestamp.nsec)
        if exposure:
            for field in ("exposure_time", "gain", "gamma", "noise", "out1_reduction", "brightness"):
                arrays[f"{name}_{field}"] = np.float64(getattr(image, field))
        if gpio:
            for field in ("values", "outputs", "inputs"):
                arrays[f"{name}_gpio_{field}"] = np.uint32(getattr(image.gpios, field))
        write_image(folder / f"{base}_{name}{_gpio_suffix(image) if gpio else ''}.png", array)
    if image_set.HasField("disparity"):
        disparity = image_set.disparity
        suffix = _gpio_suffix(disparity.image) if gpio else ""
        (folder / f"{base}_disparity{suffix}_param.txt").write_text(parameter_text(disparity), "ascii")
        arrays["depth"] = depth(disparity)
        arrays["baseline"], arrays["scale"] = np.float64(disparity.baseline), np.float64(disparity.scale)
    if arrays:
        np.savez(folder / f"{base}.npz", allow_pickle=False, **arrays)
    if image_set.HasField("mesh"):
        (folder / f"{base}_mesh.{image_set.mesh.format}").write_bytes(image_set.mesh.data)


def parameter_text(disparity: pb.DisparityImage) -> str:
    """Return the parameter file of a disparity image for cvkit's tools.

    Keys and order are those of the vendor's client. Numbers have all their digits, because five decimals would round a
    scale of 1/256.
    """
    image = disparity.image
    f, u, v = (_number(value) for value in (image.focal_length, image.principal_point_u, image.principal_point_v))
    values = {
        "camera.A": f"[{f} 0 {u}; 0 {f} {v}; 0 0 1]",
        "camera.height": image.height,
        "camera.width": image.width,
        "rho": f"{image.focal_length * disparity.baseline:.9g}",
        "t": _number(disparity.baseline),
        "camera.exposure_time": _number(image.exposure_time),
        "camera.gain": _number(image.gain),
        "camera.noise": _number(image.noise),
        "camera.out1_reduction": _number(image.out1_reduction),
        "camera.brightness": _number(image.brightness),
        "disp.scale": _number(disparity.scale),
        "disp.offset": _number(disparity.offset),
        "disp.inv": _number(disparity.invalid_data_value),
    }
    lines = (f"{key}={value}\n" for key, value in values.items())
    return f"# Created by scenegate stream\n{''.join(lines)}"


def _number(value: float) -> str:
    """Return the shortest decimal text of a float32, without an exponent."""
    return np.format_float_positional(np.float32(value), trim="-")


def _gpio_suffix(image: pb.Image) -> str:
    """Return ``_<outputs>_<inputs>`` as in the vendor's file names: a bit per line, the highest first."""

    def bits(mask: int) -> str:
        return "".join(str(image.gpios.values >> line & 1) for line in reversed(range(32)) if mask >> line & 1)

    return f"_{bits(image.gpios.outputs)}_{bits(image.gpios.inputs)}"


def intrinsics(image: pb.Image) -> NDArray[np.float64]:
    """Return the camera matrix of an image, (3, 3) float64."""
    f = image.focal_length
    return np.array(((f, 0, image.principal_point_u), (0, f, image.principal_point_v), (0, 0, 1)), np.float64)


def preview(image_set: pb.ImageSet) -> NDArray[np.uint8]:
    """Return all images of a set side by side, (H, W, 3) uint8 RGB; disparity in colours, invalid pixels black."""
    cells = []
    for name, image in _images(image_set).items():
        array = pixels(image)
        if name == "disparity":
            array = in_color(array)
        elif name == "error":  # half a pixel and more is white
            array = np.minimum(array * (512.0 * (image_set.disparity.scale or 1 / 16)), 255).astype(np.uint8)
        if array.ndim == 2:
            array = np.repeat(array[:, :, None], 3, axis=2)
        shrink = min(_MAX_PREVIEW_SIZE[0] / array.shape[1], _MAX_PREVIEW_SIZE[1] / array.shape[0], 1.0)
        size = (max(round(array.shape[1] * shrink), 1), max(round(array.shape[0] * shrink), 1))
        cells.append(np.asarray(cv2.resize(array, size, interpolation=cv2.INTER_AREA), np.uint8))
    if not cells:
        return np.zeros((1, 1, 3), np.uint8)
    height = max(cell.shape[0] for cell in cells)
    columns = [np.pad(cell, ((0, height - cell.shape[0]), (0, 4), (0, 0))) for cell in cells]
    return np.concatenate(columns, axis=1)[:, :-4]


def in_color(disparity: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Return colours of disparities, (H, W, 3) uint8 RGB: near is red, far is blue, invalid is black.

    The colours cover the middle 98 % of the values.
    """
    valid = disparity > 0
    low, high = np.percentile(disparity[valid], (1, 99)) if valid.any() else (0, 1)
    scaled = np.clip((disparity.astype(np.float32) - low) / max(high - low, 1) * 255, 0, 255).astype(np.uint8)
    colored = np.asarray(cv2.applyColorMap(scaled, cv2.COLORMAP_TURBO), np.uint8)[:, :, ::-1].copy()
    colored[~valid] = 0
    return colored


def write_image(path: Path, array: NDArray[Any]) -> None:
    """Write an image in the format of the file name's suffix.

    Raises:
        OSError: the file cannot be written, or unknown suffix.
    """
    bgr = array[:, :, ::-1] if array.ndim == 3 else array
    try:
        encoded, data = cv2.imencode(path.suffix or ".png", np.ascontiguousarray(bgr))
    except cv2.error:
        encoded = False
    if not encoded:
        raise OSError(f"cannot write {path}: {path.suffix!r} is no image format")
    path.write_bytes(data.tobytes())


def _images(image_set: pb.ImageSet) -> dict[str, pb.Image]:
    """Return the images of a set by name."""
    images = {}
    for name in ("left", "right", "disparity", "error", "confidence"):
        field = "disparity_error" if name == "error" else name
        if image_set.HasField(field):
            message = getattr(image_set, field)
            images[name] = message.image if name == "disparity" else message
    return images
