"""Configuration of the persistent state."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from scenegate.lcm.transport import MIB


@dataclass(frozen=True, slots=True)
class StateConfig:
    """The state file and its limits."""

    path: Path
    """The SQLite file."""
    max_waiting_bytes: int = 64 * MIB
    """Maximum bytes of responses that wait until their requests are stored. Further requests are rejected before they
    change the tree."""
    idle_commit_seconds: float = 1.0
    """Maximum seconds until an edit is stored that no client waits for."""
    checkpoint_bytes: int = 16 * MIB
    """Size of the write-ahead log at which a commit copies it into the database file."""
