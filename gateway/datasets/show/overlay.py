"""Draw samples: one of their images, and over it masks, boxes and poses of objects; and contact sheets of samples."""

from __future__ import annotations

import colorsys
from collections.abc import Collection
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from gateway.datasets.show.summary import random_samples
from scenegate.datasets import NO_LABEL, Dataset, Sample
from scenegate.datasets.boxes import EDGES, box_corners
from scenegate.datasets.manifest import ImageType, ObjectRecord

Layer = Literal["masks", "boxes", "poses"]
LAYERS: Final[tuple[Layer, ...]] = get_args(Layer)
Color = tuple[int, int, int]

SHOWN_TYPES: Final[tuple[ImageType, ...]] = (
    "color", "stereo", "albedo", "normal", "depth", "measured", "instance", "class", "label",
)  # fmt: skip
"""Types of images that can be drawn."""
OVERSAMPLING: Final = 2
"""Lines are drawn larger by this factor, and then reduced: Pillow draws them without anti-aliasing."""
LINE_WIDTH: Final = 1.5
MIN_TEXT_HEIGHT, MAX_TEXT_HEIGHT = 9, 13
"""Sizes of the text in pixels of the result."""
MAX_LABEL_CHARS: Final = 40
NARROW: Final = 480
"""Width of images in pixels below which labels are names only."""
MASK_OPACITY: Final = 0.45
AXIS_COLORS: Final[tuple[Color, ...]] = ((232, 65, 65), (70, 190, 70), (70, 120, 255))
"""Colours of the x, y and z axis."""
AXIS_LENGTH: Final = 0.8
"""Length of the axes as a share of the side of a cube with the volume of the object's box."""
NEAREST: Final = 1e-3
"""Metres along the optical axis at which lines are cut off."""
SHEET_COLUMNS: Final = 4
CELL_WIDTH: Final = 320
"""Width of an image in a contact sheet, pixels."""
CELL_GAP: Final = 8
"""Pixels between images of a contact sheet."""
CAPTION_HEIGHT: Final = 20
SHEET_COLOR: Final = (243, 244, 246)
"""Colour between the images of a contact sheet."""
CAPTION_COLOR: Final = (27, 33, 48)
_GOLDEN_ANGLE: Final = 0.381966
"""Turn between the hues of two successive classes, so that any number of them differ."""


def class_color(class_id: int) -> Color:
    """Return the RGB colour in which objects of a class are drawn."""
    red, green, blue = colorsys.hsv_to_rgb(class_id * _GOLDEN_ANGLE % 1.0, 0.65, 0.95)
    return round(255 * red), round(255 * green), round(255 * blue)


def draw_sample(
    sample: Sample, classes: dict[int, str], layers: Collection[Layer], width: int, image_type: ImageType | None = None
) -> Image.Image:
    """Return an image of a sample in RGB.

    Args:
        classes: names of the classes by their number.
        width: width of the result in pixels.
        image_type: one of ``SHOWN_TYPES``; None: the first one that the sample has.

    Raises:
        RecordError: an image cannot be read.
    """
    pixels = _pixels(sample, next(iter(shown_types(sample)), "color") if image_type is None else image_type)
    if "masks" in layers and "instance" in sample.record.images:
        pixels = _with_masks(pixels, sample)
    height = max(1, round(width * pixels.shape[0] / pixels.shape[1]))
    canvas = Image.fromarray(pixels).resize((width * OVERSAMPLING, height * OVERSAMPLING), Image.Resampling.BILINEAR)
    draw = ImageDraw.Draw(canvas)
    scale = canvas.width / sample.record.camera.width
    nearest_last = sorted(sample.objects, key=lambda record: -record.X_camera_object[2][3])
    for record in nearest_last if "poses" in layers else ():
        _draw_pose(draw, sample, record, scale)
    for record in nearest_last if "boxes" in layers else ():
        _draw_boxes(draw, record, classes.get(record.class_id, str(record.class_id)), scale)
    return canvas.reduce(OVERSAMPLING)


