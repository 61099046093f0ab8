"""Procedural textures of the demo scene."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderers.drawlist import Image


def _image(name: str, rgb: NDArray[np.floating]) -> Image:
    """Return an opaque image of sRGB values from 0 to 1, (H, W, 3)."""
    pixels = np.full((*rgb.shape[:2], 4), 255, np.uint8)
    pixels[:, :, :3] = np.clip(rgb * 255.0 + 0.5, 0.0, 255.0).astype(np.uint8)
    pixels.flags.writeable = False
    return Image(f"scenegate demo {name}".encode(), lambda: pixels)


def checker() -> Image:
    """Return a checkerboard with dark seams."""
    y, x = np.mgrid[0:128, 0:128]
    dark = ((x // 64 + y // 64) % 2).astype(float)
    seam = np.minimum(np.minimum(x % 64, y % 64), 3) / 3.0
    grey = (0.97 - 0.17 * dark) * (0.9 + 0.1 * seam)
    return _image("floor", grey[:, :, None] * np.array((0.98, 0.99, 1.0)))


def wood() -> Image:
    """Return wooden planks with grain."""
    y, x = np.mgrid[0:256, 0:512] / 256.0
    rings = 18.0 * np.hypot(0.35 * (y - 0.4), 0.04 * (x + 3.0)) + 0.8 * np.sin(3.0 * x + 2.0 * np.sin(5.0 * y))
    grain = 0.5 + 0.5 * np.sin(2.0 * np.pi * rings)
    fibre = np.random.default_rng(7).uniform(-1.0, 1.0, (256, 1)) * 0.03
    plank = np.where((y * 4.0) % 1.0 < 0.02, 0.75, 1.0)
    tone = (1.0 - 0.16 * grain + fibre) * plank
    return _image("wood", tone[:, :, None] * np.array((1.0, 0.83, 0.62)))


def target() -> Image:
    """Return a calibration target: circles, a wedge and a frame, which show orientation and filtering."""
    y, x = np.mgrid[0:128, 0:128] / 127.0 * 2.0 - 1.0
    radius = np.hypot(x, y)
    circles = np.sin(18.0 * radius) > 0.0
    wedge = (np.abs(y) < x) & (radius < 0.85)
    color = np.where(circles[:, :, None], np.array((0.97, 0.96, 0.92)), np.array((0.16, 0.20, 0.36)))
    color = np.where(wedge[:, :, None], color * np.array((1.0, 0.55, 0.25)), color)
    frame = np.maximum(np.abs(x), np.abs(y)) > 0.92
    return _image("target", np.where(frame[:, :, None], np.array((0.85, 0.2, 0.25)), color))


def stripes() -> Image:
    """Return blue and white stripes."""
    y, x = np.mgrid[0:64, 0:128] / 64.0
    band = (np.floor(x * 4.0) % 2 == 0) ^ (np.abs(y - 0.5) < 0.12)
    return _image("ball", np.where(band[:, :, None], np.array((0.95, 0.95, 0.98)), np.array((0.10, 0.45, 0.85))))
