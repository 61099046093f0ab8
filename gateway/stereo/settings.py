"""The parameters that act on the stream, as one value that a frame keeps."""

from __future__ import annotations

from dataclasses import dataclass

from gateway.stereo.parameters import Parameters
from renderers.stereo.filters import Filters
from renderers.stereo.model import Quality
from renderers.stereo.sensor import AutoExposure, Exposure

ALTERNATE_GAP = 40_000_000
"""Nanoseconds between the image with Out1 low and the one with Out1 high in alternate exposure."""


@dataclass(frozen=True, slots=True)
class StreamSettings:
    """A consistent reading of the parameters."""

    fps: float
    auto: AutoExposure | None
    """None: manual."""
    manual: Exposure
    """Its gamma counts in automatic mode, too."""
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
    def camera_rate(self) -> float:
        """Camera image sets per second: in alternate exposure every second exposure is a depth image's."""
        return min(self.fps, 12.5) if self.alternate else self.fps

    @property
    def depth_rate(self) -> float:
        """Depth images per second at the device's speed."""
        return min(self.camera_rate, self.quality.depth_rate)

    def lines(self, *, depth: bool) -> int:
        """GPIO values during the exposure: Out1 is bit 0, Out2 bit 1."""
        high = [_is_high(mode, depth=depth) for mode in (self.out1, self.out2)]
        if depth and self.single_out1:
            high[0] = True
        return high[0] | high[1] << 1


def _is_high(mode: str, *, depth: bool) -> bool:
    return mode in ("High", "ExposureActive") or (mode == "ExposureAlternateActive" and depth)


def read(parameters: Parameters) -> StreamSettings:
    """The settings as they are now."""
    camera, matching, io = (parameters.values(n) for n in ("rc_camera", "rc_stereomatching", "rc_iocontrol"))
    gamma = float(camera["gamma"])
    automatic = camera["exp_control"] != "Manual"
    mode = str(matching["acquisition_mode"])
    return StreamSettings(
        fps=float(camera["fps"]),
        auto=AutoExposure(
            float(camera["exp_max"]), float(camera["exp_auto_average_max"]), float(camera["exp_auto_average_min"])
        )
        if automatic
        else None,
        manual=Exposure(float(camera["exp_value"]), float(camera["gain_value"]), gamma),
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
