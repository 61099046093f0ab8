"""The open state file: what it restores, when it stores edits that no client waits for, and its figures."""

from pathlib import Path

import pytest

from gateway.adapters.stereo.device.parameters import Parameters
from gateway.runtime.state import service
from gateway.runtime.state.parameter_store import ParameterStore
from gateway.runtime.state.service import PersistentState
from gateway.runtime.state.tree_store import TreeStore
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
    state = PersistentState(tmp_path / "state")
    state.add(TreeStore(LiveTree()))
    state.start()
    status = state.status()
    assert (status["commits"], status["failed_commits"]) == (0, 0)
    assert (status["last_commit_ms"], status["longest_commit_ms"], status["waiting_bytes"]) == (0.0, 0.0, 0)
    assert status["file_bytes"] > 0
    await state.close()


async def test_edits_without_a_client_are_stored_after_a_while(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "IDLE_COMMIT_SECONDS", 0.0)
    path = tmp_path / "state"
    live = LiveTree()
    state = PersistentState(path)
    state.add(TreeStore(live))
    state.start()
    for name in ("a", "b"):
        commits = state.status()["commits"]
        edit(live, name)
        await until(lambda commits=commits: state.status()["commits"] > commits)  # type: ignore[misc]
    await state.close()

    restored = LiveTree()
    state = PersistentState(path)
    state.add(TreeStore(restored))
    state.start()
    assert set(restored.snapshot.root.children) == {"a", "b"}
    await state.close()


async def test_edits_are_stored_on_close(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "IDLE_COMMIT_SECONDS", 1000.0)
    path = tmp_path / "state"
    live, parameters = LiveTree(), Parameters()
    state = PersistentState(path)
    state.add(TreeStore(live, ("demo",)))
    state.add(ParameterStore("0", ["rc_camera"], parameters))
    state.start()
    edit(live, "a", "demo")
    parameters.set("rc_camera", [("fps", 5.0)])
    await state.close()

    restored, other, parameters = LiveTree(), Parameters(), Parameters()
    state = PersistentState(path)
    state.add(TreeStore(restored, ("demo",)))
    state.add(ParameterStore("1", ["rc_camera"], other))
    state.add(ParameterStore("0", ["rc_camera"], parameters))
    state.start()
    assert set(restored.snapshot.root.children) == {"a"}
    assert (parameters.values("rc_camera")["fps"], other.values("rc_camera")["fps"]) == (5.0, 25.0)
    await state.close()
