"""Read a folder of recorded stereo pairs, and the camera geometry that clients write beside the images."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np

from gateway.adapters.stereo.imaging.recorded_pairs import Pair, PairSequence
from scenegate.regular_files import open_regular

_SUFFIXES: Final = (".png", ".jpg", ".jpeg", ".webp")


def find_pairs(folder: Path, max_pairs: int, max_pixels: int) -> PairSequence:
    """Return all pairs below a folder, in the order of their names.

    The right image of ``…left….png`` is ``…right….png``, in file or folder names. ``…left_out1_low….png`` is used with
    Out1 low, ``…left_out1_high….png`` with Out1 high.

    Raises:
        ValueError: there are no pairs, or more than ``max_pairs``; one sentence.
    """
    if not folder.is_dir():
        raise ValueError(f"{folder} is not a folder")
    images = sorted(path for path in folder.rglob("*") if path.suffix.lower() in _SUFFIXES and path.is_file())
    if not images:
        raise ValueError(f"{folder} holds no images ({', '.join(_SUFFIXES)})")
    existing = set(images)
    pairs = []
    for left in images:
        name = str(left.relative_to(folder))
        if "left" not in name or "out1_high" in name:
            continue
        right = folder / _right_name(name)
        if right not in existing:
            continue
        high_name = name.replace("out1_low", "out1_high")
        high_images = (folder / high_name, folder / _right_name(high_name))
        has_high = "out1_low" in name and existing.issuperset(high_images)
        pairs.append(Pair((left, right), high_images if has_high else None))
    if not pairs:
        raise ValueError(f"{folder} holds no stereo pairs: none of its {len(images)} images is a …left… with a …right…")
    if len(pairs) > max_pairs:
        raise ValueError(f"{folder} holds {len(pairs)} stereo pairs, more than {max_pairs}")
    return PairSequence(pairs, max_pixels)


def _right_name(left_name: str) -> str:
    """Return the name of the right image: the last ``left`` becomes ``right``."""
    before, _, after = left_name.rpartition("left")
    return f"{before}right{after}"


def read_geometry(folder: Path) -> tuple[float, float] | None:
    """Return the camera geometry from files below a folder; None if there are no such files.

    The files are ``*.npz`` of ``scenegate stream``, or ``*param.txt`` of the vendor's tools (``camera.A``,
    ``camera.width``, ``t``). The vendor's files describe the disparity image, whose width in quality Low is rounded.

    Returns:
        Focal length divided by the image width, and baseline in metres.

    Raises:
        ValueError: a file cannot be read; one sentence.
    """
    for path in sorted(folder.rglob("*.npz")):
        try:
            with open_regular(path) as file, np.load(file, allow_pickle=False) as arrays:
                if {"left", "left_K", "baseline"} <= set(arrays.files):
                    return float(arrays["left_K"][0, 0]) / arrays["left"].shape[1], float(arrays["baseline"])
        except (OSError, ValueError, IndexError) as error:
            raise ValueError(f"{path} cannot be read: {error}") from None
    for path in sorted(folder.rglob("*param.txt")):
        with open_regular(path) as file:
            text = file.read(10_000).decode("utf-8", "replace")
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
