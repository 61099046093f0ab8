"""``scenegate convert``: the scene of LCM logs in MCAP files."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from gateway.cli.commands import app
from scenegate.lcm.event_log import pack_event
from tests.adapters.treeviewer.conversation import BOX
from tests.client.recording.readers import foxglove_messages, foxglove_scene, ros2_messages, ros2_scene
from tests.datasets.test_log_track import log_of, moved
from tests.support.corpus import corpus_dir

pytest.importorskip("mcap_ros2", reason="needs the extra mcap")


@pytest.mark.parametrize("profile", ["foxglove", "ros2"])
def test_messages_of_tree_viewer_clients(tmp_path: Path, profile: str) -> None:
    log = log_of(
        tmp_path / "run.lcm",
        (0.0, {"setgeometry": [{"path": ["arm", "hand"], "geometry": BOX}]}),
        (1.5, moved(["arm"], [1, 2, 3], [1, 0, 0, 0])),
    )
    out = tmp_path / "run.mcap"
    result = CliRunner().invoke(app, ["convert", str(log), str(out), "--profile", profile])
    assert result.exit_code == 0, result.stderr
    assert f"{out}: 2 messages of the scene, 3 written, " in result.stderr
    read, scene = (foxglove_messages, foxglove_scene) if profile == "foxglove" else (ros2_messages, ros2_scene)
    messages = list(read(out))
    assert [message.log_time for message in messages] == [9_000_000_000, 9_000_000_000, 10_500_000_000]
    np.testing.assert_allclose(scene(out).world("scene/arm/hand")[:3, 3], (1, 2, 3))
    assert list(scene(out).geometry) == ["scene/arm/hand"]


def test_a_log_of_drake(tmp_path: Path) -> None:
    """Robots, contacts, frames and point clouds move as they do in the live scene."""
    log, out = corpus_dir() / "drakeviewer" / "drake_default.lcmlog", tmp_path / "drake.mcap"
    if not log.is_file():
        pytest.skip("SCENEGATE_CORPUS has no log of Drake's channels")
    result = CliRunner().invoke(app, ["convert", str(log), str(out)])
    assert result.exit_code == 0, result.stderr
    assert "no load message was received" in result.stderr
    topics = {message.topic for message in foxglove_messages(out)}
    assert {"/tf", "/scene"} <= topics
    assert any(frame.startswith("scene/drake/") for frame in foxglove_scene(out).geometry)


def test_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.lcm").write_bytes(b"no log at all" * 100)
    result = CliRunner().invoke(app, ["convert", str(tmp_path / "a.lcm"), str(tmp_path / "a.mcap")])
    assert result.exit_code == 1
    assert "this is not an LCM log" in str(result.exception)


def test_a_log_with_nothing_to_show_is_refused(tmp_path: Path) -> None:
    log, out = tmp_path / "a.lcm", tmp_path / "a.mcap"
    log.write_bytes(pack_event(0, 9_000_000, "IMU", b"x"))
    result = CliRunner().invoke(app, ["convert", str(log), str(out)])
    assert result.exit_code == 1
    assert "no channel of the log can be shown" in str(result.exception)
    assert not out.exists()


def test_other_channels_do_not_count(tmp_path: Path) -> None:
    log, out = log_of(tmp_path / "a.lcm", (0.0, moved(["arm"], [1, 2, 3], [1, 0, 0, 0]))), tmp_path / "a.mcap"
    log.write_bytes(log.read_bytes() + pack_event(1, 9_500_000, "IMU", b"x"))
    result = CliRunner().invoke(app, ["convert", str(log), str(out)])
    assert f"{out}: 1 messages of the scene, 1 written, " in result.stderr


def test_a_log_that_was_cut_off(tmp_path: Path) -> None:
    log = log_of(tmp_path / "a.lcm", *((float(second), moved(["arm"], [1, 2, 3], [1, 0, 0, 0])) for second in range(3)))
    data = log.read_bytes()
    log.write_bytes(data[:-10])
    result = CliRunner().invoke(app, ["convert", str(log), str(tmp_path / "a.mcap")])
    assert result.exit_code == 0, result.stderr
    size, event = len(data) - 10, len(data) // 3
    text = f"{log}: {size - 2 * event} of {size} bytes are damaged or cut off; 2 complete messages were read"
    assert text in result.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk(tmp_path: Path) -> None:
    log = log_of(tmp_path / "a.lcm", (0.0, moved(["arm"], [1, 2, 3], [1, 0, 0, 0])))
    error = CliRunner().invoke(app, ["convert", str(log), "/dev/full"]).exception
    assert isinstance(error, OSError)
    assert (error.filename, error.strerror) == ("/dev/full", "No space left on device")


def test_the_log_is_not_overwritten(tmp_path: Path) -> None:
    log = log_of(tmp_path / "a.lcm", (0.0, moved(["arm"], [1, 2, 3], [1, 0, 0, 0])))
    data = log.read_bytes()
    result = CliRunner().invoke(app, ["convert", str(log), str(log)])
    assert "a.lcm is the log itself" in str(result.exception)
    assert log.read_bytes() == data


def test_mesh_files_are_read_as_by_view_and_export(tmp_path: Path) -> None:
    """In the log's folder by default; also in ``--mesh-root``. Warnings name the channel."""
    mesh = tmp_path / "meshes" / "a.obj"
    mesh.parent.mkdir()
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    geometry = {"type": "mesh_file", "filename": str(mesh)}
    request: dict[str, object] = {"setgeometry": [{"path": ["a"], "geometry": geometry}]}
    out, elsewhere = tmp_path, tmp_path / "elsewhere"
    elsewhere.mkdir()
    inside, outside = (log_of(folder / "a.lcm", (0.0, request)) for folder in (tmp_path, elsewhere))
    cases: list[tuple[Path, list[str], list[str]]] = [
        (inside, [], ["scene/a"]),
        (inside, ["--mesh-root", "off"], []),
        (outside, [], []),
        (outside, ["--mesh-root", str(mesh.parent)], ["scene/a"]),
    ]
    for number, (log, options, shown) in enumerate(cases):
        result = CliRunner().invoke(app, ["convert", str(log), str(out / f"{number}.mcap"), *options])
        assert result.exit_code == 0, result.stderr
        assert list(foxglove_scene(out / f"{number}.mcap").geometry) == shown
        assert ("messages that are not shown completely: 1; the first one: " in result.stderr) == (not shown)
