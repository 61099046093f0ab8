"""Find ROS packages below given folders, for names such as ``package://name/path``."""

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
    """Folders by package name, found by their ``package.xml``. Of several, the first one counts. Thread-safe."""

    def __init__(self, roots: tuple[Path, ...], clock: Callable[[], float] = time.monotonic) -> None:
        """
        Args:
            roots: Resolved folders. Links are not followed, so that the search stays below them.
        """
        self._roots = roots
        self._clock = clock
        self._lock = threading.Lock()
        self._folders: dict[str, Path] = {}
        self._last_scan: float | None = None
        """Time on the clock; None before the first search."""

    def folder(self, name: str) -> Path | None:
        """Return the folder of a package; None if there is none."""
        with self._lock:
            folder = self._folders.get(name)
            if folder is None and (self._last_scan is None or self._clock() - self._last_scan >= RESCAN_SECONDS):
                self._folders = self.scan()
                self._last_scan = self._clock()
                folder = self._folders.get(name)
            return folder

    def scan(self) -> dict[str, Path]:
        """Search the roots, at most ``MAX_FOLDERS`` folders. Packages inside packages are not found."""
        folders: dict[str, Path] = {}
        remaining = MAX_FOLDERS
        for root in self._roots:
            root_depth = len(root.parts)
            for folder, subfolders, files in os.walk(root):
                remaining -= 1
                if remaining < 0:
                    return folders
                if "package.xml" in files:
                    name = _package_name(Path(folder) / "package.xml")
                    if name is not None:
                        folders.setdefault(name, Path(folder))
                    subfolders.clear()
                elif len(Path(folder).parts) - root_depth >= MAX_DEPTH:
                    subfolders.clear()
                subfolders[:] = sorted(name for name in subfolders if name not in _SKIPPED)
        return folders


def _package_name(manifest: Path) -> str | None:
    try:
        with manifest.open("rb") as file:
            match = _NAME.search(file.read(_MAX_MANIFEST_BYTES))
    except OSError:
        return None
    return match[1].decode("utf-8", "replace") if match else None
