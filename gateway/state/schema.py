"""The tables as a list of migrations. A file of an earlier version is upgraded by the migrations that it lacks."""

from __future__ import annotations

from typing import Final

APPLICATION_ID: Final = 0x53434754
"""The bytes "SCGT" in the file's header."""

MIGRATIONS: Final[tuple[tuple[str, ...], ...]] = (
    (
        # The live tree. ``path``: see keys.py. ``seq`` orders siblings. ``parts``: NULL if no geometry was ever set.
        # ``transform``: NULL for the identity, 56 bytes for a pose, 128 for a matrix (little-endian doubles).
        """CREATE TABLE tree_node (
            path BLOB PRIMARY KEY, seq INTEGER NOT NULL, parts BLOB, transform BLOB, visible INTEGER NOT NULL
        ) WITHOUT ROWID""",
        "INSERT INTO tree_node VALUES (x'', 0, NULL, NULL, 1)",
        "CREATE INDEX tree_node_by_parts ON tree_node (parts) WHERE parts IS NOT NULL",
        # Geometry: see part_codec.py. ``digest`` is the SHA-256 of ``data``.
        "CREATE TABLE tree_parts (digest BLOB PRIMARY KEY, data BLOB NOT NULL)",
        "CREATE TABLE tree_blob (digest BLOB PRIMARY KEY, data BLOB NOT NULL)",
        "CREATE TABLE tree_use (parts BLOB NOT NULL, blob BLOB NOT NULL, PRIMARY KEY (parts, blob)) WITHOUT ROWID",
        "CREATE INDEX tree_use_by_blob ON tree_use (blob)",
        # Parameters of the stereo cameras; ``value`` is JSON.
        """CREATE TABLE stereo_parameter (
            camera TEXT NOT NULL, node TEXT NOT NULL, name TEXT NOT NULL, value TEXT NOT NULL,
            PRIMARY KEY (camera, node, name)
        ) WITHOUT ROWID""",
    ),
    ("ALTER TABLE tree_node ADD COLUMN opacity REAL NOT NULL DEFAULT 1",),
)
"""Statements of each migration. Migration number N, counted from 1, leads to schema version N."""
