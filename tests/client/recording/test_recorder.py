"""``scenegate record --mcap --camera``: images at the camera's rate, depth at its own; a source that sends nothing."""

import asyncio
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from scenegate.camera.stream import StreamOptions
from scenegate.gateway_http import GatewayError
from scenegate.recording import recorder, sources
from scenegate.recording.camera_values import CameraConverter
from scenegate.recording.recorder import RecordingOptions, record
from scenegate.recording.values import ExposureImages
from tests.adapters.stereo.conftest import Start, renderer, start
from tests.client.recording.readers import ros2_messages

__all__ = ["renderer", "start"]
LEFT, RIGHT, DEPTH, POINTS = (
    f"/stereo/{name}" for name in ("left/image_rect", "right/image_rect", "depth/image_rect", "points2")
)


@pytest.mark.slow
@pytest.mark.parametrize("depth", [True, False])
async def test_images_come_at_the_camera_s_rate_and_depth_at_its_own(start: Start, tmp_path: Path, depth: bool) -> None:
    camera = await start(depth_mode="ground_truth")
    target = StreamOptions(f"127.0.0.1:{camera.service.port}")
    options = RecordingOptions(tmp_path / "a.mcap", "ros2", camera=target, depth=depth, seconds=2.0)
    await asyncio.to_thread(record, options, threading.Event())
    counts = Counter(message.topic for message in ros2_messages(options.path))
    assert counts[RIGHT] == counts[LEFT] >= 20
    assert counts[DEPTH] == counts[POINTS]
    assert (4 <= counts[DEPTH] <= 8) if depth else counts[DEPTH] == 0


async def test_a_first_message_that_takes_long_takes_no_time_of_the_others(
    start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the messages of a large scene do."""
    convert, waits = CameraConverter.convert, [0.4]

    def convert_slowly(*arguments: Any, **options: Any) -> list[ExposureImages]:
        time.sleep(waits.pop() if waits else 0.0)
        return convert(*arguments, **options)

    monkeypatch.setattr(CameraConverter, "convert", convert_slowly)
    camera = await start(depth_mode="ground_truth")
    target = StreamOptions(f"127.0.0.1:{camera.service.port}")
    options = RecordingOptions(tmp_path / "a.mcap", "ros2", camera=target, seconds=0.3)
    await asyncio.to_thread(record, options, threading.Event())
    counts = Counter(message.topic for message in ros2_messages(options.path))
    assert counts[LEFT] >= 2


@pytest.mark.parametrize("depth", [True, False])
async def test_a_camera_without_depth_is_an_error(
    start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, depth: bool
) -> None:
    """The right image needs the baseline, which sets with disparity have."""
    for module in (recorder, sources):
        monkeypatch.setattr(module, "WAIT_SECONDS", 0.3)
    camera = await start()
    camera.service.parameters.set("rc_stereomatching", [("acquisition_mode", "SingleFrame")])
    target = f"127.0.0.1:{camera.service.port}"
    options = RecordingOptions(tmp_path / "a.mcap", camera=StreamOptions(target), depth=depth, seconds=0.3)
    with pytest.raises(GatewayError, match=target):
        await asyncio.to_thread(record, options, threading.Event())
    assert not options.path.exists()
