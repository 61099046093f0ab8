"""The live tree in the database: each transaction writes the differences from the stored tree."""

import json
import sqlite3
from collections.abc import Iterable
from typing import Final

import numpy as np

from gateway.runtime.state.part_codec import Blobs, PartDecoder, PartEncoder
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.nodes import Change, Node, changes
from gateway.scene.tree.transforms import IDENTITY

_POSE_NUMBERS: Final = 7
"""Position and quaternion."""


class TreeStore:
    """Stores a live tree; see ``service.Store``."""

    def __init__(self, live: LiveTree, excluded: Iterable[str] = ()) -> None:
        """Store no children of the root with names in ``excluded``, nor their subtrees."""
        self._live = live
        self._excluded = frozenset(excluded)
        self._seq = 0
        """Highest ``seq`` given so far; numbers of failed transactions are not used again."""

    def capture(self) -> Node:
        """Return the root of the newest snapshot."""
        return self._live.snapshot.root

    def write(self, connection: sqlite3.Connection, stored: Node, captured: Node) -> bool:
        """Write the differences between two roots; return False if there are none."""
        encoder, unused = PartEncoder(), list[tuple[bytes]]()
        written = False
        for change in changes(stored, captured):
            if not change.path or change.path[0] not in self._excluded:
                unused += self._write_change(connection, change, encoder)
                written = True
        connection.executemany(
            "DELETE FROM tree_blob WHERE digest = ? AND digest NOT IN (SELECT digest FROM tree_use)", unused
        )
        return written

    def restore(self, connection: sqlite3.Connection) -> Node:
        """Put the stored tree into the live tree, which is empty, as one revision, and return its root.

        Damaged tables raise any error.
        """
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
            return self.capture()

        def blob(digest: bytes) -> bytes:
            for (data,) in connection.execute("SELECT data FROM tree_blob WHERE digest = ?", (digest,)):
                return bytes(data)
            raise ValueError(f"the blob {digest.hex()[:16]} is missing")

        decoder = PartDecoder(blob)
        with self._live.edit() as edit:
            for _, _, path, parts, transform, visible, opacity in rows:
                edit.set_visible(path, bool(visible))
                edit.set_opacity(path, opacity)
                numbers = np.frombuffer(transform or b"", "<f8")
                if len(numbers) == _POSE_NUMBERS:
                    edit.set_pose(path, tuple(numbers.tolist()))
                elif transform is not None:
                    edit.set_matrix(path, numbers.reshape(4, 4))
                if parts is not None:
                    edit.set_parts(path, decoder.decode(parts))
        return self.capture()

    def _write_change(self, connection: sqlite3.Connection, change: Change, encoder: PartEncoder) -> list[tuple[bytes]]:
        """Write the row of a node, or delete the rows of a subtree; return the digests that have one use less."""
        kind, node, key = change.kind, change.node, json.dumps(change.path)
        if node is None:
            # The paths below ["a"] start with ["a", and a space, the last character before the exclamation mark.
            subtree = (key, f"{key[:-1]}, ", f"{key[:-1]},!")
            condition = "WHERE path = ? OR path >= ? AND path < ?"
            # Ruff cannot see that the texts of these statements are constants.
            connection.execute(f"DELETE FROM tree_node {condition}", subtree)  # noqa: S608
            return connection.execute(f"DELETE FROM tree_use {condition} RETURNING digest", subtree).fetchall()  # noqa: S608
        unused: list[tuple[bytes]] = []
        digest, blobs = None, Blobs()
        if kind in ("added", "geometry"):
            unused = connection.execute("DELETE FROM tree_use WHERE path = ? RETURNING digest", (key,)).fetchall()
            if node.parts is not None:
                digest, blobs = encoder.encode(node.parts)
        connection.executemany("INSERT OR IGNORE INTO tree_blob VALUES (?, ?)", blobs.items())
        connection.executemany("INSERT INTO tree_use VALUES (?, ?)", [(key, each) for each in blobs])
        self._seq += kind in ("added", "reordered")
        values = {
            "reordered": ("seq", self._seq),
            "geometry": ("parts", digest),
            "transform": ("transform", _encode_transform(node)),
            "visible": ("visible", node.visible),
            "opacity": ("opacity", node.opacity),
        }
        if kind == "added":
            row = (key, self._seq, digest, _encode_transform(node), node.visible, node.opacity)
            connection.execute("INSERT INTO tree_node VALUES (?, ?, ?, ?, ?, ?)", row)
        else:
            column, value = values[kind]
            connection.execute(f"UPDATE tree_node SET {column} = ? WHERE path = ?", (value, key))  # noqa: S608 - a key of values
        return unused


def _encode_transform(node: Node) -> bytes | None:
    """Return a pose or matrix as little-endian doubles; None for the identity."""
    values = node.matrix if node.pose is None else node.pose
    return None if values is IDENTITY else np.asarray(values, "<f8").tobytes()
