"""Statistics of our matcher by class of pixel (``pixel_classes``), from ``matcher_statistics.json``.

``python -m bench.sensor_fit`` writes that file.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from renderers.stereo.depth.pixel_classes import CLASSES, ImageKind

FILE: Final = Path(__file__).with_suffix(".json")
COLUMNS: Final = {
    "found": "share of pixels that have a match, by class at the exact disparity",
    "right": "share of these matches within 3 disparity errors of the exact disparity",
    "confidence": "share of right pixels among all that look like a right one of the class",
    "neighbour_confidence": "the same for pixels with the disparity of the other side of an edge",
    "relative_error": "standard deviation of right matches, relative to that on good texture",
}
"""Names of the columns of a table, and their meanings."""
HIDDEN_CLASS: Final = CLASSES
"""Class of pixels without a measurable disparity, in the last row of a table. Next to a nearer surface they may get its
disparity: ``found`` is the share of those that do, ``neighbour_confidence`` the share of right ones among all with the
disparity of the front side of an edge."""


@cache
def _content() -> dict[str, Any]:
    content: dict[str, Any] = json.loads(FILE.read_text("utf-8"))
    return content


def wrong_spread() -> float:
    """Return the spread of wrong matches beyond 3 disparity errors, units of 1/16 pixel."""
    return float(_content()["wrong_spread"])


@cache
def table(kind: ImageKind) -> dict[str, NDArray[np.float64]]:
    """Return the ``COLUMNS`` of a kind of images, (``CLASSES`` + 1,) float64 each."""
    return {name: np.array(_content()[kind.name][name]) for name in COLUMNS}
