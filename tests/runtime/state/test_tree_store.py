"""The tree in the database against a tree in memory."""

import sqlite3
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


class Stored:
    """A tree store, and what it has stored."""

    def __init__(self, database: Database, live: LiveTree, excluded: tuple[str, ...] = ()) -> None:
        self.database, self.store = database, TreeStore(live, excluded)
        self.root = Node()

    def restore(self) -> None:
        self.root = self.store.restore(self.database.connection)

    def write(self, end: str = "COMMIT") -> bool:
        captured = self.store.capture()
        self.database.connection.execute("BEGIN IMMEDIATE")
        wrote = self.store.write(self.database.connection, self.root, captured)
        self.database.connection.execute(end)
        if end == "COMMIT":
            self.root = captured
        return wrote


def restored(database: Database, excluded: tuple[str, ...] = ()) -> Node:
    live = LiveTree()
    TreeStore(live, excluded).restore(database.connection)
    return live.snapshot.root


def check_uses(connection: sqlite3.Connection) -> None:
    """Assert that there are the blobs that nodes use, and no others."""
    blobs, uses, parts = (
        {digest for (digest,) in connection.execute(f"SELECT DISTINCT {column} FROM {table} WHERE {column} NOT NULL")}
        for column, table in (("digest", "tree_blob"), ("digest", "tree_use"), ("parts", "tree_node"))
    )
    assert blobs == uses >= parts


class StoreMachine(RuleBasedStateMachine):
    """Random edits, commits, failed commits and restarts."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = TemporaryDirectory()
        self.database = Database(File(self.folder.name) / "state")
        self.begin()

    @initialize()
    def begin(self) -> None:
        self.live = LiveTree()
        self.stored = Stored(self.database, self.live, ("demo",))
        self.stored.restore()

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
        self.stored.write()
        assert not self.stored.write(), "nothing changed since the last commit"

    @rule()
    def fail(self) -> None:
        self.stored.write("ROLLBACK")

    @rule()
    def restart(self) -> None:
        self.stored.write()
        self.database.close()
        before = trees.tree(self.live.snapshot.root, (("demo",),))
        self.database = Database(File(self.folder.name) / "state")
        self.begin()
        assert trees.tree(self.live.snapshot.root) == before

    @invariant()
    def uses_are_counted(self) -> None:
        check_uses(self.database.connection)

    def teardown(self) -> None:
        try:
            self.stored.write()
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
    stored = Stored(database, live)
    with live.edit() as edit:
        for name in "abcd":
            edit.set_parts((name, "below"), GEOMETRY[1])
    stored.write()
    with live.edit() as edit:
        edit.delete(("b",))
        edit.set_parts(("new",), ())
        edit.set_parts(("b",), GEOMETRY[1])
    stored.write()
    assert list(restored(database).children) == ["a", "c", "d", "new", "b"]
    assert trees.tree(restored(database)) == trees.tree(live.snapshot.root)


def test_new_pose_writes_one_row(database: Database) -> None:
    live = LiveTree()
    stored = Stored(database, live)
    with live.edit() as edit:
        edit.set_parts(("a",), GEOMETRY[2])
    stored.write()
    before = database.connection.total_changes
    with live.edit() as edit:
        edit.set_pose(("a",), (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    stored.write()
    assert database.connection.total_changes - before == 1


def test_excluded_children_are_not_restored(database: Database) -> None:
    live = LiveTree()
    with live.edit() as edit:
        edit.set_parts(("demo", "own"), ())
        edit.set_parts(("other",), ())
    Stored(database, live).write()
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
    Stored(database, live).write()
    database.connection.execute(damage)
    with pytest.raises(Exception):  # noqa: B017, PT011 - whichever way it is found
        restored(database)
