"""Order of callbacks, grouping of changes, failures and recovery."""

import asyncio
import threading
from collections.abc import AsyncIterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import structlog.testing

from gateway.runtime.state import database, service
from gateway.runtime.state.service import PersistentState
from gateway.runtime.state.tree_store import TreeStore
from gateway.scene.tree.geometry import Part, PointCloud
from gateway.scene.tree.live import LiveTree
from renderers.drawlist import Material
from scenegate.messages.geometry import Box
from tests.runtime.state import trees
from tests.support.waiting import SECONDS, until

BOX = (Part(Box((1.0, 2.0, 3.0)), Material()),)


class Kept:
    """A live tree with a persistent state."""

    def __init__(self, path: Path) -> None:
        self.live = LiveTree()
        self.state = PersistentState(path)
        self.state.add(TreeStore(self.live))

    def put(self, name: str, parts: tuple[Part, ...] = BOX) -> None:
        with self.live.edit() as edit:
            edit.set_parts((name,), parts)

    def sql(self, statement: str) -> Any:
        return self.state.database.connection.execute(statement).fetchone()[0]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "state"


@pytest.fixture
async def kept(path: Path) -> AsyncIterator[Kept]:
    kept = Kept(path)
    kept.state.start()
    yield kept
    async with asyncio.timeout(SECONDS):
        await kept.state.close()


class Slow:
    """A store whose writes block until the test allows them."""

    def __init__(self) -> None:
        self.allowed = threading.Event()
        self.writing = threading.Event()
        self.writes = 0

    def restore(self, connection: object) -> int:
        return self.writes

    def capture(self) -> int:
        return self.writes

    def write(self, connection: object, stored: int, captured: int) -> bool:
        self.writing.set()
        assert self.allowed.wait(SECONDS)
        self.writes += 1
        return True


async def wait_for(event: threading.Event) -> None:
    async with asyncio.timeout(SECONDS):
        assert await asyncio.to_thread(event.wait, SECONDS)


async def test_awaited_changes_are_in_the_file(kept: Kept) -> None:
    for name in "abc":
        kept.put(name)
        assert await kept.state.wait_until_stored() == ""
        assert kept.sql("SELECT count(*) FROM tree_node") == len(kept.live.snapshot.root.children) + 1


async def test_changes_of_one_turn_are_one_transaction(kept: Kept) -> None:
    called: list[int] = []

    def note(number: int, problem: str) -> None:
        called.append(number)

    commits = kept.state.status()["commits"]
    for number in range(100):
        kept.put(f"node {number}")
        kept.state.call_when_stored(partial(note, number))
    assert await kept.state.wait_until_stored() == ""
    assert called == list(range(100))
    assert kept.state.status()["commits"] == commits + 1


async def test_the_reason_of_a_failure_names_no_path(kept: Kept) -> None:
    class Full(Slow):
        def write(self, connection: object, stored: int, captured: int) -> bool:
            raise OSError(28, "No space left on device", "/home/robot/scene.state")

    kept.state.add(Full())
    kept.put("a")
    assert await kept.state.wait_until_stored() == "No space left on device"


async def test_changes_during_a_commit_are_the_next_transaction(kept: Kept) -> None:
    slow = Slow()
    kept.state.add(slow)
    called: list[str] = []

    def note(name: str, problem: str) -> None:
        called.append(name)

    kept.state.call_when_stored(lambda problem: called.append("first"), 10)
    await wait_for(slow.writing)
    for number in range(5):
        kept.put(f"node {number}")
        kept.state.call_when_stored(partial(note, f"then {number}"), 10)
        await asyncio.sleep(0)
    assert called == []
    assert kept.state.waiting_bytes == 60
    slow.allowed.set()
    assert await kept.state.wait_until_stored() == ""
    assert called == ["first", *(f"then {number}" for number in range(5))]
    assert slow.writes <= 3
    assert kept.state.waiting_bytes == 0


