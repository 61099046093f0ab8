"""Poses of a node over time from an LCM log, as the track of a scenario (``gateway.datasets.scenario.tracks``)."""

import csv
import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gateway.datasets.errors import DatasetError
from gateway.datasets.scenario.tracks import POSE_COLUMNS
from gateway.files.assets.mesh_files import MeshFiles
from gateway.replay.log_replay import LogReplay, is_shown
from gateway.scene.tree.nodes import Path as TreePath
from gateway.scene.tree.transforms import Matrix, quaternions_of


def track_csv_of_log(log: Path, node: TreePath) -> str:
    """Return the poses of a node in the world as CSV, at the times at which they change.

    Times are seconds since the log's first message. Raises DatasetError if the log never has the node or its pose is
    not finite, EventLogError or OSError.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(("time", *POSE_COLUMNS))
    last: Matrix | None = None
    for seconds, pose in _poses(log, node):
        if last is not None and np.array_equal(last, pose):
            continue
        if not np.isfinite(pose).all():
            raise DatasetError(f"{log}: at {seconds:g} s the pose of {list(node)} is not finite")
        # Messages in logs have poses, so that all nodes are rigid.
        writer.writerow((seconds, *pose[:3, 3].tolist(), *quaternions_of(pose[None, :3, :3])[0].tolist()))
        last = pose
    if last is None:
        raise DatasetError(f"{log}: it has no node at {list(node)}")
    return out.getvalue()


def _poses(log: Path, node: TreePath) -> Iterator[tuple[float, Matrix]]:
    """Yield the time and X_world_node after each message that the live tree shows, while it has the node."""
    with LogReplay(log, MeshFiles(())) as replay:  # the shapes of meshes do not matter
        begin = replay.next_time_ns
        if begin is None:
            return
        while (event := replay.next_event) is not None:
            replay.step()  # applies the event
            pose = replay.snapshot.root.world_matrix(node) if is_shown(event.channel) else None
            if pose is not None:
                yield (replay.clock.time_ns - begin) / 1e9, pose
