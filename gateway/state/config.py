"""What an operator can set of the state, every bound with its reason."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

MIB: Final = 1 << 20


@dataclass(frozen=True, slots=True)
class StateConfig:
    """The file and how it is written."""

    path: Path
    waiting_answer_bytes: int = 64 * MIB
    """Of answers that wait until their requests are stored; beyond it requests are refused before they are applied."""
    lazy_seconds: float = 1.0
    """Edits that nobody waits for are stored this late."""
    checkpoint_bytes: int = 16 * MIB
    """Of the write-ahead log; beyond it a thread of its own moves it into the file, beside the writing."""
    most_log_bytes: int = 256 * MIB
    """Of the write-ahead log; a flood outruns that thread, so that from here on writing waits for the file."""
