"""Write image sets to PNG, PLY, npz and parameter files, and join the images of a set for a preview."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenegate.camera import image_interface_pb2 as pb
from scenegate.messages.arguments import describe
from scenegate.pillow import pillow
from scenegate.png import encode_png
from scenegate.regular_files import write_whole

_MAX_PREVIEW_SIZE = (640, 480)
"""Maximum width and height of each image in a preview, in pixels."""


_TURBO_COLORS: Final = np.frombuffer(
    bytes.fromhex("30123b4143a74771e93e9bfe22c5e21ae4b646f88488ff4eb9f635e1dd37faba39fd8d27f05b12d63506af18017a0403"),
    np.uint8,
).reshape(-1, 3)
_TURBO: Final = np.array(
    [np.interp(np.linspace(0.0, 1.0, 256), np.linspace(0.0, 1.0, len(_TURBO_COLORS)), each) for each in _TURBO_COLORS.T]
).T
"""The colormap Turbo of Google AI, (256, 3) RGB: blue, green, red; every 17th colour is exact."""


class BadImageError(ValueError):
    """A received image is invalid; the message is one sentence."""


def timestamp_text(time: pb.Time) -> str:
    """Return a time as ``sec.nsec`` with 9 digits of nanoseconds, as in the file names of the vendor's client."""
    return f"{time.sec}.{time.nsec:09d}"


def nanoseconds(time: pb.Time) -> int:
    """Return a time as nanoseconds since the epoch."""
    return int(time.sec * 10**9 + time.nsec)


def pixels(image: pb.Image) -> NDArray[Any]:
    """Return the pixels of a received image: (H, W) uint8 or uint16, or (H, W, 3) uint8 RGB.

    Raises:
        BadImageError: the set has no such image, its encoding is unknown, or there is too little data.
        TypeError: ``image`` is not an image.
    """
    _check_message(image, "encoding", "images.left or images.disparity.image")
    data = image.data  # protobuf copies it at each read
    if not (image.encoding or data):
        raise BadImageError("the set does not have this image: request it, as by StreamOptions(…, left=True)")
    formats = {"mono8": ("u1", 1), "mono16": ("u2", 1), "rgb8": ("u1", 3)}
    if image.encoding not in formats:
        raise BadImageError(f"the encoding {image.encoding!r} is not one of {', '.join(formats)}")
    type_code, channels = formats[image.encoding]
    dtype = np.dtype(type_code).newbyteorder(">" if image.is_bigendian else "<")
    row_bytes = image.width * channels * dtype.itemsize
    if image.step < row_bytes or len(data) < image.step * image.height:
        raise BadImageError(f"{len(data)} bytes are too few for {image.width}x{image.height} {image.encoding}")
    padded_rows = np.frombuffer(data, np.uint8, image.step * image.height).reshape(image.height, image.step)
    array = np.ascontiguousarray(padded_rows[:, :row_bytes]).view(dtype).astype(dtype.newbyteorder("="), copy=False)
    return array.reshape((image.height, image.width, 3) if channels == 3 else (image.height, image.width))


def _check_message(message: object, field: str, examples: str) -> None:
    """Raise TypeError if a message has no such field. Messages may be of classes that the user has generated."""
    if not hasattr(message, field):
        raise TypeError(f"a message such as {examples} is needed, not {describe(message)}")


def depth(disparity: pb.DisparityImage) -> NDArray[np.float32]:
    """Return the depth in metres along the optical axis, (H, W). It is +inf where the disparity is invalid.

    The depth is focal length times baseline, divided by the disparity in pixels. See ``pixels`` for errors.
    """
    _check_message(disparity, "image", "images.disparity")
    stored = pixels(disparity.image)
    disparity_pixels = stored.astype(np.float32) * disparity.scale + disparity.offset
    with np.errstate(divide="ignore"):
        metres = disparity.image.focal_length * disparity.baseline / disparity_pixels
    metres[stored == disparity.invalid_data_value] = np.inf
    return np.asarray(metres, np.float32)


class Points(NamedTuple):
    """Points of the valid pixels of a disparity image, row by row."""

    xyz: NDArray[np.float32]
    """(N, 3), metres in the left camera's optical frame: +X right, +Y down, +Z forward."""
    rgb: NDArray[np.uint8] | None
    """(N, 3), colours of the left image, grey or RGB; None if the set has no left image."""
    mask: NDArray[np.bool_]
    """(H, W), True for the pixels of the disparity image that have a point."""


