"""From pictures to messages of the protocol document."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gateway.generated import image_interface_pb2 as pb
from gateway.stereo import wire
from gateway.stereo.wire import Chunk
from renderers.stereo.model import DISPARITY_SCALE, Intrinsics

OUTPUT_MASK = 0b0011
"""Out1 and Out2 in the bit order of the GPIOs."""
INPUT_MASK = 0b1100
"""In1 and In2."""
NANOSECONDS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Taking:
    """How and when an image was taken."""

    timestamp: int
    """Nanoseconds since the epoch: the middle of the exposure."""
    exposure_time: float
    """Seconds."""
    gain: float
    """dB"""
    gamma: float
    noise: float
    """Standard deviation, grey levels."""
    lines: int
    """Values of the GPIO lines; see ``OUTPUT_MASK``."""
    out1_reduction: float = 0.0
    """Share by which images with Out1 low are exposed less, 0 to 1."""


def timestamp_field(nanoseconds: int) -> bytes:
    """Field 1 of a set, a disparity image or a mesh."""
    return b"".join(wire.field(1, [time_of(nanoseconds).SerializeToString()]))


def image(
    pixels: NDArray[np.uint8] | NDArray[np.uint16], k: Intrinsics, taking: Taking, brightness: float
) -> list[Chunk]:
    """An ``Image``; the array is referred to, not copied.

    Args:
        pixels: (H, W) uint8: mono8, (H, W) uint16: mono16, (H, W, 3) uint8: rgb8. Rows without padding.
        k: intrinsics of this image.
        taking: see there.
        brightness: mean of the image, 0 to 1; rounded to 0.01 as on the device.
    """
    height, width = pixels.shape[:2]
    if pixels.dtype == np.uint16:
        encoding, step = "mono16", 2 * width
        pixels = np.ascontiguousarray(pixels, "<u2")
    else:
        channels = pixels.shape[2] if pixels.ndim == 3 else 1
        encoding, step = ("rgb8" if channels == 3 else "mono8"), channels * width
    header = pb.Image(
        timestamp=time_of(taking.timestamp),
        height=height,
        width=width,
        focal_length=k.focal_length,
        principal_point_u=k.cx,
        principal_point_v=k.cy,
        encoding=encoding,
        is_bigendian=False,
        step=step,
        gpios=pb.Gpios(inputs=INPUT_MASK, outputs=OUTPUT_MASK, values=taking.lines),
        exposure_time=taking.exposure_time,
        gain=taking.gain,
        noise=taking.noise,
        out1_reduction=taking.out1_reduction,
        brightness=round(brightness, 2),
        gamma=taking.gamma,
        auto_exposure_adapting=False,
    )
    data: Any = np.ascontiguousarray(pixels).reshape(-1).view(np.uint8).data
    return [header.SerializeToString(), *wire.field(10, [data])]


def disparity(picture: list[Chunk], timestamp: int, baseline: float, scale: float = DISPARITY_SCALE) -> list[Chunk]:
    """A ``DisparityImage`` around its image.

    Args:
        baseline: metres.
        scale: pixels per unit of the disparity image and of the error image.
    """
    header = pb.DisparityImage(
        timestamp=time_of(timestamp),
        scale=scale,
        offset=0.0,
        invalid_data_value=0.0,
        baseline=baseline,
        delta_d=DISPARITY_SCALE,
    )
    return [header.SerializeToString(), *wire.field(7, picture)]


def mesh(ply: tuple[Chunk, ...], timestamp: int) -> list[Chunk]:
    """A ``Mesh``."""
    header = pb.Mesh(timestamp=time_of(timestamp), format="ply")
    return [header.SerializeToString(), *wire.field(3, list(ply))]


def time_of(nanoseconds: int) -> pb.Time:
    """A timestamp as the protocol has it."""
    sec, nsec = divmod(nanoseconds, NANOSECONDS)
    return pb.Time(sec=sec, nsec=nsec)
