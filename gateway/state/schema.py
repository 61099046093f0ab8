"""The tables, as the steps that lead to them: a file of any earlier version goes through those it lacks."""

from __future__ import annotations

from typing import Final

APPLICATION_ID: Final = 0x53434754
"""``SCGT``, in the file's header."""

MIGRATIONS: Final[tuple[tuple[str, ...], ...]] = (
    (
        # The live tree. ``path``: see keys.py. ``seq`` orders siblings. ``parts``: NULL where no geometry was ever set.
        # ``transform``: NULL is the identity, 56 bytes a pose, 128 a matrix (little-endian doubles).
        """CREATE TABLE tree_node (
            path BLOB PRIMARY KEY, seq INTEGER NOT NULL, parts BLOB, transform BLOB, visible INTEGER NOT NULL
        ) WITHOUT ROWID""",
        "INSERT INTO tree_node VALUES (x'', 0, NULL, NULL, 1)",
        "CREATE INDEX tree_node_by_parts ON tree_node (parts) WHERE parts IS NOT NULL",
        # Geometry: see parts.py. Both are named by the SHA-256 of their data.
        "CREATE TABLE tree_parts (digest BLOB PRIMARY KEY, data BLOB NOT NULL)",
        "CREATE TABLE tree_blob (digest BLOB PRIMARY KEY, data BLOB NOT NULL)",
        "CREATE TABLE tree_use (parts BLOB NOT NULL, blob BLOB NOT NULL, PRIMARY KEY (parts, blob)) WITHOUT ROWID",
        "CREATE INDEX tree_use_by_blob ON tree_use (blob)",
        # The stereo cameras' parameters; ``value`` is JSON.
        """CREATE TABLE stereo_parameter (
            camera TEXT NOT NULL, node TEXT NOT NULL, name TEXT NOT NULL, value TEXT NOT NULL,
            PRIMARY KEY (camera, node, name)
        ) WITHOUT ROWID""",
    ),
)
"""Statements by version; the first makes version 1."""
