"""The open state file: what it restores, when it stores edits that no client waits for, and its figures."""

from __future__ import annotations

from pathlib import Path

from structlog.testing import capture_logs

from gateway.adapters.stereo.device.parameters import Parameters
from gateway.runtime.state.service import PersistentState, StateConfig
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.live import LiveTree
from renderers.drawlist import Material
from scenegate.messages.geometry import Box
from tests.support.waiting import until


def edit(live: LiveTree, *names: str) -> None:
    with live.edit() as change:
        for name in names:
            change.set_parts((name,), (Part(Box((1, 1, 1)), Material()),))


async def test_a_new_file_has_nothing_to_restore(tmp_path: Path) -> None:
    state = PersistentState(StateConfig(tmp_path / "state"))
    with capture_logs() as entries:
        state.restore_tree(LiveTree())
    state.start()
    status = state.status()
    assert (status["restored_nodes"], status["commits"], status["failed_commits"]) == (0, 0, 0)
    assert (status["last_commit_ms"], status["longest_commit_ms"], status["waiting_bytes"]) == (0.0, 0.0, 0)
    assert status["file_bytes"] > 0
    assert entries == []
    await state.close()


async def test_edits_without_a_client_are_stored_after_a_while(tmp_path: Path) -> None:
    path = tmp_path / "state"
    live = LiveTree()
    state = PersistentState(StateConfig(path, idle_commit_seconds=0.0))
    state.restore_tree(live)
    state.start()
    for name in ("a", "b"):
        commits = state.status()["commits"]
        edit(live, name)
        await until(lambda commits=commits: state.status()["commits"] > commits)  # type: ignore[misc]
    await state.close()

    restored = LiveTree()
    state = PersistentState(StateConfig(path))
    with capture_logs() as entries:
        state.restore_tree(restored)
    state.start()
    assert set(restored.snapshot.root.children) == {"a", "b"}
    assert state.status()["restored_nodes"] == 2, "without the root"
    assert [(entry["event"], entry["nodes"]) for entry in entries] == [("tree restored", 2)]
    await state.close()


async def test_edits_are_stored_on_close(tmp_path: Path) -> None:
    path = tmp_path / "state"
    live, parameters = LiveTree(), Parameters()
    state = PersistentState(StateConfig(path, idle_commit_seconds=1000.0))
    state.restore_tree(live, excluded=("demo",))
    state.restore_parameters("0", lambda: ["rc_camera"], parameters)
    state.start()
    edit(live, "a", "demo")
    parameters.set("rc_camera", [("fps", 5.0)])
    await state.close()

    restored, other, parameters = LiveTree(), Parameters(), Parameters()
    state = PersistentState(StateConfig(path))
    state.restore_tree(restored, excluded=("demo",))
    state.restore_parameters("1", lambda: ["rc_camera"], other)
    state.restore_parameters("0", lambda: ["rc_camera"], parameters)
    state.start()
    assert set(restored.snapshot.root.children) == {"a"}
    assert (parameters.values("rc_camera")["fps"], other.values("rc_camera")["fps"]) == (5.0, 25.0)
    await state.close()
