"""Finds and reads the files that a robot file refers to: relative paths, ``package://``, ``file://``.

Only files below these folders are read: the parent of the robot file's folder, packages that contain the robot file,
packages that it names, and the roots. Symbolic links are resolved before the check. The root of the file system and
folders that contain the user's home folder count neither as packages nor as the parent folder.
"""

from __future__ import annotations

import errno
import hashlib
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Final
from urllib.parse import unquote

from gateway.assets.ros_packages import Packages
from gateway.robots.errors import RobotFileError
from gateway.robots.limits import RobotLimits
from gateway.runtime.regular_files import read_file_or_pipe, read_regular

_PACKAGE_SCHEMES: Final = ("package", "model")
"""URL schemes whose first path element is a package. URDF uses Gazebo's ``model://`` like ``package://``."""


class RobotFiles:
    """Reads a robot file and the files that it refers to."""

    def __init__(self, path: Path, roots: Iterable[Path], limits: RobotLimits) -> None:
        """
        Args:
            path: The robot file, which may be a pipe.
            roots: Folders to search for packages, and for relative file names.
        """
        self.is_pipe = path.exists() and not path.is_file() and not path.is_dir()
        """True for a pipe, as in ``publish <(xacro …)``. Its relative names start at the working directory."""
        self._source = path
        self.path = Path.cwd() / path.name if self.is_pipe else Path(os.path.realpath(path))
        self._folder = self.path.parent
        self._roots = tuple(Path(os.path.realpath(root)) for root in roots)
        self._packages = Packages(self._roots)
        self._limits = limits
        self._remaining_bytes = limits.max_total_bytes
        self._enclosing_packages = [folder for folder in self.path.parents if (folder / "package.xml").is_file()]
        self._folders_by_package: dict[str, list[Path]] = {}
        self._package_parents = [
            *self._roots,
            *filter(_is_specific, (self._folder.parent, *(folder.parent for folder in self._enclosing_packages))),
        ]
        """Folders in which packages lie side by side."""
        self._allowed = [*self._roots, self._folder, *self._enclosing_packages]
        if _is_specific(self._folder.parent):
            self._allowed.append(self._folder.parent)
        self.digests: dict[str, str] = {}
        """SHA-256 in hexadecimal of each file that has been read, by path relative to the robot file's folder."""

    def read_robot_file(self) -> bytes:
        """Return the bytes of the robot file; raises OSError, or RobotFileError beyond the limit."""
        if not self.is_pipe:
            return self._read(self.path, self._limits.max_file_bytes)
        data = read_file_or_pipe(self._source, self._limits.max_file_bytes)
        self.digests[self.path.name] = hashlib.sha256(data).hexdigest()
        return data

    def find(self, name: str) -> Path:
        """Return the path of a file that the robot file names.

        Args:
            name: File name or URL.

        Raises:
            RobotFileError: There is no such file, or it is not below an allowed folder.
        """
        if not name or "\0" in name or len(name) > 4096:
            raise RobotFileError(f"{name[:100]!r} is not a file name")
        scheme, separator, rest = name.partition("://")
        hint = ""
        if not separator:
            candidates = [folder / name for folder in (self._folder, *self._roots)]
        elif scheme in _PACKAGE_SCHEMES:
            package, _, path_in_package = rest.lstrip("/").partition("/")
            folders = self._package_folders(package)
            if not folders:
                raise RobotFileError(
                    f"{name} is in the package {package!r}, which is not around the robot file"
                    f"{' nor below --root' if self._roots else ''}; name a folder that contains it with --root"
                )
            candidates, hint = [folder / path_in_package for folder in folders], f" in {folders[0]}"
        elif scheme == "file":
            candidates = [Path("/" + unquote(rest).lstrip("/"))]
        else:
            raise RobotFileError(f"{name}: only package:// and file:// can be read, nothing is fetched")
        paths = [Path(os.path.realpath(candidate)) for candidate in candidates]
        existing = [path for path in paths if path.is_file()]
        for path in existing:
            if self._is_allowed(path):
                return path
        if existing:
            raise RobotFileError(f"{name} lies outside of the robot's folders; name a folder above it with --root")
        raise RobotFileError(f"the file {name} does not exist{hint}")

    def read(self, path: Path) -> bytes:
        """Return the bytes of a file that ``find`` returned; raises OSError, or RobotFileError beyond the limits."""
        return self._read(path, self._limits.max_mesh_bytes)

    def read_beside(self, mesh: Path, name: str) -> bytes:
        """Return the bytes of a file that a mesh file refers to; raises OSError or RobotFileError.

        Args:
            mesh: Path of the mesh file.
            name: Path relative to the mesh file, with URL escapes.
        """
        path = Path(os.path.realpath(mesh.parent / unquote(name).replace("\\", "/")))
        if not self._is_allowed(path):
            raise RobotFileError(f"{name} lies outside of the robot's folders")
        return self.read(path)

    def _package_folders(self, package: str) -> list[Path]:
        """Return the existing folders that may be a package, and add them to the allowed folders.

        They are in this order:

        - folders that contain the robot file, with that folder name or package name,
        - folders of that name in a root, beside the robot file's folder, or beside a package that contains it,
        - roots of that name,
        - the package below the roots with that package name.
        """
        folders = [] if package in ("", ".", "..") else self._folders_by_package.get(package)
        if folders is None:
            enclosing = [
                folder
                for folder in self.path.parents
                if (folder.name == package and _is_specific(folder)) or self._has_package_name(folder, package)
            ]
            siblings = [
                folder
                for folder in (parent / package for parent in self._package_parents)
                if folder.is_dir() and self._is_beside_packages(folder)
            ]
            below_roots = self._packages.folder(package)
            named_roots = [root for root in self._roots if root.name == package]
            folders = [*enclosing, *siblings, *named_roots, *([below_roots] if below_roots is not None else [])]
            self._folders_by_package[package] = folders
            self._allowed += [Path(os.path.realpath(folder)) for folder in folders]
        return folders

    def _has_package_name(self, folder: Path, package: str) -> bool:
        """Return True if a folder that contains the robot file has a ``package.xml`` with that package name."""
        return folder in self._enclosing_packages and Packages((folder,)).folder(package) == folder

    def _is_beside_packages(self, folder: Path) -> bool:
        """Return False for symbolic links to folders elsewhere, which could open any folder."""
        real = Path(os.path.realpath(folder))
        return any(real.is_relative_to(parent) for parent in self._package_parents)

    def _is_allowed(self, path: Path) -> bool:
        return any(path.is_relative_to(folder) for folder in self._allowed)

    def _read(self, path: Path, limit: int) -> bytes:
        remaining = min(limit, self._remaining_bytes)
        try:
            data = read_regular(path, remaining)
        except OSError as error:
            if error.errno == errno.EFBIG:
                raise RobotFileError(f"{path.name} has more than {remaining} bytes, the remaining limit") from None
            if error.errno == errno.EINVAL:
                raise RobotFileError(f"{path.name} is not a regular file") from None
            raise
        self._remaining_bytes -= len(data)
        self.digests[Path(os.path.relpath(path, self._folder)).as_posix()] = hashlib.sha256(data).hexdigest()
        return data


def _is_specific(folder: Path) -> bool:
    """Return False for the root of the file system, and for folders that contain the user's home folder."""
    home = Path(os.path.realpath(os.path.expanduser("~")))  # noqa: PTH111 - works without a home folder
    return folder != Path(folder.anchor) and not home.is_relative_to(folder)
