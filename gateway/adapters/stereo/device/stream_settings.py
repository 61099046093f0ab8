"""Values of the parameters that affect the stream, as one immutable object per frame."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.parameter_specs import DeviceLimits, Value
from gateway.adapters.stereo.device.parameters import Parameters
from renderers.stereo.depth.filters import Filters
from renderers.stereo.model import Quality
from renderers.stereo.sensor.exposure import AutoExposure, Exposure

ALTERNATE_GAP_NS = 40_000_000
"""Nanoseconds between exposures with Out1 low and high (manual)."""
STATIC_IMAGES: Final = 8
"""Number of images that ``static_scene`` averages (manual)."""
HDR_IMAGES: Final = 3
"""Number of exposures of a high dynamic range image; divides the rate of camera images."""
NEUTRAL_RED: Final = 1.2
"""White balance ratio at which colours are as rendered: the device's default and the result of automatic white
balance."""
NEUTRAL_BLUE: Final = 2.4
"""See ``NEUTRAL_RED``."""


@dataclass(frozen=True, slots=True)
class Region:
    """Rectangle in the left image at full resolution, pixels."""

    x: int
    """Left column."""
    y: int
    """Upper row."""
    width: int
    height: int

    def slices(self, divisor: int) -> tuple[slice, slice]:
        """Return the rows and columns, at 1/``divisor`` of the resolution, that lie at least partly in the region."""
        rows = slice(self.y // divisor, -(-(self.y + self.height) // divisor))
        return rows, slice(self.x // divisor, -(-(self.x + self.width) // divisor))

    def clear_outside(self, image: NDArray[Any], divisor: int) -> None:
        """Set the pixels of an image at 1/``divisor`` of the resolution to 0 outside of the region."""
        outside = np.ones(image.shape, np.bool_)
        outside[self.slices(divisor)] = False
        image[outside] = 0


@dataclass(frozen=True)
class StreamSettings:
    """Values of all parameters at one time."""

    limits: DeviceLimits
    """Limits of the camera."""
    fps: float
    """Camera images per second."""
    auto_exposure: AutoExposure | None
    """Limits of automatic exposure; None: manual exposure."""
    manual_exposure: Exposure
    """Manual exposure. Gamma, dynamic range and white balance apply in automatic mode, too."""
    auto_exposure_mode: str
    """Normal, Out1High or AdaptiveOut1."""
    exposure_region: Region | None
    """Metered region; None: the whole image."""
    depth_region: Region | None
    """Region of depth; None: the whole image."""
    static_scene: bool
    """Average ``STATIC_IMAGES`` images for depth."""
    double_shot: bool
    """Fill holes of depth images from a second measurement."""
    quality: Quality
    """Resolution of the depth images."""
    filters: Filters
    """Post-processing of the depth images."""
    single_frame: bool
    """Make depth images on demand only."""
    single_frame_out1: bool
    """Make depth images on demand only, with Out1 high."""
    out1_mode: str
    """Mode of output 1, which the projector is connected to."""
    out2_mode: str
    """Mode of output 2."""

    @cached_property
    def alternate_exposure(self) -> bool:
        """True if camera and depth images are exposed in turn."""
        return self.out1_mode == "ExposureAlternateActive"

    @cached_property
    def meters_lit_images(self) -> bool:
        """True if metering needs the projector's light even for images without it."""
        return self.auto_exposure is not None and (self.alternate_exposure or self.auto_exposure_mode != "Normal")

    @cached_property
    def separate_depth(self) -> bool:
        """True if depth needs its own exposure, because an output is high for depth and low for camera images or vice
        versa."""
        return self.camera_gpio != self.depth_gpio

    @cached_property
    def camera_rate(self) -> float:
        """Camera image sets per second. In alternate exposure every second exposure is for depth."""
        fps = self.fps / HDR_IMAGES if self.manual_exposure.hdr else self.fps
        return min(fps, self.limits.fps / 2) if self.alternate_exposure else fps

    @cached_property
    def period_ns(self) -> int:
        """Nanoseconds between camera image sets."""
        return round(1e9 / self.camera_rate)

    @cached_property
    def longest_exposure(self) -> float:
        """Longest time of an exposure, seconds."""
        return self.manual_exposure.time if self.auto_exposure is None else self.auto_exposure.max_time

    @cached_property
    def averaged_images(self) -> int:
        """Number of images averaged for depth. ``static_scene`` applies to full and high quality only (manual)."""
        return STATIC_IMAGES if self.static_scene and self.quality in (Quality.FULL, Quality.HIGH) else 1

    @cached_property
    def depth_rate(self) -> float:
        """Depth images per second of the device."""
        return min(self.camera_rate / self.averaged_images, self.limits.depth_rates[self.quality])

    @cached_property
    def camera_gpio(self) -> int:
        """GPIO values during an exposure for camera images; Out1 is bit 0, Out2 bit 1."""
        return self._gpio(depth=False)

    @cached_property
    def depth_gpio(self) -> int:
        """GPIO values during an exposure for depth."""
        return self._gpio(depth=True)

    def _gpio(self, *, depth: bool) -> int:
        # In acquisition mode SingleFrameOut1, Out1 is high for depth exposures and low for all others.
        out1_high = depth if self.single_frame_out1 else _is_high(self.out1_mode, depth=depth)
        return out1_high | _is_high(self.out2_mode, depth=depth) << 1


