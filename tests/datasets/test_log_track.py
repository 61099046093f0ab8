"""Tracks of nodes in LCM logs."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from gateway.cli.commands import app
from gateway.datasets.errors import DatasetError
from gateway.datasets.log_track import track_csv_of_log
from gateway.datasets.scenario.tracks import read_track
from gateway.scene.tree.transforms import from_pose
from scenegate.lcm.event_log import EventLogError, pack_event
from tests.adapters.treeviewer.conversation import BOX, message
from tests.support.corpus import corpus_dir

HALF = 0.5**0.5


def log_of(path: Path, *requests: tuple[float, dict[str, object]]) -> Path:
    """Write a log with a request of a tree viewer client at each time, in seconds."""
    channel = "DIRECTOR_TREE_VIEWER_REQUEST_<me>"
    events = [pack_event(k, int(1e6 * (9 + t)), channel, message(each)) for k, (t, each) in enumerate(requests)]
    path.write_bytes(b"".join(events))
    return path


def moved(path: list[str], translation: list[float], quaternion: list[float]) -> dict[str, object]:
    return {"settransform": [{"path": path, "transform": {"translation": translation, "quaternion": quaternion}}]}


def test_poses_are_those_in_the_world(tmp_path: Path) -> None:
    """A row for each change, also of the node above; none before the node is there, or for other nodes."""
    log = log_of(
        tmp_path / "run.lcm",
        (0.0, moved(["arm"], [1, 0, 0], [HALF, 0, 0, HALF])),
        (0.5, {"setgeometry": [{"path": ["arm", "hand"], "geometry": BOX}]}),
        (1.0, moved(["other"], [1, 2, 3], [1, 0, 0, 0])),
        (1.5, moved(["arm", "hand"], [0, 2, 0], [1, 0, 0, 0])),
        (2.0, moved(["arm"], [0, 0, 5], [1, 0, 0, 0])),
    )
    out = tmp_path / "hand.csv"
    result = CliRunner().invoke(app, ["dataset", "track", str(log), '["arm", "hand"]', "-o", str(out)])
    assert result.exit_code == 0, result.stderr
    assert f"{out}: 3 poses" in result.stderr
    track = read_track(out, poses=True)
    assert track.times.tolist() == [0.5, 1.5, 2.0]
    turned, upright = (HALF, 0, 0, HALF), (1, 0, 0, 0)
    for time, position, quaternion in ((0.5, (1, 0, 0), turned), (1.5, (-1, 0, 0), turned), (2.0, (0, 2, 5), upright)):
        np.testing.assert_allclose(track.pose_at(time), from_pose(position, quaternion), atol=1e-15)


def test_what_is_no_track(tmp_path: Path) -> None:
    log = log_of(tmp_path / "run.lcm", (0.0, moved(["arm"], [1, 0, 0], [1, 0, 0, 0])))
    with pytest.raises(DatasetError, match=r"run\.lcm: it has no node at \['leg'\]$"):
        track_csv_of_log(log, ("leg",))
    (tmp_path / "text.lcm").write_text("no log")
    with pytest.raises(EventLogError):
        track_csv_of_log(tmp_path / "text.lcm", ("arm",))
    out = tmp_path / "leg.csv"
    result = CliRunner().invoke(app, ["dataset", "track", str(log), "leg", "-o", str(out)])
    assert "camera path 'leg' is not a JSON list" in str(result.exception)
    assert not out.exists()


def test_a_simulation_of_drake(tmp_path: Path) -> None:
    """A ball falls and comes to rest in a recorded simulation."""
    log = corpus_dir() / "drakeviewer" / "drake_default.lcmlog"
    if not log.is_file():
        pytest.skip("SCENEGATE_CORPUS has no log of Drake's channels")
    (tmp_path / "ball.csv").write_text(track_csv_of_log(log, ("drake", "proximity", "plant", "ball", "ball")))
    track = read_track(tmp_path / "ball.csv", poses=True)
    assert len(track.times) > 100
    heights = track.values[:, track.names.index("z")]
    assert heights[0] == pytest.approx(0.15)
    assert (np.diff(heights[:8]) < 0.0).all()
    assert heights[-1] == pytest.approx(0.0961, abs=1e-4)  # it lies on the ground
    np.testing.assert_allclose(np.linalg.norm(track.values[:, 3:], axis=1), 1.0, atol=1e-12)
