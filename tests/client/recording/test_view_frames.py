"""Frames of the view: what is no frame, or an invalid one, is refused with a sentence."""

from typing import Any

import numpy as np
import pytest

from gateway.adapters.viewer.frames import FrameBuilder
from gateway.adapters.viewer.messages import MeshPayload
from scenegate.recording.scene_mirror import SceneMirror
from scenegate.recording.view_frames import ViewFrame, ViewFrameError


def frame(header: Any) -> bytes:
    """A frame whose header is not one of the gateway's messages."""
    return FrameBuilder().finish(header)


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "it does not start with SGV1"),
        (b"HTTP/1.1 400 Bad Request", "it does not start with SGV1"),
        (frame({"kind": "update"})[:20], "ends within its header"),
        (frame({"kind": "update"}).replace(b"{", b"["), "a frame's header is not a JSON object"),
        (frame({"kind": "update"}).replace(b"update", b"\xffpdate"), "a frame's header is not a JSON object"),
    ],
)
def test_other_data_is_no_frame(data: bytes, sentence: str) -> None:
    with pytest.raises(ViewFrameError, match=sentence):
        ViewFrame(data)


@pytest.mark.parametrize(
    "header",
    [
        {"kind": "update"},
        {"kind": "update", "from": 0, "nodes": [{"id": 5, "parent": 9, "name": "a"}]},
        {"kind": "update", "from": 0, "poses": {"ids": [0, 1000], "values": [0, 7]}},
        {"kind": "update", "from": 0, "poses": {"ids": "x", "values": None}},
        {"kind": "mesh", "id": 1, "topology": 3, "position": [0, 4]},
        {"kind": "update", "from": 0, "poses": {"ids": [0, 0], "values": [0, 0]}, "nodes": [{"id": 0, "parts": 5}]},
        {"kind": "mesh", "id": 1},
        {"kind": "rig"},
    ],
)
def test_invalid_frames_are_refused(header: dict[str, Any]) -> None:
    with pytest.raises(ViewFrameError):
        SceneMirror().apply(ViewFrame(frame(header)), 1)


def test_a_mesh_with_an_index_beyond_its_points() -> None:
    builder = FrameBuilder()
    position = builder.add_array(np.zeros(9, np.float32))
    header = MeshPayload(id=1, topology=3, position=position, index=builder.add_array(np.array((0, 1, 3), np.uint32)))
    with pytest.raises(ViewFrameError, match="a mesh of 3 points has the index 3"):
        SceneMirror().apply(ViewFrame(builder.finish(header)), 1)


def test_frames_of_kinds_to_come_are_skipped() -> None:
    assert SceneMirror().apply(ViewFrame(frame({"kind": "new"})), 1) is None
