"""Ground truth of a frame, for training and tests."""

import io
from typing import Annotated, Any, Final

import numpy as np
from fastapi import APIRouter, Query
from fastapi.responses import Response

from gateway.adapters.stereo.device.timestamps import parse_timestamp, timestamp_text
from gateway.adapters.stereo.routes.rest_common import Pipeline, RestError, error_responses, find_pipeline, new_router
from gateway.adapters.stereo.service import StereoService
from gateway.adapters.stereo.stream.frame import FrameRecord
from gateway.runtime.http.openapi import Responses, example, file_response
from renderers.interface import Output
from renderers.stereo.depth.depth_images import true_disparity

_TIMESTAMP = r"^([0-9]{1,12}(\.[0-9]{0,9})?)?$"
_RESPONSES: Final[Responses] = {
    **file_response("NumPy's npz.", "application/zip"),
    **error_responses(
        {
            400: "Not a timestamp.",
            404: "No such frame in the history.",
            503: "Too many requests wait already; see Retry-After.",
        }
    ),
}


def truth_router(*services: StereoService) -> APIRouter:
    """Return the route ``GET /stereo/truth.npz``."""
    routes = new_router()

    @routes.get(
        "/stereo/truth.npz",
        summary="Exact depth, labels, poses and intrinsics of a frame",
        response_class=Response,
        responses=_RESPONSES,
    )
    async def truth(
        timestamp: Annotated[
            str,
            Query(
                description="Timestamp of any image of the set, as seconds.nanoseconds; empty: the newest frame",
                json_schema_extra={"pattern": _TIMESTAMP},
                openapi_examples=example("", "newest frame") | example("1700000000.040000000", "frame of a timestamp"),
            ),
        ] = "",
        pipeline: Pipeline = 0,
    ) -> Response:
        service = find_pipeline(services, pipeline)
        try:
            nanoseconds = parse_timestamp(timestamp) if timestamp else None
        except ValueError as error:
            raise RestError(400, str(error)) from None
        try:
            data = await service.workers.run(ground_truth_npz, find_frame(service.history, nanoseconds))
        except LookupError as error:  # of recorded images
            raise RestError(404, str(error)) from None
        return Response(data, media_type="application/zip", headers={"Cache-Control": "no-store"})

    return routes


def find_frame(history: list[FrameRecord], nanoseconds: int | None) -> FrameRecord:
    """Return the frame of a timestamp (None: the newest), given the oldest first. Raises RestError without."""
    if not history:
        raise RestError(404, "no frame was taken yet; frames are taken while a client streams")
    if nanoseconds is None:
        return history[-1]
    for record in reversed(history):
        if nanoseconds in (record.depth_capture.timestamp, record.camera_capture.timestamp):
            return record
    oldest, newest = history[0].camera_capture.timestamp, history[-1].depth_capture.timestamp
    raise RestError(
        404,
        f"no frame has the timestamp {timestamp_text(nanoseconds)}; the history has {len(history)} from "
        f"{timestamp_text(oldest)} to {timestamp_text(newest)}",
    )


def ground_truth_npz(record: FrameRecord) -> bytes:
    """Return the ground truth of a frame as an npz file.

    Arrays whose names start with ``left_`` or ``right_`` have the resolution and the time of the camera images. The
    others have those of the depth images:

    * ``depth`` (h, w) float32: metres along the optical axis, inf: background; ``label`` (h, w) uint32.
    * ``disparity`` (h, w) float32: exact disparity, pixels; 0 where it cannot be measured (occluded, out of range, or
      outside the right image).
    * ``left_depth``, ``left_label``, ``right_depth``, ``right_label``: depth and labels of the camera images.
    * ``K``, ``K_left`` (3, 3) float64: intrinsics of depth and camera images; ``baseline``: metres.
    * ``X_world_left``, ``X_world_right``, ``X_world_depth`` (4, 4) float64: poses of the optical frames. The poses of
      left and depth differ only if depth is exposed 40 ms later and the camera moves.
    * ``frame``: number of the frame; ``revision``: revision of the scene.
    * ``timestamp``, ``camera_timestamp``: timestamps of depth and camera images, nanoseconds since the epoch.
    """
    imaging, settings = record.imaging, record.settings
    model = imaging.config.model
    divisor = settings.quality.divisor
    depth_intrinsics, camera_intrinsics = model.intrinsics(divisor), model.intrinsics()
    arrays: dict[str, Any] = {}
    depth_and_label = Output.DEPTH | Output.LABEL
    for side, offset in (("left", 0.0), ("right", model.baseline)):
        frame = imaging.render(record.camera_capture, offset, 1, depth_and_label)
        assert frame.depth is not None
        assert frame.label is not None
        arrays[f"{side}_depth"], arrays[f"{side}_label"] = frame.depth, frame.label
    left = imaging.render(record.depth_capture, 0.0, divisor, depth_and_label)
    right = imaging.render(record.depth_capture, model.baseline, divisor, Output.DEPTH)
    assert left.depth is not None
    assert left.label is not None
    assert right.depth is not None
    arrays["disparity"] = true_disparity(
        left.depth, right.depth, model.focal_times_baseline(divisor), settings.filters.measurable_depths(model, divisor)
    )
    arrays["depth"], arrays["label"] = left.depth, left.label
    X_left_right = np.eye(4)
    X_left_right[0, 3] = model.baseline
    arrays |= {
        "K": depth_intrinsics.matrix,
        "K_left": camera_intrinsics.matrix,
        "baseline": np.float64(model.baseline),
        "X_world_left": record.camera_capture.X_world_left,
        "X_world_right": record.camera_capture.X_world_left @ X_left_right,
        "X_world_depth": record.depth_capture.X_world_left,
        "frame": np.int64(record.number),
        "revision": np.int64(record.depth_capture.revision),
        "timestamp": np.int64(record.depth_capture.timestamp),
        "camera_timestamp": np.int64(record.camera_capture.timestamp),
    }
    return npz_bytes(arrays)


def npz_bytes(arrays: dict[str, Any]) -> bytes:
    """Return arrays as an npz file."""
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **arrays)
    return file.getvalue()
