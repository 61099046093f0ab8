"""Who waits is told when it is stored, in order; what cannot be stored is told, and stored as soon as it can be."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway.scene.geometry import Box, Part, PointCloud
from gateway.scene.live import LiveTree
from gateway.state.config import StateConfig
from gateway.state.service import State
from renderers.drawlist import Material
from tests.state import trees
from tests.support.waiting import SECONDS, until

BOX = (Part(Box((1.0, 2.0, 3.0)), Material()),)


class Kept:
    """A live tree with its state."""

    def __init__(self, config: StateConfig) -> None:
        self.live = LiveTree()
        self.state = State(config)
        self.state.restore_tree(self.live)

    def put(self, name: str, parts: tuple[Part, ...] = BOX) -> None:
        with self.live.edit() as edit:
            edit.set_parts((name,), parts)

    def sql(self, statement: str) -> Any:
        return self.state._database.writer.execute(statement).fetchone()[0]


@pytest.fixture
def config(tmp_path: Path) -> StateConfig:
    return StateConfig(tmp_path / "state")


@pytest.fixture
async def kept(config: StateConfig) -> AsyncIterator[Kept]:
    kept = Kept(config)
    kept.state.start()
    yield kept
    async with asyncio.timeout(SECONDS):
        await kept.state.close()


class Slow:
    """A store that writes when it is allowed to."""

    def __init__(self) -> None:
        self.allowed = threading.Event()
        self.writing = threading.Event()
        self.writes = 0

    def capture(self) -> int:
        return self.writes

    def write(self, connection: object, captured: int) -> bool:
        self.writing.set()
        assert self.allowed.wait(SECONDS)
        self.writes += 1
        return True

    def committed(self, captured: int) -> None:
        pass


async def happened(event: threading.Event) -> None:
    async with asyncio.timeout(SECONDS):
        assert await asyncio.to_thread(event.wait, SECONDS)


async def test_what_was_waited_for_is_in_the_file(kept: Kept, config: StateConfig) -> None:
    for name in "abc":
        kept.put(name)
        assert await kept.state.journal.stored() == ""
        assert kept.sql("SELECT count(*) FROM tree_node") == len(kept.live.snapshot.root.children) + 1


async def test_a_turn_of_the_loop_is_one_transaction_and_all_are_told_in_order(kept: Kept) -> None:
    told: list[int] = []
    commits = kept.state.journal.figures.commits
    for number in range(100):
        kept.put(f"node {number}")
        kept.state.journal.after(lambda problem, number=number: told.append(number))
    assert await kept.state.journal.stored() == ""
    assert told == list(range(100))
    assert kept.state.journal.figures.commits == commits + 1


async def test_what_comes_while_it_writes_is_the_next_transaction(kept: Kept) -> None:
    slow = Slow()
    kept.state.journal.add(slow)
    told: list[str] = []
    kept.state.journal.after(lambda problem: told.append("first"), 10)
    await happened(slow.writing)
    for number in range(5):
        kept.put(f"node {number}")
        kept.state.journal.after(lambda problem, number=number: told.append(f"then {number}"), 10)
        await asyncio.sleep(0)
    assert told == []
    assert kept.state.journal.waiting_bytes == 60
    slow.allowed.set()
    assert await kept.state.journal.stored() == ""
    assert told == ["first", *(f"then {number}" for number in range(5))]
    assert slow.writes <= 3
    assert kept.state.journal.waiting_bytes == 0


async def test_it_says_when_too_much_waits(config: StateConfig) -> None:
    kept = Kept(replace(config, waiting_answer_bytes=50))
    kept.state.start()
    slow = Slow()
    kept.state.journal.add(slow)
    kept.state.journal.after(lambda problem: None, 51)
    assert kept.state.journal.full
    slow.allowed.set()
    await kept.state.journal.stored()
    assert not kept.state.journal.full
    await kept.state.close()


async def test_a_full_disk_is_told_and_nothing_is_lost_when_there_is_room_again(
    kept: Kept, config: StateConfig
) -> None:
    problems: list[str] = []
    kept.state.journal.on_problem = problems.append
    kept.put("before")
    assert await kept.state.journal.stored() == ""
    pages = kept.sql("PRAGMA page_count")
    kept.sql(f"PRAGMA max_page_count = {pages + 1}")
    kept.put("cloud", (Part(PointCloud(np.ones((10_000, 3), np.float32)), Material()),))
    assert await kept.state.journal.stored() == "the disk is full"
    kept.put("after")
    assert await kept.state.journal.stored() == "the disk is full"
    assert problems == ["the disk is full"]
    assert kept.sql("SELECT count(*) FROM tree_node") == 2
    kept.sql("PRAGMA max_page_count = 1000000")
    assert await kept.state.journal.stored() == ""
    assert problems == ["the disk is full", ""]
    before = trees.tree(kept.live.snapshot.root)
    await kept.state.close()
    again = Kept(config)
    assert trees.tree(again.live.snapshot.root) == before
    kept.state = again.state
    kept.state.start()


async def test_a_defect_is_told_and_does_not_end_the_writing(kept: Kept, caplog: pytest.LogCaptureFixture) -> None:
    class Broken(Slow):
        def write(self, connection: object, captured: int) -> bool:
            raise ZeroDivisionError("of ours")

    broken = Broken()
    kept.state.journal.add(broken)
    assert await kept.state.journal.stored() == "internal error: ZeroDivisionError: of ours"
    kept.state.journal._stores.remove(broken)
    assert await kept.state.journal.stored() == ""


async def test_edits_that_nobody_waits_for_are_stored_a_moment_later(config: StateConfig) -> None:
    kept = Kept(replace(config, lazy_seconds=0.0))
    kept.state.start()
    kept.state.keep_tree(kept.live)
    kept.put("quiet")
    await until(lambda: kept.state.status()["commits"])
    assert kept.sql("SELECT count(*) FROM tree_node") == 2
    await kept.state.close()


async def test_closing_stores_what_is_left(config: StateConfig) -> None:
    kept = Kept(config)
    kept.state.start()
    kept.put("last")
    await kept.state.close()
    again = Kept(config)
    assert list(again.live.snapshot.root.children) == ["last"]
    await again.state.close()


async def test_a_long_log_is_moved_into_the_file(config: StateConfig) -> None:
    kept = Kept(replace(config, checkpoint_bytes=1 << 16, most_log_bytes=1 << 18))
    kept.state.start()
    chance = np.random.default_rng(1)
    for _ in range(20):
        kept.put("cloud", (Part(PointCloud(chance.random((10_000, 3), np.float32)), Material()),))
        assert await kept.state.journal.stored() == ""
        assert kept.state.status()["log_bytes"] < 1 << 20
    assert kept.state.status()["file_bytes"] < 1 << 20, "blobs that nothing names are collected"
    await kept.state.close()
