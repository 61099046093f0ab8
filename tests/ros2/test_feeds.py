"""Messages of the scene that the ROS 2 node publishes, from frames of given trees."""

import asyncio
import importlib
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from gateway.adapters.viewer.encoder import SnapshotFrames
from gateway.adapters.viewer.frames import ControlFrames
from gateway.scene.page.control_store import ControlStore
from gateway.scene.tree.geometry import Part, PointCloud
from gateway.scene.tree.live import LiveTree
from renderers.drawlist import Material
from scenegate.gateway_http import GatewayError
from scenegate.messages.controls import Slider
from scenegate.messages.geometry import Box
from scenegate.recording.view_frames import ViewFrame
from tests.ros2 import stand_in

pytest.importorskip("mcap_ros2", reason="needs the extra mcap")
Connect = Callable[..., None]


class RecordedTopics:
    """Publishers without a network."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        """Number of subscribers by topic."""
        self.messages: list[tuple[str, Any]] = []

    def publish(self, topic: str, message_type: str, data: bytes) -> None:
        self.messages.append((topic, stand_in.STORE.deserialize_cdr(data, message_type)))

    def subscribers(self, *topics: str) -> int:
        return sum(self.counts[topic] for topic in topics)

    def take(self, topic: str) -> list[Any]:
        """Return the messages of a topic since the last call."""
        found = [message for name, message in self.messages if name == topic]
        self.messages = [each for each in self.messages if each[0] != topic]
        return found


@pytest.fixture
def topics() -> RecordedTopics:
    return RecordedTopics()


@pytest.fixture
def feeds(monkeypatch: pytest.MonkeyPatch, topics: RecordedTopics) -> Any:
    stand_in.install(monkeypatch)
    module = importlib.import_module("scenegate_ros2.feeds")
    return module.Feeds(module.NodeParameters(), topics, lambda text: None)


@pytest.fixture
def connect(monkeypatch: pytest.MonkeyPatch, feeds: Any) -> Connect:
    """Returns a function that feeds the frames of a tree, and of a joint, over a connection that is lost then."""
    module = importlib.import_module("scenegate_ros2.feeds")
    store = ControlStore()
    store.set_controls("client", [Slider(("arm", "lift"), 0.0, 2.0, value=1.5, unit="m")], lambda *_: None, 1)

    def connect(tree: LiveTree, *others: bytes) -> None:
        def frames(*_: object) -> Iterator[ViewFrame]:
            snapshot = asyncio.run(SnapshotFrames().advance(tree.snapshot))
            yield from map(ViewFrame, (*snapshot, ControlFrames(store, tree).since(0), *others))
            raise GatewayError("lost")

        monkeypatch.setattr(module, "scene_frames", frames)
        with pytest.raises(GatewayError):
            feeds._publish_scene()  # noqa: SLF001 - one connection, in this thread

    return connect


def tree_of(*boxes: str, cloud: bool = False) -> LiveTree:
    tree = LiveTree()
    with tree.edit() as edit:
        for name in boxes:
            edit.set_parts((name,), (Part(Box((1, 1, 1)), Material()),))
        if cloud:
            edit.set_parts(("scan",), (Part(PointCloud(np.ones((5, 3), np.float32)), Material()),))
    return tree


def test_a_gateway_that_was_restarted_replaces_the_scene(connect: Connect, topics: RecordedTopics) -> None:
    topics.counts["/scene"] = 1
    connect(tree_of("old", "both", cloud=True))
    assert {marker.ns for message in topics.take("/scene") for marker in message.markers} == {"scene/old", "scene/both"}
    assert [message.width for message in topics.take("/scene/points/scan")] == [5]
    connect(tree_of("both", "new"))
    actions = {marker.ns: marker.action for message in topics.take("/scene") for marker in message.markers}
    assert actions == {"scene/old": 2, "scene/both": 0, "scene/new": 0}
    assert [message.width for message in topics.take("/scene/points/scan")] == [0]


def test_late_subscribers_of_one_topic_get_what_does_not_change(
    connect: Connect, feeds: Any, topics: RecordedTopics
) -> None:
    connect(tree_of("box", cloud=True))
    feeds.repeat_scene()
    for topic in ("/scene", "/scene/points/scan", "/joint_states"):
        topics.take(topic)
    topics.counts["/scene/points/scan"] = 1
    feeds.repeat_scene()
    feeds.repeat_scene()
    assert [message.width for message in topics.take("/scene/points/scan")] == [5]  # once
    assert not topics.take("/scene")
    assert [list(message.position) for message in topics.take("/joint_states")] == [[1.5]] * 2
    topics.counts["/scene/points/scan"] = 2
    feeds.repeat_scene()
    assert len(topics.take("/scene/points/scan")) == 1


def test_joints_that_were_removed_are_not_repeated(connect: Connect, feeds: Any, topics: RecordedTopics) -> None:
    tree = tree_of("box")
    connect(tree, ControlFrames(ControlStore(), tree).since(-1))
    topics.take("/joint_states")
    feeds.repeat_scene()
    assert not topics.take("/joint_states")
