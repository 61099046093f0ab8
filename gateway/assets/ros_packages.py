"""ROS packages below given folders, for ``package://name/...``."""

from __future__ import annotations

import os
import re
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

MAX_FOLDERS: Final = 20_000
"""Maximum number of folders of one search; a large catkin workspace has a few thousand."""
MAX_DEPTH: Final = 8
"""Maximum depth of a package below a root."""
RESCAN_SECONDS: Final = 10.0
"""Minimum time between two searches for unknown names, which clients choose."""
_MAX_MANIFEST_BYTES: Final = 1 << 16
_NAME: Final = re.compile(rb"<name>\s*([^<\s]{1,256})\s*</name>")
_SKIPPED: Final = frozenset({".git", ".svn", ".hg", "node_modules", "__pycache__"})


class Packages:
    """Folders by package name, found by their ``package.xml``. The first one in the order of the roots counts."""

    def __init__(self, roots: tuple[Path, ...], clock: Callable[[], float] = time.monotonic) -> None:
        """
        Args:
            roots: Resolved folders. Links are not followed, so that the search stays below them.
        """
        self._roots = roots
        self._clock = clock
        self._lock = threading.Lock()
        self._found: dict[str, Path] = {}
        self._scanned: float | None = None

    def folder(self, name: str) -> Path | None:
        """Return the folder of a package; None where there is none."""
        with self._lock:
            found = self._found.get(name)
            now = self._clock()
            if found is None and (self._scanned is None or now - self._scanned >= RESCAN_SECONDS):
                self._found = self.scan()
                self._scanned = self._clock()
                found = self._found.get(name)
            return found

    def scan(self) -> dict[str, Path]:
        found: dict[str, Path] = {}
        remaining = MAX_FOLDERS
        for root in self._roots:
            depth = len(root.parts)
            for folder, below, files in os.walk(root):
                remaining -= 1
                if remaining < 0:
                    return found
                if "package.xml" in files:
                    name = _package_name(Path(folder) / "package.xml")
                    if name is not None:
                        found.setdefault(name, Path(folder))
                    below.clear()
                elif len(Path(folder).parts) - depth >= MAX_DEPTH:
                    below.clear()
                below[:] = sorted(name for name in below if name not in _SKIPPED)
        return found


def _package_name(manifest: Path) -> str | None:
    try:
        with manifest.open("rb") as file:
            match = _NAME.search(file.read(_MAX_MANIFEST_BYTES))
    except OSError:
        return None
    return match[1].decode("utf-8", "replace") if match else None
