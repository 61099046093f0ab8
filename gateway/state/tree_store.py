"""The live tree in the database: what changed since the last time is written, by path; all of it is read at start."""

from __future__ import annotations

import hashlib
import sqlite3
import struct
from collections.abc import Hashable, Iterable
from typing import Final

import numpy as np

from gateway.scene.geometry import Part
from gateway.scene.live import LiveTree, Snapshot
from gateway.scene.transforms import IDENTITY
from gateway.scene.tree import Node, Path, TreeEdit
from gateway.state.keys import AFTER, path_of
from gateway.state.parts import DamagedError, PartsReader, PartsWriter
from gateway.state.tree_diff import Difference, compare

ROWS_AT_ONCE: Final = 500
"""Asked for in one statement."""
_POSE: Final = struct.Struct("<7d")
_MATRIX_BYTES: Final = 16 * 8


class TreeStore:
    """One live tree: ``restore`` at start, then ``capture`` by its writers and ``write`` in the journal's thread."""

    def __init__(self, live: LiveTree, without: Iterable[str] = ()) -> None:
        """``without``: children of the root that are neither stored nor restored, with all below them."""
        self._live = live
        self._without = frozenset(without)
        self._root = Node()
        """As it is in the database."""
        self._seq = self._next_seq = 0
        self._parts = PartsWriter()
        self.restored = 0
        """Nodes read at start."""

    def capture(self) -> Snapshot:
        """What ``write`` gets."""
        return self._live.snapshot

    def write(self, connection: sqlite3.Connection, captured: Snapshot) -> bool:
        """Brings the tables to ``captured`` within the caller's transaction; returns whether anything was to do."""
        difference = compare(self._root, captured.root, self._seq, self._without)
        self._next_seq = difference.seq
        if difference:
            _Rows(connection, self._parts).write(difference)
        return bool(difference)

    def committed(self, captured: Snapshot) -> None:
        """The transaction has succeeded."""
        self._root = captured.root
        self._seq = self._next_seq

    def restore(self, connection: sqlite3.Connection) -> None:
        """Puts the stored tree into the live one, which is empty, as one revision.

        Raises:
            DamagedError: the tables hold something else than this class writes.
        """
        rows = []
        for key, seq, digest, transform, visible in connection.execute(
            "SELECT path, seq, parts, transform, visible FROM tree_node"
        ):
            path = _path(key)
            self._seq = max(self._seq, seq)
            if not path or path[0] not in self._without:
                rows.append((len(path), seq, path, digest, transform, visible))
        rows.sort(key=lambda row: row[:2])  # parents first, siblings as they were
        if len(rows) <= 1 and rows[0][3:] == (None, None, 1):
            return
        reader = PartsReader(lambda digest: _data(connection, "tree_blob", digest))
        known: dict[bytes, tuple[Part, ...]] = {}
        with self._live.edit() as edit:
            for _, _, path, digest, transform, visible in rows:
                _put(edit, path, transform, bool(visible))
                if digest is not None:
                    if digest not in known:
                        known[digest] = reader.decode(_checked(connection, digest))
                    edit.set_parts(path, known[digest])
        self.restored = len(rows) - 1
        self._root = self._live.snapshot.root


