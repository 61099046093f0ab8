"""The device's ``rc_measure``: mean, nearest and farthest point of a region of a depth image, and of its cells."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any, Final, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.stream_settings import Region
from gateway.adapters.stereo.device.timestamps import NANOSECONDS_PER_SECOND
from renderers.stereo.depth.depth_images import DepthImages
from renderers.stereo.model import DISPARITY_SCALE, Intrinsics, StereoModel

MAX_CELLS: Final = 100
"""Maximum number of cells (manual)."""
Whole = Annotated[int, msgspec.Meta(ge=0, le=0xFFFFFFFF)]


class CellCount(msgspec.Struct):
    """Number of cells that the region is divided into; 0: none."""

    x: Whole = 0
    y: Whole = 0


class RegionOfInterest(msgspec.Struct):
    """Rectangle in the left image at full resolution, pixels."""

    offset_x: Whole = 0
    offset_y: Whole = 0
    width: Whole = 0
    """0: up to the right edge."""
    height: Whole = 0
    """0: down to the lower edge."""


class MeasureArguments(msgspec.Struct):
    """Arguments of ``measure_depth``."""

    pose_frame: str = ""
    region_of_interest_2d_id: str = ""
    region_of_interest_2d: RegionOfInterest = msgspec.field(default_factory=RegionOfInterest)
    cell_count: CellCount = msgspec.field(default_factory=CellCount)
    data_acquisition_mode: Literal["CAPTURE_NEW", "USE_LAST"] = "CAPTURE_NEW"
    robot_pose: dict[str, Any] | None = None
    """Not needed in the camera frame."""

    def check(self, model: StereoModel) -> Region:
        """Return the region. Raises ValueError if an argument is not valid: the sentence for the return code -1."""
        if self.pose_frame != "camera":
            raise ValueError(f"pose_frame: {self.pose_frame[:80]!r} is not 'camera'; there is no hand-eye calibration")
        if self.region_of_interest_2d_id:
            raise ValueError(f"there is no region of interest {self.region_of_interest_2d_id[:80]!r}")
        if self.cell_count.x * self.cell_count.y > MAX_CELLS:
            raise ValueError(f"cell_count: {self.cell_count.x} x {self.cell_count.y} cells, the limit is {MAX_CELLS}")
        roi = self.region_of_interest_2d
        width, height = roi.width or model.width - roi.offset_x, roi.height or model.height - roi.offset_y
        if min(width, height) <= 0 or roi.offset_x + width > model.width or roi.offset_y + height > model.height:
            size = f"{model.width}x{model.height}"
            raise ValueError(f"region_of_interest_2d: {msgspec.to_builtins(roi)} is not within the image of {size}")
        return Region(roi.offset_x, roi.offset_y, width, height)


@dataclass(frozen=True, slots=True)
class MeasuredImages:
    """Depth images of the last measurement."""

    images: DepthImages
    divisor: int
    """Width of the camera images divided by that of the depth images."""
    timestamp: int
    """Nanoseconds since the epoch, as clients get it."""
    acquisition_seconds: float
    """Duration of the capture."""
    processing_seconds: float = 0.0
    """Duration of the measurement in the images."""


def measurement(measured: MeasuredImages, model: StereoModel, region: Region, cells: CellCount) -> dict[str, Any]:
    """Return the response of ``measure_depth``, without its return code. Cells are whole pixels of the depth image."""
    k = model.intrinsics(measured.divisor)
    rows, columns = region.slices(measured.divisor)
    bottom, right = min(rows.stop, k.height), min(columns.stop, k.width)
    units = measured.images.disparity
    depth = np.full(units.shape, np.nan)
    np.divide(model.focal_times_baseline(measured.divisor) / DISPARITY_SCALE, units, out=depth, where=units > 0)
    row_edges = np.linspace(rows.start, bottom, cells.y + 1).round().astype(int).tolist()
    column_edges = np.linspace(columns.start, right, cells.x + 1).round().astype(int).tolist()
    sec, nsec = divmod(measured.timestamp, NANOSECONDS_PER_SECOND)
    return {
        "timestamp": {"sec": sec, "nsec": nsec},
        "pose_frame": "camera",
        "region_of_interest_2d": {
            "offset_x": region.x,
            "offset_y": region.y,
            "width": region.width,
            "height": region.height,
        },
        "cell_count": {"x": cells.x, "y": cells.y},
        "overall": _summary(depth, k, rows.start, bottom, columns.start, right),
        "cells": [
            _summary(depth, k, *row_pair, *column_pair)
            for row_pair in pairwise(row_edges)
            for column_pair in pairwise(column_edges)
        ],
    }


def _summary(depth: NDArray[np.float64], k: Intrinsics, top: int, bottom: int, left: int, right: int) -> dict[str, Any]:
    """Return the points of a part of the depth image, (H, W) metres, NaN where there is none."""

    def point(row: float, column: float, z: float) -> dict[str, float]:
        x, y = (left + column - k.cx) * z / k.focal_length, (top + row - k.cy) * z / k.focal_length
        return {"x": float(x), "y": float(y), "z": float(z)}

    part = depth[top:bottom, left:right]
    valid = np.isfinite(part)
    if not valid.any():
        return {"coverage": 0.0, **dict.fromkeys(("mean_z", "min_z", "max_z"), point(0, 0, 0.0))}
    nearest, farthest = (np.unravel_index(find(part), part.shape) for find in (np.nanargmin, np.nanargmax))
    height, width = part.shape
    return {
        "coverage": float(valid.mean()),
        "mean_z": point(height / 2, width / 2, part[valid].mean()),
        "min_z": point(nearest[0] + 0.5, nearest[1] + 0.5, part[nearest]),
        "max_z": point(farthest[0] + 0.5, farthest[1] + 0.5, part[farthest]),
    }
