"""The scene of a file, by independent readers, is the tree."""

import asyncio
import tempfile
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from gateway.adapters.viewer.encoder import SnapshotFrames
from gateway.scene.draw.flatten import Flattener
from gateway.scene.tree.geometry import Line, Part, PointCloud
from gateway.scene.tree.labels import LabelTable
from gateway.scene.tree.live import LiveTree, Snapshot
from gateway.scene.tree.nodes import Path as NodePath
from gateway.scene.tree.nodes import TreeEdit
from renderers.color import srgb_from_linear
from renderers.drawlist import Material, Topology
from scenegate.messages.geometry import Box, Sphere, Triad
from scenegate.recording import mcap_file, scene_mirror
from scenegate.recording.mcap_file import McapFiles
from scenegate.recording.recorder import SceneWriter
from scenegate.recording.topics import Profile, ProfileName
from scenegate.recording.view_frames import ViewFrame
from tests.client.recording.conftest import SECOND, write_snapshots
from tests.client.recording.readers import (
    ReadScene,
    foxglove_messages,
    foxglove_scene,
    ros2_messages,
    ros2_scene,
    scanned_messages,
)

READ: dict[ProfileName, Callable[[Path], ReadScene]] = {"foxglove": foxglove_scene, "ros2": ros2_scene}
RED = Material(base_color=(1.0, 0.2, 0.1, 0.5))
NAMES = st.sampled_from(["a", "b", 1, "1", "#1", "a/b", "a%2Fb", ""])
PATHS = st.lists(NAMES, max_size=3).map(tuple)
EDITS = st.one_of(
    st.tuples(st.just("parts"), PATHS, st.lists(st.sampled_from([Box((1, 2, 3)), Sphere(0.5)]), max_size=2)),
    st.tuples(st.just("pose"), PATHS, st.tuples(*[st.floats(-2, 2, width=32)] * 6)),
    st.tuples(st.just("matrix"), PATHS, st.tuples(*[st.sampled_from([-2.0, -0.5, 0.0, 0.25, 1.0])] * 9)),
    st.tuples(st.just("visible"), PATHS, st.booleans()),
    st.tuples(st.just("opacity"), PATHS, st.sampled_from([0.25, 0.5, 1.0])),
    st.tuples(st.just("delete"), PATHS, st.none()),
)


def apply(edit: TreeEdit, kind: str, path: NodePath, value: Any) -> None:
    if kind == "parts":
        edit.set_parts(path, tuple(Part(shape, RED) for shape in value))
    elif kind == "pose":
        edit.set_pose(path, (*value[:3], 1.0, *value[3:]))
    elif kind == "matrix":
        matrix = np.eye(4)
        matrix[:3, :3] = np.reshape(value, (3, 3))
        edit.set_matrix(path, matrix)
    elif kind == "delete":
        edit.delete(path)
    else:
        (edit.set_visible if kind == "visible" else edit.set_opacity)(path, value)


def frame_of(path: NodePath) -> str:
    """The name of a node's frame, as docs/mcap.md has it."""
    escaped = (
        f"#{name}" if isinstance(name, int) else "".join(f"%{ord(c):02X}" if c in "%/#" else c for c in name)
        for name in path
    )
    return "/".join(("scene", *escaped))


def drawn(snapshot: Snapshot) -> dict[str, list[tuple[NDArray[np.float64], list[float]]]]:
    """Points in the world and colours of what the renderer draws, by frame."""
    labels = LabelTable()
    found: dict[str, list[tuple[NDArray[np.float64], list[float]]]] = {}
    for instance in Flattener(labels).flatten(snapshot).instances:
        mesh = instance.mesh
        path = labels.path_of(instance.label)
        if mesh.topology is Topology.POINTS or path is None:
            continue
        points = mesh.positions[mesh.elements.ravel()] @ instance.X_world_mesh[:3, :3].T + instance.X_world_mesh[:3, 3]
        red, green, blue, alpha = instance.material.base_color
        color = [*map(srgb_from_linear, (red, green, blue)), alpha]
        found.setdefault(frame_of(path), []).append((points, color))
    return found


