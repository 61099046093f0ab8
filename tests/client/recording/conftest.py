"""Files that are written from trees of the server and from image sets."""

from collections.abc import Iterable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from gateway.scene.tree.live import Snapshot

pytest.importorskip("mcap", reason="needs the extra mcap")
pytest.importorskip("mcap_ros2", reason="needs the extra mcap")
pytest.importorskip("foxglove_schemas_protobuf", reason="needs the extra mcap")

from gateway.adapters.viewer.encoder import SnapshotFrames
from scenegate.recording.mcap_file import McapFiles
from scenegate.recording.recorder import SceneWriter
from scenegate.recording.topics import Profile, ProfileName
from scenegate.recording.view_frames import ViewFrame

SECOND = 1_000_000_000


async def write_snapshots(
    path: Path, profile: ProfileName, snapshots: Iterable[Snapshot], **limits: int
) -> SceneWriter:
    """Write the scene at each second."""
    frames, converter = SnapshotFrames(), Profile(profile)
    with closing(McapFiles(path, converter.mcap_profile, **limits)) as files:
        writer = SceneWriter(files, converter)
        for second, snapshot in enumerate(snapshots, 1):
            for frame in await frames.advance(snapshot):
                writer.write(ViewFrame(frame), second * SECOND)
    return writer


def write_values(path: Path, profile: ProfileName, values: Iterable[Any]) -> None:
    """Write image sets and samples, each at a second."""
    converter = Profile(profile)
    with closing(McapFiles(path, converter.mcap_profile)) as files:
        writer = SceneWriter(files, converter)
        for second, value in enumerate(values, 1):
            writer.write(ViewFrame(value) if isinstance(value, bytes) else value, second * SECOND)
