"""Folders of recorded stereo pairs, and the geometry that clients write beside the images."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np

from gateway.stereo.pairs import Pair, Pairs

_SUFFIXES: Final = (".png", ".jpg", ".jpeg", ".webp")


def pairs_in(folder: Path, max_pairs: int, max_pixels: int) -> Pairs:
    """Return all pairs below a folder, in the order of their names.

    The right image of ``…left….png`` is ``…right….png``; file names and folder names count. ``…left_out1_low….png`` is
    used with Out1 low, ``…left_out1_high….png`` with Out1 high.

    Raises:
        ValueError: no pairs, or more than ``max_pairs``; one sentence.
    """
    files = sorted(path for path in folder.rglob("*") if path.suffix.lower() in _SUFFIXES and path.is_file())
    known = set(files)
    found = []
    for left in files:
        name = str(left.relative_to(folder))
        if "left" not in name or "out1_high" in name:
            continue
        low = (left, folder / _right_name(name))
        if low[1] not in known:
            continue
        high_name = name.replace("out1_low", "out1_high")
        high = (folder / high_name, folder / _right_name(high_name))
        has_high = "out1_low" in name and known.issuperset(high)
        found.append(Pair(low, high if has_high else None))
    if not folder.is_dir():
        raise ValueError(f"{folder} is no folder")
    if not files:
        raise ValueError(f"{folder} holds no images ({', '.join(_SUFFIXES)})")
    if not found:
        raise ValueError(f"{folder} holds no stereo pairs: none of its {len(files)} images is a …left… with a …right…")
    if len(found) > max_pairs:
        raise ValueError(f"{folder} holds {len(found)} stereo pairs, more than {max_pairs}")
    return Pairs(found, max_pixels)


def _right_name(left: str) -> str:
    before, _, after = left.rpartition("left")
    return f"{before}right{after}"


def geometry_in(folder: Path) -> tuple[float, float] | None:
    """Return focal length divided by image width, and baseline, from files below a folder; None: no such file.

    The files are ``*.npz`` of ``scenegate stream``, or ``*param.txt`` of the vendor's tools (``camera.A``,
    ``camera.width``, ``t``). The latter describe the disparity image, whose width at Low is rounded.

    Raises:
        ValueError: such a file cannot be read; one sentence.
    """
    for path in sorted(folder.rglob("*.npz")):
        try:
            with np.load(path, allow_pickle=False) as arrays:
                if {"left", "left_K", "baseline"} <= set(arrays.files):
                    return float(arrays["left_K"][0, 0]) / arrays["left"].shape[1], float(arrays["baseline"])
        except (OSError, ValueError, IndexError) as error:
            raise ValueError(f"{path} cannot be read: {error}") from None
    for path in sorted(folder.rglob("*param.txt")):
        text = path.read_text("utf-8", errors="replace")[:10_000]
        focal, width, baseline = (
            re.search(pattern, text, re.MULTILINE)
            for pattern in (r"^camera\.A=\[\s*([\d.eE+-]+)", r"^camera\.width=(\d+)", r"^t=([\d.eE+-]+)")
        )
        if focal and width and baseline:
            try:
                return float(focal[1]) / int(width[1]), float(baseline[1])
            except (ValueError, ZeroDivisionError):
                raise ValueError(f"{path}: camera.A, camera.width or t is not a number") from None
    return None
