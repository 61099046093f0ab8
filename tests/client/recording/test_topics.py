"""Topics of point clouds: each frame has one of its own, which ROS 2 accepts."""

import re

import pytest

from scenegate.recording import topics
from scenegate.recording.topics import CloudTopics

ROS_NAME = re.compile(r"(/[A-Za-z]([A-Za-z0-9]|_(?!_))*)+", re.ASCII)
FRAMES = ["a_b", "a_b_2", "a b", "a-b", "a", "", "a/", "a//b", "a/b/", "#3", "2 left", "é", "_", "a_", "a_ ", "x" * 400]


def test_frames_have_different_topics() -> None:
    found = CloudTopics()
    names = {frame: found.topic(f"scene/{frame}") for frame in FRAMES}
    assert len(set(names.values())) == len(FRAMES)
    for frame, name in names.items():
        assert name is not None
        assert ROS_NAME.fullmatch(name), (frame, name)
        assert len(name) < 200
        assert found.topic(f"scene/{frame}") == name
    assert names["a_b"] == "/scene/points/a_b"
    assert names["#3"] == "/scene/points/n_3"


def test_the_number_of_topics_is_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(topics, "MAX_SCENE_CLOUDS", 2)
    warned: list[str] = []
    found = CloudTopics(warned.append)
    a, b = "/scene/points/a", "/scene/points/b"
    assert [found.topic(f"scene/{name}") for name in "abca"] == [a, b, None, a]
    assert found.topic("scene/d") is None
    assert warned == ["point clouds are left out, that of scene/c first: the limit is 2 topics"] == list(found.warnings)