class _Rows:
    """Writes a difference within a transaction."""

    def __init__(self, connection: sqlite3.Connection, parts: PartsWriter) -> None:
        self._connection = connection
        self._parts = parts
        self._digests: dict[int, bytes] = {}
        """By identity of the parts, which the difference keeps alive."""
        self._alike: dict[Hashable, bytes] = {}
        """By ``PartsWriter.alike``."""
        self._loose: set[bytes] = set()
        """Parts that a node has let go of."""

    def write(self, difference: Difference) -> None:
        run = self._connection.executemany
        for key in difference.removed:
            below = (key, key + AFTER)
            self._loosen("SELECT parts FROM tree_node WHERE path >= ? AND path < ?", below)
            self._connection.execute("DELETE FROM tree_node WHERE path >= ? AND path < ?", below)
        for begin in range(0, len(difference.geometry), ROWS_AT_ONCE):
            self._replace(difference.geometry[begin : begin + ROWS_AT_ONCE])
        if difference.added:
            run(
                "INSERT INTO tree_node (path, seq, parts, transform, visible) VALUES (?, ?, ?, ?, ?)",
                [(key, seq, self._stored(n.parts), _transform(n), n.visible) for key, seq, n in difference.added],
            )
        if difference.transforms:
            run(
                "UPDATE tree_node SET transform = ? WHERE path = ?",
                [(_transform(n), key) for key, n in difference.transforms],
            )
        if difference.visible:
            run("UPDATE tree_node SET visible = ? WHERE path = ?", [(n.visible, key) for key, n in difference.visible])
        if difference.moved:
            run("UPDATE tree_node SET seq = ? WHERE path = ?", [(seq, key) for key, seq in difference.moved])
        for digest in self._loose:
            self._collect(digest)

    def _replace(self, nodes: list[tuple[bytes, Node]]) -> None:
        """Geometry of nodes that are stored already; what is sent again as it is costs no write."""
        places = ",".join("?" * len(nodes))
        before = dict(
            self._connection.execute(
                f"SELECT path, parts FROM tree_node WHERE path IN ({places})",  # noqa: S608 - nothing but marks
                [key for key, _ in nodes],
            )
        )
        now = [(self._stored(node.parts), key) for key, node in nodes]
        changed = [(digest, key) for digest, key in now if digest != before.get(key)]
        self._loose.update(old for _, key in changed if (old := before.get(key)) is not None)
        self._connection.executemany("UPDATE tree_node SET parts = ? WHERE path = ?", changed)

    def _stored(self, parts: tuple[Part, ...] | None) -> bytes | None:
        if parts is None:
            return None
        digest = self._digests.get(id(parts))
        if digest is not None:
            return digest
        alike = self._parts.alike(parts)
        digest = self._alike.get(alike) if alike is not None else None
        if digest is not None:
            return digest
        data, blobs = self._parts.encode(parts)
        digest = self._digests[id(parts)] = hashlib.sha256(data).digest()
        if alike is not None:
            self._alike[alike] = digest
        execute = self._connection.execute
        if execute("INSERT OR IGNORE INTO tree_parts VALUES (?, ?)", (digest, data)).rowcount:
            for name, blob in blobs.items():
                if execute("SELECT 1 FROM tree_blob WHERE digest = ?", (name,)).fetchone() is None:
                    execute("INSERT INTO tree_blob VALUES (?, ?)", (name, blob))
                execute("INSERT INTO tree_use VALUES (?, ?)", (digest, name))
        return digest

    def _loosen(self, query: str, values: tuple[bytes, ...]) -> None:
        self._loose.update(digest for (digest,) in self._connection.execute(query, values) if digest is not None)

    def _collect(self, digest: bytes) -> None:
        """Deletes parts that no node has any more, and their blobs that no parts name any more."""
        execute = self._connection.execute
        if not execute(
            "DELETE FROM tree_parts WHERE digest = ?"
            " AND NOT EXISTS (SELECT 1 FROM tree_node WHERE parts = tree_parts.digest)",
            (digest,),
        ).rowcount:
            return
        blobs = execute("SELECT blob FROM tree_use WHERE parts = ?", (digest,)).fetchall()
        execute("DELETE FROM tree_use WHERE parts = ?", (digest,))
        self._connection.executemany(
            "DELETE FROM tree_blob WHERE digest = ?"
            " AND NOT EXISTS (SELECT 1 FROM tree_use WHERE blob = tree_blob.digest)",
            blobs,
        )


def _transform(node: Node) -> bytes | None:
    pose = node.pose
    if pose is not None:
        return _POSE.pack(*pose)
    return None if node.matrix is IDENTITY else np.ascontiguousarray(node.matrix, "<f8").tobytes()


def _put(edit: TreeEdit, path: Path, transform: bytes | None, visible: bool) -> None:
    """Makes the node; its parent is there already."""
    edit.set_visible(path, visible)
    if transform is None:
        return
    if len(transform) == _POSE.size:
        edit.set_pose(path, _POSE.unpack(transform))
    elif len(transform) == _MATRIX_BYTES:
        edit.set_matrix(path, np.frombuffer(transform, "<f8").reshape(4, 4))
    else:
        raise DamagedError(f"a transform has {len(transform)} bytes")


def _path(key: bytes) -> Path:
    try:
        return path_of(key)
    except ValueError as error:
        raise DamagedError(str(error)) from None


def _data(connection: sqlite3.Connection, table: str, digest: bytes) -> bytes:
    row = connection.execute(f"SELECT data FROM {table} WHERE digest = ?", (digest,)).fetchone()  # noqa: S608 - ours
    if row is None:
        raise KeyError(digest.hex()[:16])
    return bytes(row[0])


def _checked(connection: sqlite3.Connection, digest: bytes) -> bytes:
    try:
        data = _data(connection, "tree_parts", digest)
    except KeyError:
        raise DamagedError(f"the geometry {digest.hex()[:16]} is missing") from None
    if hashlib.sha256(data).digest() != digest:
        raise DamagedError("a geometry is not what its digest says")
    return data
