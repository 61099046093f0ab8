"""Recorded or user-made stereo pairs instead of a scene: where they come from, and the studio that shows them."""

from __future__ import annotations

import re
import threading
from collections import OrderedDict
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.stereo.images import Metered, Shot, Studio, Wanted
from gateway.stereo.settings import StreamSettings
from renderers.drawlist import ImageError
from renderers.images import decode_image
from renderers.interface import Frame, Output
from renderers.stereo.model import StereoModel
from renderers.stereo.sensor import Taken

MODEL_NAME: Final = "rc_test"
"""What the device calls itself while it shows images that were given to it."""
FACTOR_LIMIT: Final = 20.0
"""A focal length below is a factor of the image width, else pixels."""
_CACHED: Final = 8
"""Decoded images that are kept: a pair with Out1 low and high, and the next one."""
_SUFFIXES: Final = (".png", ".jpg", ".jpeg", ".webp")

Source = Path | bytes


@dataclass(frozen=True, slots=True)
class Pair:
    """Encoded images (PNG, JPEG, WebP) of both cameras, rectified."""

    low: tuple[Source, Source]
    """Left and right with Out1 low."""
    high: tuple[Source, Source] | None = None
    """… with Out1 high; None: the same."""


class Pairs:
    """A sequence of pairs that starts again at its end. Safe in any thread."""

    def __init__(self, pairs: list[Pair], max_pixels: int) -> None:
        """
        Args:
            max_pixels: of one image.
        """
        self._pairs = pairs
        self._max_pixels = max_pixels
        self._lock = threading.Lock()
        self._decoded: OrderedDict[tuple[int, bool, bool], NDArray[np.uint8]] = OrderedDict()
        self.size: tuple[int, int] | None = None
        """Width and height that every image must have; None: not known yet."""

    def __len__(self) -> int:
        return len(self._pairs)

    def picture(self, index: int, *, high: bool, right: bool) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 RGB.

        Raises:
            ImageError: it cannot be read or decoded, or is of another size than the first.
        """
        number = index % len(self._pairs)
        key = (number, high, right)
        with self._lock:
            found = self._decoded.get(key)
        if found is not None:
            return found
        pair = self._pairs[number]
        source = (pair.high if high and pair.high is not None else pair.low)[right]
        name = f"the {'right' if right else 'left'} image of pair {number + 1}"
        if isinstance(source, Path):
            name = str(source)
            try:
                source = source.read_bytes()
            except OSError as error:
                raise ImageError(f"{name}: {error.strerror}") from error
        image = np.ascontiguousarray(decode_image(source, name=name, max_pixels=self._max_pixels)[:, :, :3])
        size = (image.shape[1], image.shape[0])
        with self._lock:
            self.size = self.size or size
            if size != self.size:
                raise ImageError(f"{name} has {size[0]}x{size[1]} pixels, the first one {self.size[0]}x{self.size[1]}")
            self._decoded[key] = image
            while len(self._decoded) > _CACHED:
                self._decoded.popitem(last=False)
        return image


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PairStudio(Studio):
    """Shows pairs as they are: exposure, noise and projector are those of whoever took them. Depth is matched."""

    pairs: Pairs

    def render(self, shot: Shot, offset: float, divisor: int, outputs: Output) -> Frame:
        """There is no scene.

        Raises:
            LookupError: always.
        """
        raise LookupError("the camera shows images that were given to it; nobody knows what is really there")

    def meter(self, shot: Shot, settings: StreamSettings) -> Metered:
        left = self.pairs.picture(shot.index, high=bool(shot.lines & 1), right=False)
        return Metered(settings.manual, float(cv2.cvtColor(left, cv2.COLOR_RGB2GRAY).mean()) / 255.0)

    def take(self, shot: Shot, wanted: Wanted) -> dict[bool, Taken]:
        picture = self.pairs.picture(shot.index, high=bool(shot.lines & 1), right=wanted.stream.right)
        k = self.config.model.intrinsics(wanted.divisor)
        if wanted.divisor > 1:
            picture = _reduced(picture, wanted.divisor, k.width, k.height)
        made = {}
        for color in wanted.colors:
            image = picture if color else np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), np.uint8)
            made[color] = Taken(np.ascontiguousarray(image), float(image.mean()) / 255.0)
        return made


def _reduced(picture: NDArray[np.uint8], divisor: int, width: int, height: int) -> NDArray[np.uint8]:
    """Means over whole pixels, the last column and row repeated where they are partly outside."""
    right, below = width * divisor - picture.shape[1], height * divisor - picture.shape[0]
    if right or below:
        picture = np.asarray(cv2.copyMakeBorder(picture, 0, below, 0, right, cv2.BORDER_REPLICATE), np.uint8)
    return np.asarray(cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def pair_studio(studio: Studio, pairs: Pairs, focal: float, baseline: float) -> PairStudio:
    """A studio that shows pairs in the place of another's scene. Decodes the first pair; call it in a thread.

    Args:
        focal: focal length in pixels, or divided by the image width when below ``FACTOR_LIMIT``.
        baseline: metres.

    Raises:
        ImageError: an image of the first pair cannot be decoded.
        ValueError: size, focal length or baseline are beyond the limits of a stereo camera.
    """
    picture = pairs.picture(0, high=False, right=False)
    for high, right in ((False, True), (True, False), (True, True)):
        pairs.picture(0, high=high, right=right)
    height, width = picture.shape[:2]
    factor = focal if focal < FACTOR_LIMIT else focal / width
    model = StereoModel(MODEL_NAME, width, height, factor, baseline)
    config = replace(studio.config, model=model, depth_mode="matched")
    return PairStudio(config=config, renderer=studio.renderer, pairs=pairs)


def pairs_in(folder: Path, max_pairs: int, max_pixels: int) -> Pairs:
    """All pairs below a folder, by name: the right image of ``…left….png`` is ``…right….png``, be it the file's name or
    its folder's. ``…left_out1_low….png`` is used with Out1 low, ``…left_out1_high….png`` with Out1 high.

    Raises:
        ValueError: there is none, or more than ``max_pairs``; one sentence.
    """
    files = sorted(path for path in folder.rglob("*") if path.suffix.lower() in _SUFFIXES and path.is_file())
    known = set(files)
    found = []
    for left in files:
        name = str(left.relative_to(folder))
        if "left" not in name or "out1_high" in name:
            continue
        right = folder / _right_of(name)
        if right not in known:
            continue
        high = (
            folder / name.replace("out1_low", "out1_high"),
            folder / _right_of(name).replace("out1_low", "out1_high"),
        )
        lit = "out1_low" in name and all(path in known for path in high)
        found.append(Pair((left, right), high if lit else None))
    if not folder.is_dir():
        raise ValueError(f"{folder} is no folder")
    if not files:
        raise ValueError(f"{folder} holds no pictures ({', '.join(_SUFFIXES)})")
    if not found:
        raise ValueError(
            f"{folder} holds no stereo pairs: none of its {len(files)} pictures is a …left… with a …right…"
        )
    if len(found) > max_pairs:
        raise ValueError(f"{folder} holds {len(found)} stereo pairs, more than {max_pairs}")
    return Pairs(found, max_pixels)


def _right_of(name: str) -> str:
    before, _, after = name.rpartition("left")
    return f"{before}right{after}"


def geometry_in(folder: Path) -> tuple[float, float] | None:
    """Focal length divided by image width, and baseline, from what clients write beside the images; None: nothing.

    ``*.npz`` of ``scenegate stream``, or ``*param.txt`` of the vendor's tools (``camera.A``, ``camera.width``, ``t``);
    the latter is of the disparity image, whose width at Low is rounded.

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
