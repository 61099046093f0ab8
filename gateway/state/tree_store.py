"""The live tree in the database.

Each transaction writes the differences between the live tree and the stored tree. All rows are read at start.
"""

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
from gateway.scene.tree import Node, Path, TreeEdit, changes
from gateway.state.keys import SUBTREE_END, key_of, path_of
from gateway.state.part_codec import DamagedError, PartDecoder, PartEncoder, memo_key

MAX_KEYS: Final = 500
"""Maximum number of keys in one SELECT statement."""
_POSE: Final = struct.Struct("<7d")
"""Position and quaternion."""
_MATRIX_BYTES: Final = 16 * 8


class TreeStore:
    """Stores a live tree; see ``group_commit.Store``. Call ``restore`` before all other methods."""

    def __init__(self, live: LiveTree, excluded: Iterable[str] = ()) -> None:
        """
        Args:
            excluded: Children of the root that are neither stored nor restored, with their subtrees.
        """
        self._live = live
        self._excluded = frozenset(excluded)
        self._stored_root = Node()
        """The tree in the database."""
        self._seq = 0
        """Highest ``seq``, the number that orders siblings, in the database."""
        self._written_seq = 0
        """Highest ``seq`` in the database after the current transaction."""
        self.restored_nodes = 0
        """Number of nodes read at start."""

    def capture(self) -> Snapshot:
        """Return the newest snapshot."""
        return self._live.snapshot

    def write(self, connection: sqlite3.Connection, captured: Snapshot) -> bool:
        """Write the differences between the stored tree and a snapshot; return False if there are none."""
        tree_changes = _TreeChanges(connection, self._seq)
        tree_changes.collect(self._stored_root, captured.root, self._excluded)
        self._written_seq = tree_changes.seq
        return tree_changes.write()

    def committed(self, captured: Snapshot) -> None:
        """Note that the transaction with this snapshot succeeded."""
        self._stored_root = captured.root
        self._seq = self._written_seq

    def restore(self, connection: sqlite3.Connection) -> None:
        """Put the stored tree into the live tree, which is empty, as one revision.

        Raises:
            DamagedError: The tables contain data that this class does not write.
        """
        rows = []
        for key, seq, digest, transform, visible, opacity in connection.execute(
            "SELECT path, seq, parts, transform, visible, opacity FROM tree_node"
        ):
            path = _path_of_key(key)
            self._seq = max(self._seq, seq)
            if not path or path[0] not in self._excluded:
                rows.append((len(path), seq, path, digest, transform, visible, opacity))
        rows.sort(key=lambda row: row[:2])  # parents first, siblings in order
        if len(rows) <= 1 and rows[0][3:] == (None, None, 1, 1.0):  # a root without content
            return
        decoder = PartDecoder(lambda digest: _read_data(connection, "tree_blob", digest))
        decoded: dict[bytes, tuple[Part, ...]] = {}
        with self._live.edit() as edit:
            for _, _, path, digest, transform, visible, opacity in rows:
                edit.set_visible(path, bool(visible))
                edit.set_opacity(path, opacity)
                _set_transform(edit, path, transform)
                if digest is not None:
                    if digest not in decoded:
                        decoded[digest] = decoder.decode(_read_parts(connection, digest))
                    edit.set_parts(path, decoded[digest])
        self.restored_nodes = len(rows) - 1
        self._stored_root = self._live.snapshot.root


