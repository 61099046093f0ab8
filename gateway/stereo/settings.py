"""The parameters that act on the stream, as one value that a frame keeps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from gateway.stereo.parameter_specs import Value
from gateway.stereo.parameters import Parameters
from renderers.stereo.exposure import AutoExposure, Exposure
from renderers.stereo.filters import Filters
from renderers.stereo.model import Quality

ALTERNATE_GAP = 40_000_000
"""Nanoseconds between two exposures with different outputs (manual: Out1 low and high are always 40 ms apart)."""
STATIC_IMAGES: Final = 8
"""How many images ``static_scene`` averages (manual)."""
HDR_IMAGES: Final = 3
"""How many exposures a high dynamic range image takes; it divides the rate by as much."""
NEUTRAL_RED: Final = 1.2
NEUTRAL_BLUE: Final = 2.4
"""White balance ratios at which colours are as rendered: the device's defaults, which stand for the white light of the
rendered scenes; the automatic finds them."""

Region = tuple[int, int, int, int]
"""Left column, upper row, width, height, in pixels of the left image."""


@dataclass(frozen=True, slots=True)
class StreamSettings:
    """A consistent reading of the parameters."""

    fps: float
    auto: AutoExposure | None
    """None: manual."""
    manual: Exposure
    """Its gamma, dynamic range and white balance count in automatic mode, too."""
    auto_mode: str
    """Normal, Out1High or AdaptiveOut1."""
    exposure_region: Region | None
    """Where the automatic looks; None: everywhere."""
    depth_region: Region | None
    """Where depth is measured; None: everywhere."""
    static: bool
    """Depth from the average of eight images."""
    double_shot: bool
    """Holes of depth images are filled from a second measurement."""
    quality: Quality
    filters: Filters
    single: bool
    """Depth images only on demand."""
    single_out1: bool
    """… with Out1 high."""
    out1: str
    out2: str

    @property
    def alternate(self) -> bool:
        """Whether depth is exposed apart from the camera images."""
        return self.out1 == "ExposureAlternateActive"

    @property
    def separate_depth(self) -> bool:
        """Return whether depth needs its own exposure: an output differs from that of the camera images."""
        return self.lines(depth=False) != self.lines(depth=True)

    @property
    def camera_rate(self) -> float:
        """Camera image sets per second: in alternate exposure every second exposure is a depth image's."""
        fps = self.fps / HDR_IMAGES if self.manual.hdr else self.fps
        return min(fps, 12.5) if self.alternate else fps

    @property
    def averaged(self) -> int:
        """How many images a depth image is made of. ``static_scene`` acts in full and high quality only (manual)."""
        return STATIC_IMAGES if self.static and self.quality in (Quality.FULL, Quality.HIGH) else 1

    @property
    def depth_rate(self) -> float:
        """Depth images per second at the device's speed."""
        return min(self.camera_rate / self.averaged, self.quality.depth_rate)

    def lines(self, *, depth: bool) -> int:
        """GPIO values during the exposure: Out1 is bit 0, Out2 bit 1.

        In SingleFrameOut1 the acquisition controls Out1: high for the depth exposure, else low.
        """
        high = [_is_high(mode, depth=depth) for mode in (self.out1, self.out2)]
        if self.single_out1:
            high[0] = depth
        return high[0] | high[1] << 1


def _is_high(mode: str, *, depth: bool) -> bool:
    return mode in ("High", "ExposureActive") or (mode == "ExposureAlternateActive" and depth)


def read(parameters: Parameters) -> StreamSettings:
    """The settings as they are now."""
    camera, matching, io = (parameters.values(n) for n in ("rc_camera", "rc_stereomatching", "rc_iocontrol"))
    automatic = camera["exp_control"] != "Manual"
    mode = str(matching["acquisition_mode"])
    return StreamSettings(
        fps=float(camera["fps"]),
        auto=AutoExposure(
            float(camera["exp_max"]), float(camera["exp_auto_average_max"]), float(camera["exp_auto_average_min"])
        )
        if automatic
        else None,
        manual=Exposure(
            float(camera["exp_value"]),
            float(camera["gain_value"]),
            float(camera["gamma"]),
            hdr=camera["exp_control"] == "HDR",
            red=1.0 if camera["wb_auto"] else float(camera["wb_ratio_red"]) / NEUTRAL_RED,
            blue=1.0 if camera["wb_auto"] else float(camera["wb_ratio_blue"]) / NEUTRAL_BLUE,
        ),
        auto_mode=str(camera["exp_auto_mode"]),
        exposure_region=_region(camera, "exp"),
        depth_region=_region(matching, "roi"),
        static=bool(matching["static_scene"]),
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
        single=mode != "Continuous",
        single_out1=mode == "SingleFrameOut1",
        out1=str(io["out1_mode"]),
        out2=str(io["out2_mode"]),
    )


def _region(values: Mapping[str, Value], prefix: str) -> Region | None:
    """None when width or height is 0, as the manual says."""
    offsets, sizes = ("offset_x", "offset_y"), ("width", "height")
    x, y, width, height = (int(values[f"{prefix}_{name}"]) for name in (*offsets, *sizes))
    return (x, y, width, height) if width and height else None
