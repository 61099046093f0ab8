"""Writes the colour and depth image of one instant into an npz file."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.stream.frame import FrameImages
from gateway.runtime.workers.worker_pool import WorkerPool


async def rgbd_npz(frame: FrameImages, config: StereoConfig, workers: WorkerPool, *, aligned: bool) -> bytes:
    """Return an npz file with these arrays:

    * ``color`` (H, W, 3) uint8 RGB; ``depth_mm`` (h, w) uint16, millimetres along the optical axis, 0: invalid.
    * ``K_color``, ``K_depth`` (3, 3) float64: intrinsics.
    * ``X_world_color``, ``X_world_depth`` (4, 4) float64: poses of the optical frames, metres.
    * ``timestamp``: int64, nanoseconds since the epoch.

    Args:
        frame: frame of a camera with colour.
        config: configuration of the camera.
        workers: worker threads, one of which writes the file.
        aligned: True: depth as seen by the colour camera, with its size, intrinsics and pose.

    Raises:
        ImageError: a texture cannot be decoded.
    """
    color = await frame.color_camera_image()
    X_world_left = frame.record.camera_capture.X_world_left
    X_world_color = X_world_left @ config.X_left_color
    arrays = {
        "color": color.sensor_image.image,
        "depth_mm": await frame.depth_mm(aligned=aligned),
        "K_color": config.color_intrinsics.matrix,
        "K_depth": frame.depth_intrinsics(aligned=aligned).matrix,
        "X_world_color": X_world_color,
        "X_world_depth": X_world_color if aligned else frame.record.depth_capture.X_world_left,
        "timestamp": np.int64(frame.record.camera_capture.timestamp),
    }
    return await workers.run(npz_bytes, arrays)


def npz_bytes(arrays: dict[str, Any]) -> bytes:
    """Return arrays as an npz file."""
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **arrays)
    return file.getvalue()
