"""Draws text into images."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.scene.draw.fonts import Font
from gateway.scene.tree.materials import Color

LINE_PIXELS: Final = 64
"""Height of a line of text in its image, pixels. It is reduced if the image would exceed ``MAX_SIDE``."""
MAX_SIDE: Final = 4096
"""Maximum width and height of an image of text, pixels."""
_MARGIN: Final = 0.15
"""Margin around the text as a fraction of a line's height."""
_MIN_LINE_PIXELS: Final = 8
"""Minimum height of a line, pixels. Text that is still too large is cut off at ``MAX_SIDE``."""


def text_image(text: str, font: Font, color: Color, background: Color) -> tuple[NDArray[np.uint8], float]:
    """Return an image of lines of text, (H, W, 4) with straight alpha, and H divided by the height of a line.

    ``background``: colour of the rectangle behind the letters; alpha 0: no rectangle.
    """
    from PIL import Image  # slow to import, and few scenes have text

    lines = text.splitlines() or [""]
    line_pixels = float(LINE_PIXELS)
    widest = max(font.width(line, LINE_PIXELS) for line in lines)
    for extent in (widest + 2 * _MARGIN * line_pixels, (len(lines) + 2 * _MARGIN) * line_pixels):
        line_pixels = min(line_pixels, LINE_PIXELS * MAX_SIDE / extent)
    size = max(int(line_pixels), _MIN_LINE_PIXELS)
    margin = round(_MARGIN * size)
    width = min(round(max(font.width(line, size) for line in lines)) + 2 * margin, MAX_SIDE)
    height = min(len(lines) * size + 2 * margin, MAX_SIDE)
    letters = np.zeros((height, width), np.uint8)
    font.draw(lines, letters, margin, size)
    alpha = np.rint(letters * np.float32(color[3])).astype(np.uint8)
    if background[3] > 0.0:
        image = Image.new("RGBA", (width, height), _uint8_channels(background))
        image.paste(_uint8_channels(color), (0, 0), Image.fromarray(alpha))
        return np.array(image), height / size
    pixels = np.empty((height, width, 4), np.uint8)
    # Transparent pixels have the colour, too: filters mix them into the letters' edges.
    pixels[:, :, :3] = _uint8_channels(color)[:3]
    pixels[:, :, 3] = alpha
    return pixels, height / size


def _uint8_channels(color: Color) -> tuple[int, int, int, int]:
    r, g, b, a = (round(255.0 * value) for value in color)
    return r, g, b, a
