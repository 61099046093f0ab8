"""A contact sheet: samples of a dataset with their overlays in one image."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

from PIL import Image, ImageDraw, ImageFont

from gateway.datasets.show.overlay import Layer, draw_sample, printable
from gateway.datasets.show.summary import random_samples
from scenegate.datasets import Dataset

COLUMNS: Final = 4
CELL_WIDTH: Final = 320
"""Width of an image in pixels."""
GAP: Final = 8
"""Pixels between images."""
CAPTION_HEIGHT: Final = 20
GROUND: Final = (243, 244, 246)
TEXT: Final = (27, 33, 48)


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
    columns = min(COLUMNS, count)
    images = [draw_sample(sample, classes, layers, CELL_WIDTH) for sample in chosen]
    row_height = max(image.height for image in images) + CAPTION_HEIGHT + GAP
    rows = -(-count // columns)
    sheet = Image.new("RGB", (columns * (CELL_WIDTH + GAP) + GAP, rows * row_height + GAP), GROUND)
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(13)
    for k, (sample, image) in enumerate(zip(chosen, images, strict=True)):
        x, y = GAP + k % columns * (CELL_WIDTH + GAP), GAP + k // columns * row_height
        sheet.paste(image, (x, y))
        draw.text((x, y + image.height + 2), printable(sample.id[-48:]), TEXT, font)
    return sheet