class _TreeChanges:
    """The rows to write for the differences between two trees, within one transaction."""

    def __init__(self, connection: sqlite3.Connection, seq: int) -> None:
        self.seq = seq
        """Highest ``seq`` of any node; added and reordered nodes get the numbers after it."""
        self._connection = connection
        self._encoder = PartEncoder()
        self._removed: list[bytes] = []
        self._added: list[tuple[bytes, int, Node]] = []
        self._reordered: list[tuple[int, bytes]] = []
        self._geometry: list[tuple[bytes, Node]] = []
        self._transforms: list[tuple[bytes | None, bytes]] = []
        self._visible: list[tuple[bool, bytes]] = []
        self._opacity: list[tuple[float, bytes]] = []
        self._digests: dict[Hashable, bytes] = {}
        """Digests of parts by ``memo_key``, so that equal geometry is encoded once per transaction."""
        self._released: set[bytes] = set()
        """Digests of parts that nodes no longer have."""

    def collect(self, old: Node, new: Node, excluded: frozenset[str]) -> None:
        """Collect the differences between two trees, except below the ``excluded`` children of the root."""
        for kind, path, node in changes(old, new):
            if path and path[0] in excluded:
                continue
            key = key_of(path)
            if node is None:
                self._removed.append(key)
            elif kind == "transform":
                self._transforms.append((_encode_transform(node), key))
            elif kind == "geometry":
                self._geometry.append((key, node))
            elif kind == "added":
                self.seq += 1
                self._added.append((key, self.seq, node))
            elif kind == "reordered":
                self.seq += 1
                self._reordered.append((self.seq, key))
            elif kind == "opacity":
                self._opacity.append((node.opacity, key))
            else:
                self._visible.append((node.visible, key))

    def write(self) -> bool:
        """Write the rows; return False if there are none."""
        updates = (self._reordered, self._geometry, self._transforms, self._visible, self._opacity)
        if not (self._removed or self._added or any(updates)):
            return False
        execute_many = self._connection.executemany
        for key in self._removed:
            subtree = (key, key + SUBTREE_END)
            self._released.update(
                digest
                for (digest,) in self._connection.execute(
                    "SELECT parts FROM tree_node WHERE path >= ? AND path < ? AND parts IS NOT NULL", subtree
                )
            )
            self._connection.execute("DELETE FROM tree_node WHERE path >= ? AND path < ?", subtree)
        for begin in range(0, len(self._geometry), MAX_KEYS):
            self._replace_parts(self._geometry[begin : begin + MAX_KEYS])
        execute_many(
            "INSERT INTO tree_node (path, seq, parts, transform, visible, opacity) VALUES (?, ?, ?, ?, ?, ?)",
            [
                (key, seq, self._store_parts(node.parts), _encode_transform(node), node.visible, node.opacity)
                for key, seq, node in self._added
            ],
        )
        execute_many("UPDATE tree_node SET transform = ? WHERE path = ?", self._transforms)
        execute_many("UPDATE tree_node SET visible = ? WHERE path = ?", self._visible)
        execute_many("UPDATE tree_node SET opacity = ? WHERE path = ?", self._opacity)
        execute_many("UPDATE tree_node SET seq = ? WHERE path = ?", self._reordered)
        for digest in self._released:
            self._delete_unused(digest)
        return True

    def _replace_parts(self, nodes: list[tuple[bytes, Node]]) -> None:
        """Update the geometry of stored nodes. Geometry that a client sent again unchanged is not written."""
        placeholders = ",".join("?" * len(nodes))
        old_digests = dict(
            self._connection.execute(
                f"SELECT path, parts FROM tree_node WHERE path IN ({placeholders})",  # noqa: S608 - only placeholders
                [key for key, _ in nodes],
            )
        )
        new_digests = [(self._store_parts(node.parts), key) for key, node in nodes]
        changed = [(digest, key) for digest, key in new_digests if digest != old_digests.get(key)]
        self._released.update(old for _, key in changed if (old := old_digests.get(key)) is not None)
        self._connection.executemany("UPDATE tree_node SET parts = ? WHERE path = ?", changed)

    def _store_parts(self, parts: tuple[Part, ...] | None) -> bytes | None:
        """Write parts and their blobs, if they are not stored yet; return their digest."""
        if parts is None:
            return None
        parts_key = memo_key(parts)
        digest = self._digests.get(parts_key)
        if digest is not None:
            return digest
        data, blobs = self._encoder.encode(parts)
        digest = self._digests[parts_key] = hashlib.sha256(data).digest()
        execute = self._connection.execute
        if execute("INSERT OR IGNORE INTO tree_parts VALUES (?, ?)", (digest, data)).rowcount:
            for blob_digest, blob in blobs.items():
                if execute("SELECT 1 FROM tree_blob WHERE digest = ?", (blob_digest,)).fetchone() is None:
                    execute("INSERT INTO tree_blob VALUES (?, ?)", (blob_digest, blob))
                execute("INSERT INTO tree_use VALUES (?, ?)", (digest, blob_digest))
        return digest

    def _delete_unused(self, digest: bytes) -> None:
        """Delete parts that no node has any more, and their blobs that no other parts use."""
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


def _encode_transform(node: Node) -> bytes | None:
    """Return a pose or matrix as little-endian doubles; None for the identity."""
    pose = node.pose
    if pose is not None:
        return _POSE.pack(*pose)
    return None if node.matrix is IDENTITY else np.ascontiguousarray(node.matrix, "<f8").tobytes()


def _set_transform(edit: TreeEdit, path: Path, transform: bytes | None) -> None:
    if transform is None:
        return
    if len(transform) == _POSE.size:
        edit.set_pose(path, _POSE.unpack(transform))
    elif len(transform) == _MATRIX_BYTES:
        edit.set_matrix(path, np.frombuffer(transform, "<f8").reshape(4, 4))
    else:
        raise DamagedError(f"a transform has {len(transform)} bytes")


def _path_of_key(key: bytes) -> Path:
    try:
        return path_of(key)
    except ValueError as error:
        raise DamagedError(str(error)) from None


def _read_data(connection: sqlite3.Connection, table: str, digest: bytes) -> bytes:
    row = connection.execute(f"SELECT data FROM {table} WHERE digest = ?", (digest,)).fetchone()  # noqa: S608
    if row is None:
        raise KeyError(digest.hex()[:16])
    return bytes(row[0])


def _read_parts(connection: sqlite3.Connection, digest: bytes) -> bytes:
    try:
        data = _read_data(connection, "tree_parts", digest)
    except KeyError:
        raise DamagedError(f"the geometry {digest.hex()[:16]} is missing") from None
    if hashlib.sha256(data).digest() != digest:
        raise DamagedError("the data of a geometry does not match its digest")
    return data