def points(images: pb.ImageSet | pb.DisparityImage) -> Points:
    """Return the points that a set or a disparity image has measured. See ``pixels`` for errors."""
    is_set = hasattr(images, "disparity")
    disparity, left = (images.disparity, images.left) if is_set else (images, None)
    z = depth(disparity)
    mask = np.isfinite(z)
    rows, columns = (each.astype(np.float32) for each in np.nonzero(mask))
    K, z = intrinsics(disparity.image, opencv=True).astype(np.float32), z[mask]
    xyz = np.stack(((columns - K[0, 2]) * z / K[0, 0], (rows - K[1, 2]) * z / K[1, 1], z), axis=1)
    rgb = None if left is None or not left.data else colors_at(pixels(left), mask)
    return Points(xyz.astype(np.float32), rgb, mask)


def colors_at(image: NDArray[np.uint8], mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return the colours, (N, 3) RGB, of an image at the pixels of a mask of the same view.

    Args:
        image: (H, W) or (H, W, 3); it may be larger than the mask.
    """
    indices = (
        (2 * each + 1) * sides[0] // (2 * sides[1])
        for each, sides in zip(np.nonzero(mask), zip(image.shape, mask.shape, strict=False), strict=True)
    )
    found = image[tuple(indices)]
    return found if found.ndim == 2 else np.repeat(found[:, None], 3, axis=1)


def save(image_set: pb.ImageSet, folder: str | Path, *, exposure: bool = False, gpio: bool = False) -> None:
    """Write each image as PNG, the mesh as PLY, and an npz with all images and their parameters.

    File names are those of the vendor's client: ``image_<sec>.<nsec>_left.png``. A disparity PNG has 16 bits, in units
    of ``scale`` pixels. A parameter file is written beside it (``parameter_text``).

    Args:
        image_set: received set.
        folder: existing folder.
        exposure: add the exposure of each image to the npz (``<name>_exposure_time`` in seconds, ``_gain``
            in dB, ``_gamma``, ``_noise``, ``_out1_reduction``, ``_brightness``).
        gpio: add the GPIOs of each image to the npz (``<name>_gpio_values``, ``_gpio_outputs``, ``_gpio_inputs``), and
            their bits to the file names, as the vendor's client does.

    Raises:
        BadImageError: an image is invalid.
        OSError: a file cannot be written.
    """
    folder, file_stem = Path(folder), f"image_{timestamp_text(image_set.timestamp)}"
    arrays: dict[str, Any] = {}
    for name, image in _images(image_set).items():
        array = pixels(image)
        arrays[name] = array
        arrays[f"{name}_K"] = intrinsics(image)
        arrays[f"{name}_timestamp"] = np.int64(nanoseconds(image.timestamp))
        if exposure:
            for field in ("exposure_time", "gain", "gamma", "noise", "out1_reduction", "brightness"):
                arrays[f"{name}_{field}"] = np.float64(getattr(image, field))
        if gpio:
            for field in ("values", "outputs", "inputs"):
                arrays[f"{name}_gpio_{field}"] = np.uint32(getattr(image.gpios, field))
        write_image(folder / f"{file_stem}_{name}{_gpio_suffix(image) if gpio else ''}.png", array)
    if image_set.HasField("disparity"):
        disparity = image_set.disparity
        suffix = _gpio_suffix(disparity.image) if gpio else ""
        write_whole(folder / f"{file_stem}_disparity{suffix}_param.txt", parameter_text(disparity).encode("ascii"))
        arrays["depth"] = depth(disparity)
        arrays["baseline"], arrays["scale"] = np.float64(disparity.baseline), np.float64(disparity.scale)
    if arrays:
        file = io.BytesIO()
        np.savez(file, allow_pickle=False, **arrays)
        write_whole(folder / f"{file_stem}.npz", file.getbuffer())
    if image_set.HasField("mesh"):
        write_whole(folder / f"{file_stem}_mesh.{image_set.mesh.format}", image_set.mesh.data)


def parameter_text(disparity: pb.DisparityImage) -> str:
    """Return the content of a disparity image's parameter file, which cvkit's tools read.

    Keys and their order are those of the vendor's client. Numbers are exact float32 values, because five decimals would
    round a scale of 1/256.
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
    """Return the shortest decimal text, without exponent, that gives the same float32."""
    return np.format_float_positional(np.float32(value), trim="-")


def _gpio_suffix(image: pb.Image) -> str:
    """Return ``_<outputs>_<inputs>`` as in the vendor's file names: the state of each GPIO, highest number first."""

    def states(mask: int) -> str:
        return "".join(str(image.gpios.values >> gpio & 1) for gpio in reversed(range(32)) if mask >> gpio & 1)

    return f"_{states(image.gpios.outputs)}_{states(image.gpios.inputs)}"


def intrinsics(image: pb.Image, *, opencv: bool = False) -> NDArray[np.float64]:
    """Return the camera matrix of an image in pixels, (3, 3). See ``pixels`` for errors.

    Args:
        opencv: True: the centre of the first pixel is (0, 0), as in OpenCV and Open3D; False: it is (0.5, 0.5).
    """
    _check_message(image, "focal_length", "images.left or images.disparity.image")
    f, first = image.focal_length, 0.5 if opencv else 0.0
    u, v = image.principal_point_u - first, image.principal_point_v - first
    return np.array(((f, 0, u), (0, f, v), (0, 0, 1)), np.float64)


def preview(image_set: pb.ImageSet) -> NDArray[np.uint8]:
    """Return all images of a set side by side, (H, W, 3) uint8 RGB. Disparity and depth are mapped to colours."""
    cells = []
    for name, image in _images(image_set).items():
        array = pixels(image)
        if name in ("disparity", "depth_mm"):
            array = disparity_to_rgb(array)
        elif name == "error":  # an error of half a pixel or more is white
            array = np.minimum(array * (512.0 * (image_set.disparity.scale or 1 / 16)), 255).astype(np.uint8)
        if array.ndim == 2:
            array = np.repeat(array[:, :, None], 3, axis=2)
        factor = math.ceil(max(array.shape[1] / _MAX_PREVIEW_SIZE[0], array.shape[0] / _MAX_PREVIEW_SIZE[1], 1.0))
        cells.append(_reduced(array, factor))
    if not cells:
        return np.zeros((1, 1, 3), np.uint8)
    height = max(cell.shape[0] for cell in cells)
    columns = [np.pad(cell, ((0, height - cell.shape[0]), (0, 4), (0, 0))) for cell in cells]
    return np.concatenate(columns, axis=1)[:, :-4]


def _reduced(array: NDArray[np.uint8], factor: int) -> NDArray[np.uint8]:
    """Return an image, (H, W, 3), reduced by a factor: each pixel is the mean of a square."""
    height, width = (max(size // factor, 1) for size in array.shape[:2])
    squares = array[: height * factor, : width * factor].reshape(height, -1, width, array.shape[1] // width, 3)
    return np.asarray(squares.mean((1, 3)) + 0.5, np.uint8)


def disparity_to_rgb(disparity: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Map disparities, (H, W), to colours, (H, W, 3): near is red, far is blue, invalid is black.

    The colormap covers the middle 98 % of the values.
    """
    valid = disparity > 0
    low, high = np.percentile(disparity[valid], (1, 99)) if valid.any() else (0, 1)
    scaled = np.clip((disparity.astype(np.float32) - low) / max(high - low, 1) * 255, 0, 255).astype(np.uint8)
    colored = _TURBO[scaled].astype(np.uint8)
    colored[~valid] = 0
    return colored


def write_image(path: Path, array: NDArray[Any]) -> None:
    """Write an image, (H, W) or (H, W, 3) RGB, in the format of the file name's suffix. All but PNG need Pillow.

    Raises:
        ImportError: Pillow is not installed.
        OSError: the file cannot be written, or the suffix is unknown.
    """
    if path.suffix.lower() in ("", ".png"):
        write_whole(path, encode_png(array))
        return
    image_module = pillow()
    image_format = image_module.registered_extensions().get(path.suffix.lower())
    if image_format not in image_module.SAVE:
        raise OSError(f"cannot write {path}: {path.suffix!r} is not an image format")
    file = io.BytesIO()
    image_module.fromarray(array).save(file, image_format)
    write_whole(path, file.getbuffer())


def _images(image_set: pb.ImageSet) -> dict[str, pb.Image]:
    images = {}
    for name in ("left", "right", "disparity", "error", "confidence", "color_camera", "depth_mm"):
        field = "disparity_error" if name == "error" else name
        if image_set.HasField(field):
            message = getattr(image_set, field)
            images[name] = message.image if name == "disparity" else message
    return images