def assert_same(read: ReadScene, snapshot: Snapshot) -> None:
    actual, expected = read.world_points(), drawn(snapshot)
    assert actual.keys() == expected.keys()
    for frame, primitives in expected.items():
        assert len(actual[frame]) == len(primitives), frame
        for (points, color), (expected_points, expected_color) in zip(actual[frame], primitives, strict=True):
            np.testing.assert_allclose(points, expected_points, atol=1e-4)
            np.testing.assert_allclose(color, expected_color, atol=1e-6)


@pytest.mark.parametrize("profile", ["foxglove", "ros2"])
def test_readers_have_the_tree_after_any_edits(profile: ProfileName) -> None:
    """Poses, scales, mirrors, hidden and faded subtrees, removed and equal-looking names."""

    @settings(max_examples=15, deadline=None)
    @given(st.lists(st.lists(EDITS, max_size=6), min_size=1, max_size=5))
    def check(batches: list[list[Any]]) -> None:
        live, snapshots = LiveTree(), []
        for batch in batches:
            with live.edit() as edit:
                for each in batch:
                    apply(edit, *each)
            snapshots.append(live.snapshot)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "scene.mcap"
            asyncio.run(write_snapshots(path, profile, snapshots))
            assert_same(READ[profile](path), live.snapshot)

    check()


