"""What an exposure shows: scene and pose that were valid at its own timestamp, however late they are read."""

import threading
import time

import numpy as np
import pytest

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.stream_settings import ALTERNATE_GAP_NS
from gateway.adapters.stereo.device.timestamps import NANOSECONDS_PER_SECOND
from gateway.adapters.stereo.imaging.scene_view import (
    SLOWEST_MOTION,
    VELOCITY_TIME,
    SceneState,
    SceneView,
    state_before,
)
from gateway.adapters.stereo.service import StereoService
from gateway.adapters.stereo.stream.set_kind import SetKind
from gateway.runtime.workers.worker_pool import WorkerPool
from gateway.scene.draw.flatten import Flattener
from gateway.scene.draw.mount import Mount
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.labels import LabelTable
from gateway.scene.tree.live import LiveTree
from renderers.drawlist import DrawList, Material
from renderers.raster import CpuRenderer
from scenegate.messages.geometry import Box
from tests.adapters.stereo.conftest import SMALL, Start, nanoseconds
from tests.adapters.stereo.scenes import pose
from tests.support.waiting import SECONDS, until


class Scene:
    """A live tree seen by a camera, with the times at which the camera read it."""

    def __init__(self) -> None:
        self.tree = LiveTree()
        self.tree.keep_recent("camera", active=True)
        self._view = SceneView(self.tree, Flattener(LabelTable()), Mount(pose()))
        self.times: list[int] = []
        self.reading = threading.Event()
        self.open = threading.Event()
        self.open.set()

    def move(self, x: float) -> None:
        with self.tree.edit() as edit:
            edit.set_parts(("box",), (Part(Box((0.2, 0.2, 0.2)), Material()),))
            edit.set_pose(("box",), (x, 0, 0, 1, 0, 0, 0))

    def state(self, timestamp: int | None) -> SceneState:
        assert timestamp is not None
        self.times.append(timestamp)
        self.reading.set()
        assert self.open.wait(SECONDS)
        return self._view.state(timestamp)


async def test_each_exposure_is_read_at_its_own_timestamp(start: Start) -> None:
    scene = Scene()
    scene.move(0.0)
    camera = await start(state=scene.state)
    camera.service.parameters.set("rc_iocontrol", [("out1_mode", "ExposureAlternateActive")])
    (image_set,) = await camera.take(left_enabled=True, disparity_enabled=True)
    left, disparity = nanoseconds(image_set.left.timestamp), nanoseconds(image_set.disparity.image.timestamp)
    assert disparity - left == ALTERNATE_GAP_NS
    assert {left, disparity} <= set(scene.times)


async def test_a_late_worker_does_not_move_the_content(start: Start) -> None:
    scene = Scene()
    scene.move(0.0)
    scene.open.clear()
    camera = await start(state=scene.state)
    call = camera.stream(left_enabled=True)
    await until(scene.reading.is_set)
    for step in range(5):
        scene.move(0.1 * step)
    assert time.time_ns() > scene.times[0]
    scene.open.set()
    await call.read()
    call.cancel()
    first = camera.service.history[0].camera_capture
    expected = scene.tree.snapshot_at(scene.times[0]).revision
    assert (first.timestamp, first.revision) == (scene.times[0], expected)
    assert expected < scene.tree.snapshot.revision


async def test_images_on_request_show_the_time_of_the_request(start: Start) -> None:
    scene = Scene()
    scene.move(0.0)
    camera = await start(state=scene.state)
    frame = await camera.service.capture(SetKind(left=True))
    assert frame.record.camera_capture.timestamp == frame.record.depth_capture.timestamp == scene.times[-1]


async def test_depth_on_request_has_the_outputs_of_a_depth_exposure(start: Start) -> None:
    camera = await start(noise=False)
    valid = {}
    for mode in ("Low", "High", "ExposureAlternateActive"):
        camera.service.parameters.set("rc_iocontrol", [("out1_mode", mode)])
        frame = await camera.service.capture(SetKind(left=True, disparity=True))
        assert frame.record.camera_capture.gpio == (mode == "High")
        valid[mode] = (await frame.depth_images()).disparity
    assert np.array_equal(valid["ExposureAlternateActive"], valid["High"])
    assert not np.array_equal(valid["High"], valid["Low"])


def state(timestamp: int, changed: int, revision: int = 1) -> SceneState:
    return SceneState(timestamp, DrawList(), np.eye(4), revision, changed)


def test_velocities_are_measured_between_the_messages() -> None:
    ms = 1_000_000
    now = state(1000 * ms, 995 * ms)
    last = state(960 * ms, 945 * ms)
    before = state_before(now, last, lambda _: now)
    assert before.scene is last.scene
    assert now.timestamp - before.timestamp == 50 * ms


def test_velocities_after_a_rest_begin_with_the_last_frame() -> None:
    now = state(10 * SLOWEST_MOTION, 10 * SLOWEST_MOTION - 1000)
    last = state(now.timestamp - VELOCITY_TIME, 0)
    before = state_before(now, last, lambda _: now)
    assert now.timestamp - before.timestamp == VELOCITY_TIME - 1000


def test_without_a_recent_frame_the_scene_is_read_again() -> None:
    now = state(10 * SLOWEST_MOTION, 10 * SLOWEST_MOTION)
    too_old, same, later = (state(now.timestamp + shift, 0) for shift in (-2 * VELOCITY_TIME, 0, 1))
    for last in (None, too_old, same, later):
        times: list[int] = []

        def read(timestamp: int, times: list[int] = times) -> SceneState:
            times.append(timestamp)
            return state(timestamp, timestamp)

        before = state_before(now, last, read)
        assert times == [now.timestamp - VELOCITY_TIME]
        assert before.timestamp == now.timestamp - VELOCITY_TIME
    assert state_before(now, state(now.timestamp - 1, now.timestamp), read).timestamp == now.timestamp, "at rest"


async def test_a_triggered_exposure_begins_after_the_trigger(start: Start) -> None:
    scene = Scene()
    camera = await start(state=scene.state)
    camera.service.parameters.set("rc_stereomatching", [("acquisition_mode", "SingleFrame")])
    images, depth = camera.stream(left_enabled=True), camera.stream(disparity_enabled=True)
    await images.read()
    for _ in range(3):
        before = time.time_ns()
        assert camera.service.fire_trigger() == (0, "")
        exposed = nanoseconds((await depth.read()).disparity.image.timestamp)
        begin = exposed - 0.5 * camera.service.settings.longest_exposure * NANOSECONDS_PER_SECOND
        assert begin >= before - 1_000_000  # the difference of two clocks


class Messages:
    """Messages that are being read until the camera has asked for them a few times."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self.left = 3

    def before(self, timestamp: int) -> bool:
        assert not self._scene.times, "the scene is read afterwards"
        self.left -= 1
        return self.left > 0


async def test_frames_wait_for_messages_that_arrived_before_them(
    renderer: CpuRenderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gateway.adapters.stereo.imaging.scene_view.MAX_SETTLING", 10**12)
    scene, workers = Scene(), WorkerPool(1)
    messages = Messages(scene)
    service = StereoService(
        StereoConfig(port=0, model=SMALL), scene.state, renderer, workers, has_unapplied_before=messages.before
    )
    await service.capture(SetKind(left=True))
    assert (messages.left, len(scene.times)) == (0, 1)
    monkeypatch.setattr("gateway.adapters.stereo.imaging.scene_view.MAX_SETTLING", 0)
    scene.times.clear()
    messages.left = 10**6
    await service.capture(SetKind(left=True))
    assert messages.left == 10**6 - 1, "but not for long"
    assert await workers.close()
