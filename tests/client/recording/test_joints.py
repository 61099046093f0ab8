"""Joint values, from the sliders of robots in the page."""

import operator
import queue
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from gateway.adapters.viewer.encoder import SnapshotFrames
from gateway.adapters.viewer.frames import ControlFrames
from gateway.scene.page.control_store import ControlStore
from gateway.scene.tree.live import LiveTree
from scenegate.gateway_http import GatewayError
from scenegate.messages.controls import Slider
from scenegate.recording import recorder, sources
from scenegate.recording.mcap_file import McapFiles
from scenegate.recording.sources import Received, _receive
from scenegate.recording.topics import Profile, ProfileName
from scenegate.recording.view_frames import Joints, ViewFrame
from tests.client.recording.conftest import SECOND, write_values
from tests.client.recording.readers import foxglove_messages, ros2_messages


@pytest.mark.parametrize("profile", ["foxglove", "ros2"])
def test_sliders_of_joints(tmp_path: Path, profile: ProfileName) -> None:
    """Sliders in radians and metres are joints; others are not."""
    store = ControlStore()
    frames = ControlFrames(store, LiveTree())
    store.set_controls(
        "client",
        [
            Slider(("arm", "shoulder"), -1.0, 1.0, value=0.25, unit="rad"),
            Slider(("arm", "lift"), 0.0, 2.0, value=1.5, unit="m"),
            Slider(("speed",), 0.0, 9.0, value=3.0),
        ],
        lambda *_: None,
        1,
    )
    first, revision = frames.since(0), store.revision
    shoulder = next(each["id"] for each in store.controls_since(0) or () if each["path"][-1] == "shoulder")
    store.change(shoulder, 0.75)
    write_values(tmp_path / "a.mcap", profile, [first, frames.since(revision)])
    read = foxglove_messages if profile == "foxglove" else ros2_messages
    found = [message.value for message in read(tmp_path / "a.mcap") if message.topic == "/joint_states"]
    if profile == "foxglove":
        positions = [{joint.name: joint.position for joint in each.joints} for each in found]
    else:
        positions = [dict(zip(each.name, np.asarray(each.position).tolist(), strict=True)) for each in found]
    assert positions == [{"shoulder": 0.25, "lift": 1.5}, {"shoulder": 0.75, "lift": 1.5}]


def test_robots_with_equal_joints() -> None:
    """Only equal names get the names of the folders."""
    store = ControlStore()
    sliders = [
        Slider((side, name), -1.0, 1.0, value=value, unit="rad")
        for side, name, value in (("left", "elbow", 0.25), ("right", "elbow", 0.5), ("right", "wrist", 0.75))
    ]
    store.set_controls("client", sliders, lambda *_: None, 1)
    joints = Joints()
    assert joints.apply(ViewFrame(ControlFrames(store, LiveTree()).since(0)).header)
    assert joints.values == {"left/elbow": 0.25, "right/elbow": 0.5, "wrist": 0.75}


async def test_joints_of_a_gateway_that_has_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The whole scene has them no longer: a gateway without controls sends no frame of controls."""
    monkeypatch.setattr(recorder, "WHOLE_SCENE_SECONDS", 0.0)
    store, live = ControlStore(), LiveTree()
    store.set_controls("client", [Slider(("elbow",), -1.0, 1.0, unit="rad")], lambda *_: None, 1)
    with live.edit() as edit:
        edit.set_visible(("arm",), False)
    *_, update = await SnapshotFrames().advance(live.snapshot)
    monkeypatch.setattr(sources, "RETRY_SECONDS", 0.0)
    connections = iter([[update, ControlFrames(store, live).since(0), update], [update, update]])

    def receive() -> Iterator[ViewFrame]:
        yield from map(ViewFrame, next(connections))
        if operator.length_hint(connections):
            raise GatewayError("the connection is lost")

    received: queue.Queue[Received | Exception] = queue.Queue()
    _receive("scene", receive, received)
    profile, joint_counts = Profile("foxglove"), []
    with closing(McapFiles(tmp_path / "a.mcap", profile.mcap_profile)) as files:
        writer = recorder.SceneWriter(files, profile)
        for second in range(1, 6):
            item = received.get_nowait()
            assert isinstance(item, Received)
            before = files.messages
            writer.write(item.value, second * SECOND, is_first=item.is_first)
            joint_counts.append(files.messages - before - 1)  # besides the transforms
    assert joint_counts == [0, 1, 1, 0, 0]