def small_tree() -> LiveTree:
    live = LiveTree(lambda: 5_000_000_123)
    with live.edit() as edit:
        edit.set_parts(("robot", "link"), (Part(Box((1, 2, 3)), RED), Part(Triad(0.5), RED)))
        edit.set_pose(("robot",), (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
        points = np.array(((0, 0, 0), (1, 0, 0), (1, 1, 0)), np.float32)
        edit.set_parts(("path",), (Part(Line(points, radius=0.0), RED),))
        cloud = PointCloud(points, {"rgb": np.array(((1, 0, 0), (0, 1, 0), (0, 0, 1)), np.float32)})
        edit.set_parts(("scan", "2 left"), (Part(cloud, Material()),))
    return live


@pytest.mark.parametrize("profile", ["foxglove", "ros2"])
async def test_triads_lines_and_clouds(tmp_path: Path, profile: ProfileName) -> None:
    live = small_tree()
    await write_snapshots(tmp_path / "a.mcap", profile, [live.snapshot])
    assert_same(READ[profile](tmp_path / "a.mcap"), live.snapshot)
    read = foxglove_messages if profile == "foxglove" else ros2_messages
    (cloud,) = [each.value for each in read(tmp_path / "a.mcap") if each.topic == "/scene/points/scan/n2_left"]
    data = np.frombuffer(bytes(cloud.data), np.dtype([("xyz", "<f4", 3), ("color", "u1", 4)]))
    order = np.lexsort(data["xyz"].T)
    np.testing.assert_array_equal(data["xyz"][order][:, :2], [[0, 0], [1, 0], [1, 1]])
    colors = data["color"][order][:, :3]
    np.testing.assert_array_equal(colors if profile == "foxglove" else colors[:, ::-1], np.eye(3) * 255)


async def test_messages_have_the_time_of_the_change(tmp_path: Path) -> None:
    await write_snapshots(tmp_path / "a.mcap", "ros2", [small_tree().snapshot])
    for message in ros2_messages(tmp_path / "a.mcap"):
        stamped = message.value if hasattr(message.value, "header") else None
        for each in [stamped] if stamped else getattr(message.value, "transforms", None) or message.value.markers:
            assert (each.header.stamp.sec, each.header.stamp.nanosec) == (5, 123)
        assert message.log_time == 1_000_000_000


async def test_readers_can_begin_in_the_middle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each ten seconds, and at the start of each file, there is the whole scene."""
    live, snapshots = small_tree(), []
    for second in range(25):
        with live.edit() as edit:
            edit.set_pose(("robot",), (float(second), 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
        snapshots.append(live.snapshot)
    await write_snapshots(tmp_path / "a.mcap", "foxglove", snapshots)
    times = [
        message.log_time // 10**9 for message in foxglove_messages(tmp_path / "a.mcap") if message.topic == "/scene"
    ]
    assert times == [1, 11, 21]
    monkeypatch.setattr(mcap_file, "CHUNK_BYTES", 500)
    writer = await write_snapshots(tmp_path / "b.mcap", "foxglove", snapshots, max_bytes=3000)
    assert len(writer.files.paths) > 2
    assert_same(foxglove_scene(writer.files.paths[-1]), live.snapshot)
    kept = await write_snapshots(tmp_path / "c.mcap", "foxglove", snapshots, max_bytes=3000, keep=2)
    assert sorted(tmp_path.glob("c*.mcap")) == sorted(kept.files.paths)  # noqa: ASYNC240 - nothing else runs
    assert len(kept.files.paths) == 2


async def test_each_transform_is_written_once_at_a_time(tmp_path: Path) -> None:
    """The whole scene has the changes that are recorded with it, and the nodes that they have removed."""
    live, snapshots = small_tree(), []
    with live.edit() as edit:
        edit.set_parts(("gone",), (Part(Box((1, 1, 1)), RED),))
        edit.set_parts(("points",), (Part(PointCloud(np.ones((5, 3), np.float32)), RED),))
    for second in range(12):
        with live.edit() as edit:
            edit.set_pose(("robot",), (float(second), 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
            if second == 10:
                edit.delete(("gone",))
                edit.delete(("points",))
        snapshots.append(live.snapshot)
    await write_snapshots(tmp_path / "a.mcap", "foxglove", snapshots)
    messages = list(foxglove_messages(tmp_path / "a.mcap"))
    written = [
        (message.log_time, each.child_frame_id)
        for message in messages
        if message.topic == "/tf"
        for each in message.value.transforms
    ]
    assert len(written) == len(set(written))
    (removed,) = [each for message in messages if message.topic == "/scene" for each in message.value.deletions]
    assert removed.id == "scene/gone"
    points = [len(message.value.data) > 0 for message in messages if message.topic == "/scene/points/points"]
    assert points == [True, False]


async def test_a_new_file_begins_with_the_scene_after_the_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Messages arrive later than what they say is valid: the scene at the file's start must not hide the change."""
    monkeypatch.setattr(mcap_file, "CHUNK_BYTES", 500)
    live, frames, profile = small_tree(), SnapshotFrames(), Profile("foxglove")
    with closing(McapFiles(tmp_path / "a.mcap", "", max_bytes=3000)) as files:
        writer = SceneWriter(files, profile)
        for second in range(1, 80):
            with live.edit() as edit:
                edit.set_pose(("robot",), (float(second), 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
            snapshot = Snapshot(live.snapshot.root, live.snapshot.revision, second * SECOND)
            for frame in await frames.advance(snapshot):
                writer.write(ViewFrame(frame), second * SECOND + SECOND // 2)
    assert len(files.paths) > 4
    for path in files.paths:
        poses = [
            (message.value.transforms[0].timestamp.ToNanoseconds() / SECOND, each.translation.x)
            for message in foxglove_messages(path)
            if message.topic == "/tf"
            for each in message.value.transforms
            if each.child_frame_id == "scene/robot"
        ]
        assert poses
        assert all(stamp == x for stamp, x in poses)


async def test_a_mesh_beyond_the_limit_is_left_out_with_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scene_mirror, "MAX_NODE_POINTS", 100)
    live = LiveTree()
    with live.edit() as edit:
        edit.set_parts(("ball",), (Part(Sphere(1.0), RED),))
        edit.set_parts(("box",), (Part(Box((1, 1, 1)), RED),))
    writer = await write_snapshots(tmp_path / "a.mcap", "foxglove", [live.snapshot])
    assert list(foxglove_scene(tmp_path / "a.mcap").geometry) == ["scene/box"]
    (warning,) = writer.warnings
    assert warning.startswith("scene/ball is left out: its triangles and lines have ")
    assert warning.endswith("points, the limit is 100")


async def test_messages_are_in_the_file_after_a_flush(tmp_path: Path) -> None:
    """A copy of the file then is what a killed process leaves."""
    path, frames, converter = tmp_path / "a.mcap", SnapshotFrames(), Profile("ros2")
    with closing(mcap_file.McapFiles(path, converter.mcap_profile)) as files:
        writer = SceneWriter(files, converter)
        for frame in await frames.advance(small_tree().snapshot):
            writer.write(ViewFrame(frame), SECOND)
        assert scanned_messages(path) == 0
        files.flush()
        assert scanned_messages(path) == files.messages > 2