async def test_full_above_the_limit_of_waiting_bytes(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "MAX_WAITING_BYTES", 50)
    kept = Kept(path)
    kept.state.start()
    slow = Slow()
    kept.state.add(slow)
    kept.state.call_when_stored(lambda problem: None, 50)
    full = [kept.state.full]
    kept.state.call_when_stored(lambda problem: None, 1)
    full.append(kept.state.full)
    assert full == [False, True], "the limit itself is allowed"
    slow.allowed.set()
    await kept.state.wait_until_stored()
    assert not kept.state.full
    await kept.state.close()


async def test_full_disk_is_reported_and_later_commits_store_everything(kept: Kept, path: Path) -> None:
    problems: list[str] = []
    kept.state.on_problem = problems.append
    kept.put("before")
    assert await kept.state.wait_until_stored() == ""
    pages = kept.sql("PRAGMA page_count")
    kept.sql(f"PRAGMA max_page_count = {pages + 1}")
    kept.put("cloud", (Part(PointCloud(np.ones((10_000, 3), np.float32)), Material()),))
    assert await kept.state.wait_until_stored() == "database or disk is full"
    kept.put("after")
    assert await kept.state.wait_until_stored() == "database or disk is full"
    assert problems == ["database or disk is full"]
    assert kept.state.status()["failed_commits"] == 2
    assert kept.sql("SELECT count(*) FROM tree_node") == 2
    kept.sql("PRAGMA max_page_count = 1000000")
    assert await kept.state.wait_until_stored() == ""
    assert problems == ["database or disk is full", ""]
    before = trees.tree(kept.live.snapshot.root)
    await kept.state.close()
    again = Kept(path)
    assert trees.tree(again.live.snapshot.root) == before
    kept.state = again.state
    kept.state.start()


async def test_internal_errors_are_reported_and_later_commits_succeed(
    kept: Kept, caplog: pytest.LogCaptureFixture
) -> None:
    class Broken(Slow):
        broken = True

        def write(self, connection: object, stored: int, captured: int) -> bool:
            if self.broken:
                raise ZeroDivisionError("of ours")
            return False

    broken = Broken()
    kept.state.add(broken)
    assert await kept.state.wait_until_stored() == "internal error: ZeroDivisionError: of ours"
    broken.broken = False
    assert await kept.state.wait_until_stored() == ""


async def test_idle_edits_are_stored_after_a_delay(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "IDLE_COMMIT_SECONDS", 0.0)
    kept = Kept(path)
    kept.state.start()
    for count, name in enumerate(("quiet", "later"), 2):
        kept.put(name)
        await until(lambda count=count: kept.sql("SELECT count(*) FROM tree_node") == count)  # type: ignore[misc]  # a default
    await kept.state.close()


async def test_close_stores_the_last_edits(path: Path) -> None:
    kept = Kept(path)
    kept.state.start()
    kept.put("last")
    await kept.state.close()
    again = Kept(path)
    assert list(again.live.snapshot.root.children) == ["last"]
    await again.state.close()


@pytest.mark.parametrize("is_full", [True, False])
async def test_edits_that_close_cannot_store_are_logged(path: Path, is_full: bool) -> None:
    kept = Kept(path)
    kept.state.start()
    if is_full:
        kept.sql(f"PRAGMA max_page_count = {kept.sql('PRAGMA page_count')}")
    kept.put("cloud", (Part(PointCloud(np.ones((10_000, 3), np.float32)), Material()),))
    with structlog.testing.capture_logs() as logs:
        await kept.state.close()
    lost = [entry for entry in logs if entry["event"] == "last edits could not be stored"]
    assert [(entry["reason"], entry["path"]) for entry in lost] == [("database or disk is full", str(path))] * is_full


async def test_log_is_checkpointed_beyond_its_limit(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(database, "CHECKPOINT_BYTES", 1 << 16)
    kept = Kept(path)
    kept.state.start()
    chance = np.random.default_rng(1)
    for _ in range(20):
        kept.put("cloud", (Part(PointCloud(chance.random((10_000, 3), np.float32)), Material()),))
        assert await kept.state.wait_until_stored() == ""
        assert kept.state.status()["log_bytes"] < 1 << 20
    assert kept.state.status()["file_bytes"] < 1 << 20, "unused blobs are deleted"
    await kept.state.close()