def _is_high(mode: str, *, depth: bool) -> bool:
    return mode in ("High", "ExposureActive") or (mode == "ExposureAlternateActive" and depth)


def read_settings(parameters: Parameters) -> StreamSettings:
    """Return the current settings."""
    camera, matching, io = (parameters.values(node) for node in ("rc_camera", "rc_stereomatching", "rc_iocontrol"))
    automatic_exposure = camera["exp_control"] != "Manual"
    acquisition_mode = str(matching["acquisition_mode"])
    return StreamSettings(
        limits=parameters.limits,
        fps=float(camera["fps"]),
        auto_exposure=AutoExposure(
            float(camera["exp_max"]), float(camera["exp_auto_average_max"]), float(camera["exp_auto_average_min"])
        )
        if automatic_exposure
        else None,
        manual_exposure=Exposure(
            float(camera["exp_value"]),
            float(camera["gain_value"]),
            float(camera["gamma"]),
            hdr=camera["exp_control"] == "HDR",
            red=1.0 if camera["wb_auto"] else float(camera["wb_ratio_red"]) / NEUTRAL_RED,
            blue=1.0 if camera["wb_auto"] else float(camera["wb_ratio_blue"]) / NEUTRAL_BLUE,
        ),
        auto_exposure_mode=str(camera["exp_auto_mode"]),
        exposure_region=_read_region(camera, "exp"),
        depth_region=_read_region(matching, "roi"),
        static_scene=bool(matching["static_scene"]),
        double_shot=bool(matching["double_shot"]),
        quality=Quality(str(matching["quality"])),
        filters=Filters(
            minconf=float(matching["minconf"]),
            seg=int(matching["seg"]),
            fill=int(matching["fill"]),
            maxdeptherr=float(matching["maxdeptherr"]),
            mindepth=float(matching["mindepth"]),
            maxdepth=float(matching["maxdepth"]),
        ),
        single_frame=acquisition_mode != "Continuous",
        single_frame_out1=acquisition_mode == "SingleFrameOut1",
        out1_mode=str(io["out1_mode"]),
        out2_mode=str(io["out2_mode"]),
    )


def _read_region(values: Mapping[str, Value], prefix: str) -> Region | None:
    """Return a region; None if width or height is 0 (manual)."""
    offsets, sizes = ("offset_x", "offset_y"), ("width", "height")
    x, y, width, height = (int(values[f"{prefix}_{name}"]) for name in (*offsets, *sizes))
    return Region(x, y, width, height) if width and height else None
