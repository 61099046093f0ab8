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

from gateway.runtime.state.keys import SUBTREE_END, key_of, path_of
from gateway.runtime.state.part_codec import DamagedError, PartDecoder, PartEncoder, memo_key
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.live import LiveTree, Snapshot
from gateway.scene.tree.nodes import Change, Node, Path, TreeEdit, changes
from gateway.scene.tree.transforms import IDENTITY

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
        rows = _RowWriter(connection, self._seq)
        written = False
        for change in changes(self._stored_root, captured.root):
            if not change.path or change.path[0] not in self._excluded:
                rows.write(change)
                written = True
        rows.delete_unused_parts()
        self._written_seq = rows.seq
        return written

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
            try:
                path = path_of(key)
            except ValueError as error:
                raise DamagedError(str(error)) from None
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
                        data = _read_data(connection, "tree_parts", digest)
                        if hashlib.sha256(data).digest() != digest:
                            raise DamagedError("the data of a geometry does not match its digest")
                        decoded[digest] = decoder.decode(data)
                    edit.set_parts(path, decoded[digest])
        self.restored_nodes = len(rows) - 1
        self._stored_root = self._live.snapshot.root


class _RowWriter:
    """Writes the rows of changes of the tree within one transaction."""

    def __init__(self, connection: sqlite3.Connection, seq: int) -> None:
        self.seq = seq
        """Highest ``seq`` of any node; added and reordered nodes get the numbers after it."""
        self._execute = connection.execute
        self._encoder = PartEncoder()
        self._digests: dict[Hashable, bytes] = {}
        """Digests of parts by ``memo_key``, so that equal geometry is encoded once per transaction."""
        self._released: set[bytes] = set()
        """Digests of parts that nodes no longer have."""

    def write(self, change: Change) -> None:
        """Write the row of a node, or delete the rows of a subtree."""
        kind, node, key = change.kind, change.node, key_of(change.path)
        if node is None:
            subtree = (key, key + SUBTREE_END)
            digests = self._execute("SELECT parts FROM tree_node WHERE path >= ? AND path < ?", subtree)
            self._released.update(digest for (digest,) in digests if digest is not None)
            self._execute("DELETE FROM tree_node WHERE path >= ? AND path < ?", subtree)
        elif kind == "added":
            self.seq += 1
            self._execute(
                "INSERT INTO tree_node (path, seq, parts, transform, visible, opacity) VALUES (?, ?, ?, ?, ?, ?)",
                (key, self.seq, self._store(node.parts), _encode_transform(node), node.visible, node.opacity),
            )
        elif kind == "reordered":
            self.seq += 1
            self._execute("UPDATE tree_node SET seq = ? WHERE path = ?", (self.seq, key))
        elif kind == "transform":
            self._execute("UPDATE tree_node SET transform = ? WHERE path = ?", (_encode_transform(node), key))
        elif kind == "visible":
            self._execute("UPDATE tree_node SET visible = ? WHERE path = ?", (node.visible, key))
        elif kind == "opacity":
            self._execute("UPDATE tree_node SET opacity = ? WHERE path = ?", (node.opacity, key))
        else:  # geometry, which a client may have sent again unchanged
            digest = self._store(node.parts)
            row = self._execute("SELECT parts FROM tree_node WHERE path = ?", (key,)).fetchone()
            old = row[0] if row is not None else None  # a damaged file may lack the row
            if digest != old:
                self._execute("UPDATE tree_node SET parts = ? WHERE path = ?", (digest, key))
            if old is not None:
                self._released.add(old)

    def _store(self, parts: tuple[Part, ...] | None) -> bytes | None:
        """Write parts and their blobs, if they are not stored yet; return their digest."""
        if parts is None:
            return None
        parts_key = memo_key(parts)
        digest = self._digests.get(parts_key)
        if digest is not None:
            return digest
        data, blobs = self._encoder.encode(parts)
        digest = self._digests[parts_key] = hashlib.sha256(data).digest()
        execute = self._execute
        if execute("INSERT OR IGNORE INTO tree_parts VALUES (?, ?)", (digest, data)).rowcount:
            for blob_digest, blob in blobs.items():
                if execute("SELECT 1 FROM tree_blob WHERE digest = ?", (blob_digest,)).fetchone() is None:
                    execute("INSERT INTO tree_blob VALUES (?, ?)", (blob_digest, blob))
                execute("INSERT INTO tree_use VALUES (?, ?)", (digest, blob_digest))
        return digest

    def delete_unused_parts(self) -> None:
        """Delete the released parts that no node has any more, and their blobs that no other parts use."""
        execute = self._execute
        for digest in self._released:
            if not execute(
                "DELETE FROM tree_parts WHERE digest = ?"
                " AND NOT EXISTS (SELECT 1 FROM tree_node WHERE parts = tree_parts.digest)",
                (digest,),
            ).rowcount:
                continue
            blobs = execute("SELECT blob FROM tree_use WHERE parts = ?", (digest,)).fetchall()
            execute("DELETE FROM tree_use WHERE parts = ?", (digest,))
            for blob in blobs:
                execute(
                    "DELETE FROM tree_blob WHERE digest = ?"
                    " AND NOT EXISTS (SELECT 1 FROM tree_use WHERE blob = tree_blob.digest)",
                    blob,
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


def _read_data(connection: sqlite3.Connection, table: str, digest: bytes) -> bytes:
    row = connection.execute(f"SELECT data FROM {table} WHERE digest = ?", (digest,)).fetchone()  # noqa: S608
    if row is None:
        raise DamagedError(f"the geometry {digest.hex()[:16]} is missing")
    return bytes(row[0])
