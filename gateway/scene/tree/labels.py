"""Labels of the live tree: one number per path, which stays the same for the lifetime of the process."""

import threading
from collections.abc import Mapping
from typing import Final

from gateway.scene.tree.nodes import Path
from renderers.drawlist import LABEL_NONE

MAX_LABELS: Final = LABEL_NONE - 1
"""Largest label of a path. Labels have 24 bits; 0 and the background's 0xFFFFFF are reserved."""


class LabelTable:
    """Paths and their labels, 1 .. ``limit``. Thread-safe.

    A label is never reused for another path, so that it means the same in all images. To bound the memory, new paths
    beyond the limit get ``LABEL_NONE``: they are still drawn, but with the label of the background.
    """

    def __init__(self, limit: int = 1_000_000) -> None:
        """``limit``: maximum number of paths, at most ``MAX_LABELS``. A path takes about 300 bytes."""
        if not 0 < limit <= MAX_LABELS:
            raise ValueError(f"label limit {limit} must be in 1 .. {MAX_LABELS}")
        self._limit = limit
        self._label_by_path: dict[Path, int] = {}
        self._paths: list[Path] = []
        self._lock = threading.Lock()

    def label_of(self, path: Path) -> int:
        """Return the label of a path; a new path gets the next free label."""
        with self._lock:
            label = self._label_by_path.get(path)
            if label is None and len(self._paths) < self._limit:
                self._paths.append(path)
                label = self._label_by_path[path] = len(self._paths)
            return LABEL_NONE if label is None else label

    def path_of(self, label: int) -> Path | None:
        """Return the path with this label; None if there is none."""
        return self._paths[label - 1] if 1 <= label <= len(self._paths) else None

    def paths_by_label(self) -> Mapping[int, Path]:
        """Return all paths that have a label, by label."""
        return {index + 1: path for index, path in enumerate(self._paths)}
