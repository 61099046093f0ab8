"""Python source of ``renderers/stereo/matcher_statistics.py`` for ``sensor_fit``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.stereo.pixel_classes import TEXTURES


@dataclass(frozen=True, slots=True)
class Tables:
    """Values of ``matcher_statistics`` for one kind of images.

    Arrays are (``CLASSES``,) float64. ``TABLES`` has their meanings, and ``source`` those of the single values.
    """

    found: NDArray[np.float64]
    right: NDArray[np.float64]
    confidence: NDArray[np.float64]
    neighbour_confidence: NDArray[np.float64]
    relative_error: NDArray[np.float64]
    matched_error: NDArray[np.float64]
    matched_right: NDArray[np.float64]
    hidden_found: float
    hidden_confidence: float


def literal(by_kind: list[NDArray[np.float64]], digits: int) -> str:
    """Return a tuple of tuples as Python source, two lines for each class of texture.

    Args:
        by_kind: values of each kind of images, (``CLASSES``,) each.
        digits: number of decimals.
    """
    lines = []
    for values in by_kind:
        rows = (", ".join(f"{value:.{digits}f}" for value in row) for row in values.reshape(2 * TEXTURES, -1))
        lines.append("    (\n" + "".join(f"        {row},\n" for row in rows) + "    ),\n")
    return "(\n" + "".join(lines) + ")"


HEAD: Final = '''"""Statistics of our matcher by class of pixel (``pixel_classes``), by ``python -m bench.sensor_fit``.

A table has one part for each ``ImageKind``; in it two lines have the classes of one texture.
"""

from __future__ import annotations

from typing import Final

# fmt: off

'''
TABLES: Final = (
    ("found", 3, "Share of pixels that have a match, by class at the exact disparity."),
    ("right", 3, "Share of these matches within 3 disparity errors of the exact disparity."),
    ("confidence", 3, "Share of right pixels among all that look like a right one of the class."),
    ("neighbour_confidence", 3, "The same for pixels with the disparity of the other side of an edge."),
    ("relative_error", 2, "Standard deviation of right matches, relative to that on good texture."),
    ("matched_error", 4, "Standard deviation of matches, pixels, by class at the match, of those below a pixel."),
    ("matched_right", 3, "Share of matches within 3 of these errors of the exact disparity."),
)
"""Attribute, digits and docstring of each table."""


def source(tables: list[Tables], wrong_spread: float, boxes: tuple[int, int, float]) -> str:
    """Return the text of ``matcher_statistics.py``.

    Args:
        tables: values in the order of ``ImageKind``.
        wrong_spread: ``WRONG_SPREAD``, units of 1/16 pixel.
        boxes: ``NEAR_BOX`` and ``WIDE_BOX``, pixels, and ``WIDE_SHARE``.
    """
    text = [HEAD]
    for name, digits, meaning in TABLES:
        values = literal([getattr(table, name) for table in tables], digits)
        text.append(f'{name.upper()}: Final[tuple[tuple[float, ...], ...]] = {values}\n"""{meaning}"""\n')
    near, wide, wide_share = boxes
    for name, value, meaning in (
        (
            "HIDDEN_FOUND",
            tuple(round(table.hidden_found, 3) for table in tables),
            "Share of hidden pixels beside a nearer surface with its disparity.",
        ),
        (
            "HIDDEN_CONFIDENCE",
            tuple(round(table.hidden_confidence, 3) for table in tables),
            "Share of right pixels among all with the disparity of the front side of an edge.",
        ),
        (
            "WRONG_SPREAD",
            round(wrong_spread, 1),
            "Spread of wrong matches beyond 3 errors, units of 1/16 pixel.",
        ),
        ("NEAR_BOX", near, "Box of the near part of the error (``smooth_noise``), pixels."),
        ("WIDE_BOX", wide, "Box of the wide part, pixels."),
        ("WIDE_SHARE", round(wide_share, 3), "Share of the wide part in the variance."),
    ):
        text.append(f'{name}: Final = {value}\n"""{meaning}"""\n')
    return "".join(text)
