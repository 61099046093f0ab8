"""Text in images, and its fonts: one of Pillow, one of OpenCV with most scripts, and those of this machine.

Text is drawn in one font, the first that has all its characters. Only scripts that neither Pillow's nor OpenCV's font
has, such as Thai, Devanagari and those that run from right to left, depend on the fonts of the machine.
"""

import shutil
import subprocess
import threading
import unicodedata
from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Any, Final, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.scene.tree.materials import Color

BLOCK_BITS: Final = 7
"""The font for 2 to the power of this many neighbouring characters is looked up once."""
LOOKUP_SECONDS: Final = 5.0
"""Maximum time of a lookup."""
_lock: Final = threading.Lock()
"""Held while OpenCV draws: a font's state is not thread-safe."""


class Font(Protocol):
    """A scalable font for one text."""

    missing: str
    """Characters of the text that the font does not have. They appear as boxes."""

    def width(self, line: str, size: int) -> float:
        """Return the width of a line, pixels, if ``size`` is from the deepest descender to the highest ascender."""

    def draw(self, lines: Sequence[str], letters: NDArray[np.uint8], margin: int, size: int) -> None:
        """Draw lines below each other into an empty image of coverage, (H, W) uint8. Their height is ``size``."""


def font_for(text: str) -> Font:
    """Return the first font that has all characters of a text, or else the one that lacks the fewest."""
    font: Font = PillowFont(text)
    if font.missing and hasattr(cv2, "FontFace"):  # OpenCV 5
        font = min(font, OpenCVFont(text), key=lambda each: len(each.missing))
    if font.missing and (file := _machine_font(font.missing[0])):
        font = min(font, PillowFont(text, file), key=lambda each: len(each.missing))
    return font


class PillowFont:
    """A font that Pillow reads, from a file or, without one, from itself; the latter has ASCII and a few symbols."""

    def __init__(self, text: str, file: str = "") -> None:
        self._file = file
        font = _pillow_font(file, 16)
        absent = bytes(font.getmask("\uffff"))
        self.missing = "".join(
            char for char in dict.fromkeys(text) if not char.isspace() and bytes(font.getmask(char)) == absent
        )

    def width(self, line: str, size: int) -> float:
        width: float = _pillow_font(self._file, size).getlength(line)
        return width

    def draw(self, lines: Sequence[str], letters: NDArray[np.uint8], margin: int, size: int) -> None:
        from PIL import Image, ImageDraw

        font = _pillow_font(self._file, size)
        image = Image.new("L", letters.shape[::-1], 0)
        draw = ImageDraw.Draw(image)
        ascent, descent = font.getmetrics()
        top = margin + 0.5 * (size - ascent - descent)
        for row, line in enumerate(lines):
            draw.text((margin, top + row * size), line, fill=255, font=font)
        letters[:] = np.asarray(image)


class OpenCVFont:
    """OpenCV's built-in font: Latin, Greek, Cyrillic, Chinese, Japanese, Korean. It draws from left to right only."""

    def __init__(self, text: str) -> None:
        question_mark = _opencv_letter("?")
        self.missing = "".join(
            char
            for char in dict.fromkeys(text)
            if unicodedata.bidirectional(char) in ("R", "AL", "AN")
            or (char != "?" and np.array_equal(_opencv_letter(char), question_mark))
        )
        self._boxes = dict.fromkeys(map(ord, self.missing), "□")

    def width(self, line: str, size: int) -> float:
        with _lock:
            rectangle = cv2.getTextSize((0, 0), line.translate(self._boxes), (0, 0), _opencv_font(), _opencv_size(size))
        return float(rectangle[0] + rectangle[2])

    def draw(self, lines: Sequence[str], letters: NDArray[np.uint8], margin: int, size: int) -> None:
        letter_size = _opencv_size(size)
        for row, line in enumerate(lines):
            baseline = margin + row * size + letter_size
            with _lock:
                cv2.putText(letters, line.translate(self._boxes), (margin, baseline), 255, _opencv_font(), letter_size)


def _opencv_letter(char: str) -> NDArray[np.uint8]:
    """Return an image of a character; of a question mark if OpenCV's font does not have it."""
    pixels = np.zeros((24, 24), np.uint8)
    with _lock:
        cv2.putText(pixels, char, (2, 18), 255, _opencv_font(), 16)
    return pixels


def _opencv_size(size: int) -> int:
    """Return OpenCV's size for a height from descender to ascender: it is the distance from baseline to ascender."""
    return round(0.8 * size)


@cache
def _opencv_font() -> Any:
    return cv2.FontFace("uni")


@lru_cache(maxsize=64)
def _pillow_font(file: str, size: int) -> Any:
    """Return a font whose ascender and descender fit into a line of ``size`` pixels."""
    from PIL import ImageFont  # slow to import, and few scenes have text

    return ImageFont.truetype(file, 0.8 * size) if file else ImageFont.load_default(size=0.8 * size)


_machine_fonts: Final[dict[int, str]] = {}
"""File of a font of this machine for each block of characters that was looked up; empty: there is none."""


def _machine_font(char: str) -> str:
    """Return the file of a font of this machine that fontconfig recommends for a character; empty: there is none."""
    block = ord(char) >> BLOCK_BITS
    if block not in _machine_fonts:
        _machine_fonts[block] = _find_machine_font(char)
    return _machine_fonts[block]


def _find_machine_font(char: str) -> str:
    fc_match = shutil.which("fc-match")
    if fc_match is None:
        return ""
    command = [fc_match, "--format=%{file}", f":charset={ord(char):x}"]
    try:
        file = subprocess.run(command, capture_output=True, timeout=LOOKUP_SECONDS, check=True, text=True).stdout  # noqa: S603 - the path is of fc-match
        return "" if PillowFont(char, file).missing else file
    except (OSError, subprocess.SubprocessError):  # such as a font of colour bitmaps, which have fixed sizes
        return ""


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
