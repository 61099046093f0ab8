"""Finds the folders of ROS packages, for file names such as ``package://name/path``."""

import os
import re
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from scenegate.regular_files import open_regular

MAX_FOLDERS: Final = 20_000
"""Maximum number of folders of one search; a large catkin workspace has a few thousand."""
MAX_DEPTH: Final = 8
"""Maximum depth of a package below a root."""
RESCAN_SECONDS: Final = 10.0
"""Minimum time between two searches, since clients can send any number of unknown names."""
PATH_VARIABLES: Final = ("ROS_PACKAGE_PATH", "GZ_SIM_RESOURCE_PATH", "GAZEBO_MODEL_PATH", "SDF_PATH")
"""Environment variables of ROS and Gazebo with folders of packages and models."""
_MAX_MANIFEST_BYTES: Final = 1 << 16
"""Number of bytes of a ``package.xml`` that are searched for the package's name."""
_NAME: Final = re.compile(rb"<name>\s*([^<\s]{1,256})\s*</name>")
_SKIPPED_FOLDERS: Final = frozenset({".git", ".svn", ".hg", "node_modules", "__pycache__"})


def split_url(name: str) -> tuple[str, str]:
    """Return the scheme of a file name or URL, in lower case, and the rest after ``://``. Paths have no scheme.

    ``file:/x``, with one slash, has the rest ``/x``.
    """
    if name[:6].lower() == "file:/" and name[6:7] != "/":
        return "file", name[5:]
    scheme, separator, rest = name.partition("://")
    return (scheme.lower(), rest) if scheme and separator else ("", name)


class Packages:
    """Folders by package name, as their ``package.xml`` says; of equal names the first one found. Thread-safe."""

    def __init__(self, roots: tuple[Path, ...], clock: Callable[[], float] = time.monotonic) -> None:
        """``roots``: folders to search, with links resolved. The search follows no links, so it stays below them."""
        self._roots = roots
        self._clock = clock
        self._lock = threading.Lock()
        self._folders: dict[str, Path] = {}
        self._last_scan: float | None = None
        """Time of the last search; None before the first one."""

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
        """Search the roots; return the folders by package name.

        At most ``MAX_FOLDERS`` folders are searched. Packages inside other packages are not found.
        """
        folders: dict[str, Path] = {}
        remaining = MAX_FOLDERS
        for root in self._roots:
            root_depth = len(root.parts)
            for folder, subfolders, files in os.walk(root):
                remaining -= 1
                if remaining < 0:
                    return folders
                if "package.xml" in files:
                    name = package_name(Path(folder) / "package.xml")
                    if name is not None:
                        folders.setdefault(name, Path(folder))
                    subfolders.clear()
                elif len(Path(folder).parts) - root_depth >= MAX_DEPTH:
                    subfolders.clear()
                subfolders[:] = sorted(name for name in subfolders if name not in _SKIPPED_FOLDERS)
        return folders


def package_name(manifest: Path) -> str | None:
    """Return the name in a ``package.xml``; None if there is none."""
    try:
        with open_regular(manifest) as file:
            match = _NAME.search(file.read(_MAX_MANIFEST_BYTES))
    except OSError:
        return None
    return match[1].decode("utf-8", "replace") if match else None


def folders_of(variable: str) -> list[Path]:
    """Return the existing folders of an environment variable such as ROS_PACKAGE_PATH."""
    folders = [Path(text) for text in os.environ.get(variable, "").split(os.pathsep) if text]
    return [folder for folder in folders if folder.is_dir()]


def folders_of_environment() -> list[Path]:
    """Return the existing folders of packages of all ``PATH_VARIABLES``."""
    return [folder for variable in PATH_VARIABLES for folder in folders_of(variable)]
