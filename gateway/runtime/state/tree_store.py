"""The live tree in the database.

Each transaction writes the differences between the live tree and the stored tree. All rows are read at start.
"""

from __future__ import annotations

import json
import sqlite3
import struct
from collections import Counter
from collections.abc import Iterable
from typing import Final

import numpy as np

from gateway.runtime.state.part_codec import Blobs, PartDecoder, PartEncoder
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.live import LiveTree, Snapshot
from gateway.scene.tree.nodes import Change, Node, Path, TreeEdit, changes
from gateway.scene.tree.transforms import IDENTITY

_POSE: Final = struct.Struct("<7d")
"""Position and quaternion."""
_DIGEST_BYTES: Final = 32


class TreeStore:
    """Stores a live tree; see ``service.Store``. Call ``restore`` before all other methods."""

    def __init__(self, live: LiveTree, excluded: Iterable[str] = ()) -> None:
        """Store no children of the root with names in ``excluded``, nor their subtrees."""
        self._live = live
        self._excluded = frozenset(excluded)
        self._stored_root = Node()
        """The tree in the database."""
        self._seq = 0
        """Highest ``seq`` given so far; numbers of failed transactions are not used again."""
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
        rows.write_blobs()
        self._seq = rows.seq
        return written

    def committed(self, captured: Snapshot) -> None:
        """Note that the transaction with this snapshot succeeded."""
        self._stored_root = captured.root

    def restore(self, connection: sqlite3.Connection) -> None:
        """Put the stored tree into the live tree, which is empty, as one revision. Damaged tables raise any error."""
        rows = []
        for key, seq, parts, transform, visible, opacity in connection.execute(
            "SELECT path, seq, parts, transform, visible, opacity FROM tree_node"
        ):
            path = tuple(json.loads(key))
            self._seq = max(self._seq, seq)
            if not path or path[0] not in self._excluded:
                rows.append((len(path), seq, path, parts, transform, visible, opacity))
        rows.sort(key=lambda row: row[:2])  # parents first, siblings in order
        if len(rows) <= 1 and rows[0][3:] == (None, None, 1, 1.0):  # a root without content
            return

        def blob(digest: bytes) -> bytes:
            for (data,) in connection.execute("SELECT data FROM tree_blob WHERE digest = ?", (digest,)):
                return bytes(data)
            raise ValueError(f"the blob {digest.hex()[:16]} is missing")

        decoder = PartDecoder(blob)
        with self._live.edit() as edit:
            for _, _, path, parts, transform, visible, opacity in rows:
                edit.set_visible(path, bool(visible))
                edit.set_opacity(path, opacity)
                _set_transform(edit, path, transform)
                if parts is not None:
                    edit.set_parts(path, decoder.decode(parts[:_DIGEST_BYTES]))
        self.restored_nodes = len(rows) - 1
        self._stored_root = self._live.snapshot.root


class _RowWriter:
    """Writes the rows of changes of the tree within one transaction."""

    def __init__(self, connection: sqlite3.Connection, seq: int) -> None:
        self.seq = seq
        """Highest ``seq`` of any node; added and reordered nodes get the numbers after it."""
        self._execute = connection.execute
        self._encoder = PartEncoder()
        self._blobs: Blobs = {}
        """Blobs that nodes got."""
        self._uses: Counter[bytes] = Counter()
        """Changes of the blobs' counts of uses."""

    def write(self, change: Change) -> None:
        """Write the row of a node, or delete the rows of a subtree."""
        kind, node, key = change.kind, change.node, json.dumps(change.path)
        if node is None:
            # The paths below ["a"] start with ["a", and a space, the last character before the exclamation mark.
            subtree = (key, f"{key[:-1]}, ", f"{key[:-1]},!")
            condition = "WHERE path = ? OR path >= ? AND path < ?"
            for (digests,) in self._execute(f"SELECT parts FROM tree_node {condition}", subtree):  # noqa: S608
                self._use(digests, -1)
            self._execute(f"DELETE FROM tree_node {condition}", subtree)  # noqa: S608
            return
        if kind in ("added", "reordered"):
            self.seq += 1
        if kind == "added":
            row = (key, self.seq, self._add(node.parts), _encode_transform(node), node.visible, node.opacity)
            self._execute("INSERT INTO tree_node VALUES (?, ?, ?, ?, ?, ?)", row)
        elif kind == "geometry":
            for (digests,) in self._execute("SELECT parts FROM tree_node WHERE path = ?", (key,)):
                self._use(digests, -1)
            self._execute("UPDATE tree_node SET parts = ? WHERE path = ?", (self._add(node.parts), key))
        else:
            column = "seq" if kind == "reordered" else kind
            values = {"seq": self.seq, "visible": node.visible, "opacity": node.opacity}
            value = _encode_transform(node) if kind == "transform" else values[column]
            self._execute(f"UPDATE tree_node SET {column} = ? WHERE path = ?", (value, key))  # noqa: S608

    def write_blobs(self) -> None:
        """Write the blobs that nodes got, and delete those that no node has any more."""
        for digest, change in self._uses.items():
            updated = "UPDATE tree_blob SET uses = uses + ? WHERE digest = ?"
            if change and not self._execute(updated, (change, digest)).rowcount and change > 0:
                self._execute("INSERT INTO tree_blob VALUES (?, ?, ?)", (digest, self._blobs[digest], change))
            if change < 0:
                self._execute("DELETE FROM tree_blob WHERE digest = ? AND uses <= 0", (digest,))

    def _add(self, parts: tuple[Part, ...] | None) -> bytes | None:
        """Count the uses of parts; return the digests of their blobs, the parts' own first."""
        if parts is None:
            return None
        digest, blobs = self._encoder.encode(parts)
        self._blobs.update(blobs)
        digests = b"".join((digest, *(each for each in blobs if each != digest)))
        self._use(digests, 1)
        return digests

    def _use(self, digests: bytes | None, change: int) -> None:
        for begin in range(0, len(digests or b""), _DIGEST_BYTES):
            self._uses[digests[begin : begin + _DIGEST_BYTES]] += change  # type: ignore[index]


def _encode_transform(node: Node) -> bytes | None:
    """Return a pose or matrix as little-endian doubles; None for the identity."""
    if node.pose is not None:
        return _POSE.pack(*node.pose)
    return None if node.matrix is IDENTITY else np.ascontiguousarray(node.matrix, "<f8").tobytes()


def _set_transform(edit: TreeEdit, path: Path, transform: bytes | None) -> None:
    if transform is not None and len(transform) == _POSE.size:
        edit.set_pose(path, _POSE.unpack(transform))
    elif transform is not None:
        edit.set_matrix(path, np.frombuffer(transform, "<f8").reshape(4, 4))
