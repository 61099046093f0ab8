"""Draws text into images with Pillow's built-in scalable font. It reads no font of the system."""

from __future__ import annotations

from functools import cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.scene.materials import Color

LINE_PIXELS: Final = 64
"""Height of a line of text in its image, pixels. It is reduced if the image would exceed ``MAX_SIDE``."""
MAX_SIDE: Final = 4096
"""Maximum width and height of an image of text, pixels."""
_MARGIN: Final = 0.15
"""Margin around the text as a fraction of a line's height."""
_MIN_LINE_PIXELS: Final = 8
"""Minimum height of a line, pixels. Text that is still too large is cut off at ``MAX_SIDE``."""


def text_image(text: str, color: Color, background: Color) -> tuple[NDArray[np.uint8], float]:
    """Return an image of text, (H, W, 4) uint8 RGBA with straight alpha, and H divided by the height of a line.

    Args:
        text: Lines of text, separated by newlines.
        color: Colour of the letters.
        background: Colour of the rectangle behind them; alpha 0: no rectangle.
    """
    from PIL import Image, ImageDraw  # slow to import, and few scenes have text

    lines = text.splitlines() or [""]
    line_pixels = float(LINE_PIXELS)
    widest = max(_font(LINE_PIXELS).getlength(line) for line in lines)
    for pixels in (widest + 2 * _MARGIN * line_pixels, (len(lines) + 2 * _MARGIN) * line_pixels):
        line_pixels = min(line_pixels, LINE_PIXELS * MAX_SIDE / pixels)
    size = max(int(line_pixels), _MIN_LINE_PIXELS)
    margin = round(_MARGIN * size)
    font = _font(size)
    width = min(round(max(font.getlength(line) for line in lines)) + 2 * margin, MAX_SIDE)
    height = min(len(lines) * size + 2 * margin, MAX_SIDE)
    letters = Image.new("L", (width, height), 0)
    draw = ImageDraw.Draw(letters)
    ascent, descent = font.getmetrics()
    for row, line in enumerate(lines):
        top = margin + row * size + 0.5 * (size - ascent - descent)
        draw.text((margin, top), line, fill=255, font=font)
    alpha = np.rint(np.asarray(letters) * np.float32(color[3])).astype(np.uint8)
    if background[3] > 0.0:
        image = Image.new("RGBA", (width, height), _uint8_channels(background))
        image.paste(_uint8_channels(color), (0, 0), Image.fromarray(alpha))
        return np.array(image), height / size
    pixels = np.empty((height, width, 4), np.uint8)
    # Transparent pixels have the colour, too: filters mix them into the letters' edges.
    pixels[:, :, :3] = _uint8_channels(color)[:3]
    pixels[:, :, 3] = alpha
    return pixels, height / size


def missing_characters(text: str) -> str:
    """Return the characters of a text that the font does not have. They appear as crossed boxes."""
    non_ascii = [char for char in dict.fromkeys(text) if char > "~"]
    if not non_ascii:
        return ""
    font = _font(LINE_PIXELS)
    missing = bytes(font.getmask("\uffff"))
    return "".join(char for char in non_ascii if bytes(font.getmask(char)) == missing)


@cache
def _font(size: int) -> Any:
    """Return Pillow's font in a size such that ascender and descender fit into a line of ``size`` pixels."""
    from PIL import ImageFont

    return ImageFont.load_default(size=0.8 * size)


def _uint8_channels(color: Color) -> tuple[int, int, int, int]:
    r, g, b, a = (round(255.0 * value) for value in color)
    return r, g, b, a
