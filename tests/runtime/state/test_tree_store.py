"""The tree in the database against a tree in memory."""

from __future__ import annotations

import sqlite3
from collections import Counter
from pathlib import Path as File
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from gateway.runtime.state.database import Database
from gateway.runtime.state.tree_store import TreeStore
from gateway.scene.tree.geometry import Part, PointCloud
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.nodes import Node, Path
from gateway.scene.tree.transforms import translation
from renderers.drawlist import Material
from scenegate.messages.geometry import Box
from tests.runtime.state import trees

MATERIAL = Material()
GEOMETRY: tuple[tuple[Part, ...], ...] = (
    (),
    (Part(Box((1.0, 2.0, 3.0)), MATERIAL),),
    (Part(PointCloud(np.arange(300, dtype=np.float32).reshape(100, 3)), MATERIAL),),
    (
        Part(PointCloud(np.arange(300, dtype=np.float32).reshape(100, 3)), MATERIAL),
        Part(PointCloud(np.ones((200, 3), np.float32), {"rgb": np.ones((200, 3), np.float32)}), MATERIAL),
    ),
)
paths = st.lists(st.sampled_from(["a", "b", 1, "1", "a/b", "\ud800", "demo"]), max_size=4).map(tuple)
poses = st.tuples(*[st.floats()] * 7)


def write(database: Database, store: TreeStore) -> bool:
    captured = store.capture()
    database.connection.execute("BEGIN IMMEDIATE")
    wrote = store.write(database.connection, captured)
    database.connection.execute("COMMIT")
    store.committed(captured)
    return wrote


def restored(database: Database, excluded: tuple[str, ...] = ()) -> Node:
    live = LiveTree()
    TreeStore(live, excluded).restore(database.connection)
    return live.snapshot.root


def check_uses(connection: sqlite3.Connection) -> None:
    """Assert that every blob is counted as often as nodes refer to it."""
    uses: Counter[bytes] = Counter()
    for (digests,) in connection.execute("SELECT parts FROM tree_node WHERE parts NOT NULL"):
        uses.update(digests[begin : begin + 32] for begin in range(0, len(digests), 32))
    assert dict(connection.execute("SELECT digest, uses FROM tree_blob")) == uses


class StoreMachine(RuleBasedStateMachine):
    """Random edits, commits, failed commits and restarts."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = TemporaryDirectory()
        self.database = Database(File(self.folder.name) / "state")
        self.live = LiveTree()
        self.store = TreeStore(self.live, ["demo"])

    @initialize()
    def begin(self) -> None:
        self.store.restore(self.database.connection)

    @rule(path=paths, which=st.integers(0, len(GEOMETRY) - 1))
    def geometry(self, path: Path, which: int) -> None:
        with self.live.edit() as edit:
            edit.set_parts(path, GEOMETRY[which])

    @rule(path=paths, pose=poses)
    def pose(self, path: Path, pose: Any) -> None:
        with self.live.edit() as edit:
            edit.set_pose(path, pose)

    @rule(path=paths, x=st.floats(-9, 9))
    def matrix(self, path: Path, x: float) -> None:
        with self.live.edit() as edit:
            edit.set_matrix(path, translation(x, 0.0, 0.0))

    @rule(path=paths, visible=st.booleans())
    def visible(self, path: Path, visible: bool) -> None:
        with self.live.edit() as edit:
            edit.set_visible(path, visible)

    @rule(path=paths, opacity=st.sampled_from([0.0, 0.5, 1.0]))
    def opacity(self, path: Path, opacity: float) -> None:
        with self.live.edit() as edit:
            edit.set_opacity(path, opacity)

    @rule(path=paths)
    def delete(self, path: Path) -> None:
        with self.live.edit() as edit:
            edit.delete(path)

    @rule()
    def commit(self) -> None:
        write(self.database, self.store)
        assert not write(self.database, self.store), "nothing changed since the last commit"

    @rule()
    def fail(self) -> None:
        self.database.connection.execute("BEGIN IMMEDIATE")
        self.store.write(self.database.connection, self.store.capture())
        self.database.connection.execute("ROLLBACK")

    @rule()
    def restart(self) -> None:
        write(self.database, self.store)
        self.database.close()
        before = trees.tree(self.live.snapshot.root, (("demo",),))
        self.database = Database(File(self.folder.name) / "state")
        self.live = LiveTree()
        self.store = TreeStore(self.live, ["demo"])
        self.store.restore(self.database.connection)
        assert trees.tree(self.live.snapshot.root) == before

    @invariant()
    def uses_are_counted(self) -> None:
        check_uses(self.database.connection)

    def teardown(self) -> None:
        try:
            write(self.database, self.store)
            check_uses(self.database.connection)
            assert trees.tree(restored(self.database)) == trees.tree(self.live.snapshot.root, (("demo",),))
        finally:
            self.database.close()
            self.folder.cleanup()


TestStore = StoreMachine.TestCase
TestStore.settings = settings(deadline=None, max_examples=40, stateful_step_count=25)


@pytest.fixture
def database(tmp_path: File) -> Any:
    database = Database(tmp_path / "state")
    yield database
    database.close()


def test_order_of_siblings_is_restored(database: Database) -> None:
    live = LiveTree()
    store = TreeStore(live)
    with live.edit() as edit:
        for name in "abcd":
            edit.set_parts((name, "below"), GEOMETRY[1])
    write(database, store)
    with live.edit() as edit:
        edit.delete(("b",))
        edit.set_parts(("new",), ())
        edit.set_parts(("b",), GEOMETRY[1])
    write(database, store)
    assert list(restored(database).children) == ["a", "c", "d", "new", "b"]
    assert trees.tree(restored(database)) == trees.tree(live.snapshot.root)


def test_new_pose_writes_one_row(database: Database) -> None:
    live = LiveTree()
    store = TreeStore(live)
    with live.edit() as edit:
        edit.set_parts(("a",), GEOMETRY[2])
    write(database, store)
    before = database.connection.total_changes
    with live.edit() as edit:
        edit.set_pose(("a",), (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    write(database, store)
    assert database.connection.total_changes - before == 1


def test_excluded_children_are_not_restored(database: Database) -> None:
    live = LiveTree()
    with live.edit() as edit:
        edit.set_parts(("demo", "own"), ())
        edit.set_parts(("other",), ())
    write(database, TreeStore(live))
    assert list(restored(database, ("demo",)).children) == ["other"]


@pytest.mark.parametrize(
    "damage",
    [
        "UPDATE tree_node SET path = 'ff' WHERE seq > 0",
        "UPDATE tree_node SET transform = x'00' WHERE seq > 0",
        "UPDATE tree_node SET parts = x'90' WHERE seq > 0",
        "DELETE FROM tree_blob",
        "UPDATE tree_blob SET data = zeroblob(1200)",
    ],
)
def test_rejects_damaged_tables(database: Database, damage: str) -> None:
    live = LiveTree()
    with live.edit() as edit:
        edit.set_parts(("a",), GEOMETRY[2])
    write(database, TreeStore(live))
    database.connection.execute(damage)
    with pytest.raises(Exception):  # noqa: B017, PT011 - whichever way it is found
        restored(database)
