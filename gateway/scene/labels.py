"""Labels of the live tree: one number per path, the same for as long as the process lives."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Final

from gateway.scene.tree import Path
from renderers.drawlist import LABEL_NONE

MAX_LABELS: Final = LABEL_NONE - 1
"""Labels have 24 bits; 0 and the background's 0xFFFFFF are not given to paths."""


class LabelTable:
    """Paths and their labels, 1 .. ``limit``. Thread-safe.

    A label is never given to another path, so that pictures taken at different times agree. When a client has used up
    the limit by ever new names, further paths get ``LABEL_NONE``: they are still drawn, but cannot be told apart from
    each other, and memory stays bounded.
    """

    def __init__(self, limit: int = 1_000_000) -> None:
        """``limit``: most paths to remember (a path and its entries take about 300 bytes), at most ``MAX_LABELS``."""
        if not 0 < limit <= MAX_LABELS:
            raise ValueError(f"label limit {limit} must be in 1 .. {MAX_LABELS}")
        self._limit = limit
        self._by_path: dict[Path, int] = {}
        self._paths: list[Path] = []
        self._lock = threading.Lock()

    def label_of(self, path: Path) -> int:
        """The path's label; a new path gets the next free one."""
        label = self._by_path.get(path)
        if label is not None:
            return label
        with self._lock:
            label = self._by_path.get(path)
            if label is None:
                if len(self._paths) >= self._limit:
                    return LABEL_NONE
                self._paths.append(path)
                label = len(self._paths)
                self._by_path[path] = label
            return label

    def path_of(self, label: int) -> Path | None:
        """The path with this label, or None."""
        return self._paths[label - 1] if 1 <= label <= len(self._paths) else None

    def known(self) -> Mapping[int, Path]:
        """All labels given so far."""
        return {index + 1: path for index, path in enumerate(self._paths)}