def contact_sheet(dataset: Dataset, count: int, layers: Collection[Layer]) -> Image.Image:
    """Return an image of up to ``count`` samples, with their names.

    Raises:
        RecordError: a sample cannot be read.
        ValueError: the dataset has no samples.
    """
    count = min(count, len(dataset))
    if count < 1:
        raise ValueError(f"{dataset.folder} has no samples")
    chosen = [dataset[index] for index in random_samples(dataset, count)]
    classes = dict(dataset.classes)
    columns = min(SHEET_COLUMNS, count)
    images = [draw_sample(sample, classes, layers, CELL_WIDTH) for sample in chosen]
    row_height = max(image.height for image in images) + CAPTION_HEIGHT + CELL_GAP
    rows = -(-count // columns)
    sheet = Image.new("RGB", (columns * (CELL_WIDTH + CELL_GAP) + CELL_GAP, rows * row_height + CELL_GAP), SHEET_COLOR)
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(13)
    for k, (sample, image) in enumerate(zip(chosen, images, strict=True)):
        x, y = CELL_GAP + k % columns * (CELL_WIDTH + CELL_GAP), CELL_GAP + k // columns * row_height
        sheet.paste(image, (x, y))
        draw.text((x, y + image.height + 2), printable(sample.id[-48:]), CAPTION_COLOR, font)
    return sheet


def shown_types(sample: Sample) -> list[ImageType]:
    """Return the types of images of a sample that can be drawn."""
    return [name for name in SHOWN_TYPES if name in sample.record.images]


def printable(text: str) -> str:
    """Return a text with "?" for the characters that cannot be drawn, such as line breaks."""
    return "".join(char if char.isprintable() else "?" for char in text)


def _pixels(sample: Sample, image_type: ImageType) -> NDArray[np.uint8]:
    """Return an image in RGB, (H, W, 3)."""
    if image_type in ("depth", "measured"):
        depth = sample.image(image_type)
        seen = np.isfinite(depth)
        near, far = (depth[seen].min(), depth[seen].max()) if seen.any() else (0.0, 1.0)
        shade = np.where(seen, 230.0 - 200.0 * (np.where(seen, depth, near) - near) / max(far - near, 1e-6), 0.0)
        return np.repeat(shade.astype(np.uint8)[..., None], 3, axis=2)
    if image_type == "normal":
        return (127.5 + 127.5 * sample.normal).astype(np.uint8)
    if image_type in ("instance", "class", "label"):
        return _colored(sample.image(image_type))
    pixels: NDArray[np.uint8] = sample.image(image_type)
    return pixels


def _colored(numbers: NDArray[np.unsignedinteger]) -> NDArray[np.uint8]:
    """Return an image with a colour for each number; 0 and ``NO_LABEL`` are black."""
    values, inverse = np.unique(numbers, return_inverse=True)
    colors = [(0, 0, 0) if value in (0, NO_LABEL) else class_color(int(value)) for value in values]
    pixels: NDArray[np.uint8] = np.array(colors, np.uint8)[inverse.reshape(numbers.shape)]
    return pixels


def _with_masks(pixels: NDArray[np.uint8], sample: Sample) -> NDArray[np.uint8]:
    """Return an image with the visible pixels of the objects in the colours of their classes, and white edges."""
    instances = sample.instance
    colors = np.zeros((int(instances.max()) + 1, 3), np.float32)
    opacity = np.zeros((len(colors), 1), np.float32)
    for record in sample.objects:
        if 0 < record.instance < len(colors):
            colors[record.instance], opacity[record.instance] = class_color(record.class_id), MASK_OPACITY
    mixed = pixels * (1.0 - opacity[instances]) + colors[instances] * opacity[instances]
    edge = np.zeros(instances.shape, bool)
    edge[:, 1:] |= instances[:, 1:] != instances[:, :-1]
    edge[1:] |= instances[1:] != instances[:-1]
    mixed[edge] = 255.0
    return np.asarray(mixed, np.uint8)


def _draw_boxes(draw: ImageDraw.ImageDraw, record: ObjectRecord, name: str, scale: float) -> None:
    """Draw the boxes of the visible pixels and of the silhouette, with class and visibility."""
    color = class_color(record.class_id)
    for box, line_width in ((record.box_amodal, 1), (record.box_visible, round(LINE_WIDTH * OVERSAMPLING))):
        if box is not None:
            x, y, width, height = box
            limit = 2 * max(draw.im.size)  # Pillow draws pixels outside of the image, too
            corners = (
                min(max(value * scale, -limit), limit) for value in (x, y, x + max(width, 0), y + max(height, 0))
            )
            draw.rectangle(tuple(corners), outline=color, width=line_width)
    if record.box_visible is None:
        return
    name = printable(name[:MAX_LABEL_CHARS])
    text = name if draw.im.size[0] < NARROW * OVERSAMPLING else f"{name} {record.visible_fraction:.0%}"
    size = min(MAX_TEXT_HEIGHT, max(MIN_TEXT_HEIGHT, draw.im.size[0] // (60 * OVERSAMPLING))) * OVERSAMPLING
    font = ImageFont.load_default(size)
    text_width = draw.textlength(text, font) + 8
    if record.box_visible[2] * scale < text_width / 2:  # many small objects would be hidden by their labels
        return
    left, top = record.box_visible[0] * scale, max(0.0, record.box_visible[1] * scale - 1.3 * size)
    if not (0.0 <= left < draw.im.size[0] and top < draw.im.size[1]):
        return
    draw.rectangle((left, top, left + text_width, top + 1.3 * size), color)
    draw.text((left + 4, top), text, (20, 24, 32), font)


def _draw_pose(draw: ImageDraw.ImageDraw, sample: Sample, record: ObjectRecord, scale: float) -> None:
    """Draw the 3D box of an object, and the axes of its frame."""
    low, high = np.array(record.box_3d)
    X = np.array(record.X_camera_object)
    corners = box_corners(record.box_3d) @ X[:3, :3].T + X[:3, 3]
    for i, k in EDGES:
        _draw_line(draw, sample.K * scale, corners[i], corners[k], class_color(record.class_id), 1.0)
    length = AXIS_LENGTH * float(np.cbrt(np.prod(np.maximum(high - low, 1e-3 * (high - low).max()))))
    for axis, color in enumerate(AXIS_COLORS):
        _draw_line(draw, sample.K * scale, X[:3, 3], X[:3, 3] + length * X[:3, axis], color, 2.0)


def _draw_line(
    draw: ImageDraw.ImageDraw,
    K: NDArray[np.float64],
    begin: NDArray[np.float64],
    end: NDArray[np.float64],
    color: Color,
    width: float,
) -> None:
    """Draw a line between two points in the optical frame; what is behind the camera is cut off."""
    if begin[2] > end[2]:
        begin, end = end, begin
    if end[2] <= NEAREST:
        return
    if begin[2] < NEAREST:
        begin = begin + (end - begin) * (NEAREST - begin[2]) / (end[2] - begin[2])
    limit = 4.0 * max(draw.im.size)  # Pillow draws each pixel of a line, in the image or not
    (u0, v0), (u1, v1) = ((K @ point)[:2] / point[2] for point in (begin, end))
    if max(abs(u0), abs(v0), abs(u1), abs(v1)) < limit:
        draw.line((u0, v0, u1, v1), fill=color, width=round(width * LINE_WIDTH * OVERSAMPLING))
