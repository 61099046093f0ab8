"""Finds and reads the files that a robot file refers to: relative and absolute paths, ``package://``, ``file://``.

Robot files are named by the user, so they may name any file that the user can read. Mesh and image files of links
that cannot be read are warnings.
"""

import errno
import glob
import hashlib
import itertools
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, TypeVar
from urllib.parse import unquote

from scenegate.messages.mesh_file import MESH_SUFFIXES, referenced_path, spellings
from scenegate.regular_files import is_pipe, read_file_or_pipe, read_regular, reason_of
from scenegate.robots.link_model import LinkMaterial, MeshReference
from scenegate.robots.robot_errors import RobotFileError, RobotFileLimits
from scenegate.robots.ros_packages import (
    PATH_VARIABLES,
    Packages,
    folders_of,
    folders_of_environment,
    package_name,
    split_url,
)

_PACKAGE_SCHEMES: Final = ("package", "model", "models")
"""URL schemes whose first path element is a package. Gazebo looks for all in the same way, also the misspelt one."""
_NOT_PACKAGES: Final = ("", ".", "..")
"""First path elements of package URLs that name no package."""
_MAX_CONFIG_BYTES: Final = 1 << 16
"""Maximum size of a ``model.config``, which usually has less than 2 kB."""
_SDF_ELEMENT: Final = re.compile(r"<sdf[^<>]*>([^<>]+)</sdf>")
"""Name of an SDF file in a ``model.config``."""


_FUEL_URL: Final = re.compile(r"https?://[^/]+/[\d.]+/[^/]+/models/([^/]+)(?:/(?:\d+|tip))?(?:/files)?(?:/(.*))?")
"""URL of a model of Gazebo Fuel, or of a file in it: they are read like ``model://name/file``."""


class RobotFiles:
    """Reads a robot file and the files that it refers to."""

    def __init__(
        self,
        path: Path,
        roots: Iterable[Path],
        limits: RobotFileLimits,
        check_cancelled: Callable[[], object] = lambda: None,
        xacro_args: Mapping[str, str] | None = None,
    ) -> None:
        """``path``: the robot file, which may be a pipe. ``roots``: folders of packages and relative names.

        ``check_cancelled``: called again and again while a pipe is read; may raise an exception to cancel it.
        ``xacro_args``: values of ``$(arg name)`` by name, in the robot file and in what it includes.
        """
        self._check_cancelled = check_cancelled
        self.is_pipe = is_pipe(path)
        """True for a pipe, as in ``publish <(xacro …)``. ``path`` is then a name in the working directory, where its
        relative names start; there need not be such a file."""
        self._source = path
        self.path = Path.cwd() / path.name if self.is_pipe else Path(os.path.realpath(path))
        self._folder = self.path.parent
        self._roots = tuple(Path(os.path.realpath(root)) for root in roots)
        self._package_roots = (*self._roots, *folders_of_environment())
        """Folders that contain packages at any depth."""
        self._packages = Packages(self._package_roots)
        self._limits = limits
        self._remaining_bytes = limits.max_total_bytes
        self.xacro_args: Final = xacro_args or {}
        self.used_args: set[str] = set()
        """Names of arguments that the files have."""
        self.notes: list[str] = []
        """Sentences about files that are read from other places than the robot file says, and what is drawn instead."""
        self.digests: dict[str, str] = {}
        """SHA-256 in hexadecimal of each file that has been read, by path relative to the robot file's folder."""

    def read_robot_file(self) -> bytes:
        """Return the bytes of the robot file; raises OSError, or RobotFileError beyond the limit."""
        if not self.is_pipe:
            return self.read(self.path, self._limits.max_file_bytes)
        data = read_file_or_pipe(self._source, self._limits.max_file_bytes, self._check_cancelled)
        self._note(self.path, data)
        return data

    def find(self, name: str) -> Path:
        """Return the path of a file that the robot file names. Raises RobotFileError if there is none.

        If no file has the literal name, backslashes are read as slashes, then URL escapes (``%20``) are decoded. A path
        of another machine, ``/…/share/NAME/rest`` or ``/…/NAME/meshes/…``, is that of a package's file; at last, each
        of its folders is taken for the package. A relative path may be relative to a folder above the robot file.
        """
        scheme, rest = _split_name(name)
        missing: list[Path] = []
        for spelling in spellings(rest):
            for candidate in self._candidates(scheme, spelling):
                if candidate.is_file():
                    return Path(os.path.realpath(candidate))
                missing.append(candidate)
        for package, path_in_package, _ in _split_path(scheme, spellings(rest)[-1]):
            for folder in self._package_folders(package):
                if (folder / path_in_package).is_file():
                    start = name.partition(package)[0] + package
                    return self._elsewhere(f"{start} is not on this machine, its files", folder, path_in_package)
        for folder, spelling in itertools.product(self._folder.parents, spellings(rest)):
            if "/" in spelling and not scheme and (folder / spelling).is_file():
                start = os.path.normpath(spelling).partition("/")[0]
                return self._elsewhere(f"files of {start}, which are not beside the robot file,", folder, spelling)
        raise RobotFileError(self._not_found(name, scheme, missing))

    def _elsewhere(self, files: str, folder: Path, path: str) -> Path:
        """Return the path of a file in a folder, with a note about it."""
        note = f"{files} are read from {folder}"
        if note not in self.notes:
            self.notes.append(note)
        return Path(os.path.realpath(folder / path))

    def find_model(self, uri: str, folder: Path) -> Path:
        """Return the path of a model that an SDF file in a folder includes; raises RobotFileError if there is none.

        ``uri``: file or folder, in which ``model.config`` names the file; the default is ``model.sdf``. What is not in
        the folder is looked for like ``model://``.
        """
        scheme, rest = _split_name(uri)
        candidates = self._candidates(scheme or "model", rest)
        for candidate in candidates if scheme else itertools.chain((folder / uri,), candidates):
            if candidate.is_file():
                return candidate
            if candidate.is_dir():
                for name in (*_files_of_config(candidate / "model.config"), "model.sdf"):
                    if (candidate / name).is_file():
                        return candidate / name
        raise RobotFileError(self._not_found(uri, scheme, []))

    def find_package(self, name: str) -> Path | None:
        """Return the folder of a package; None if there is none."""
        return None if name in _NOT_PACKAGES else next(filter(Path.is_dir, self._package_folders(name)), None)

    def read(self, path: Path, max_bytes: int | None = None) -> bytes:
        """Return the bytes of a file that ``find`` returned; raises OSError, or RobotFileError beyond the limits.

        ``max_bytes``: default: that of a mesh file.
        """
        remaining = min(self._limits.max_mesh_bytes if max_bytes is None else max_bytes, self._remaining_bytes)
        try:
            data = read_regular(path, remaining)
        except OSError as error:
            if error.errno == errno.EFBIG:
                raise RobotFileError(f"{path.name} has more than {remaining} bytes, the remaining limit") from None
            if error.errno == errno.EINVAL:
                raise RobotFileError(f"{path.name} is not a regular file") from None
            raise
        self._note(path, data)
        return data

    def read_beside(self, mesh: Path, name: str) -> bytes:
        """Read a file that a mesh file names, by URL or as for ``referenced_path``. Raises OSError, RobotFileError."""
        return self.read(self.find(name) if split_url(name)[0] else referenced_path(mesh, name))

    def _candidates(self, scheme: str, path: str) -> Iterator[Path]:
        """Yield the paths that a file may have, in order of preference."""
        is_relative_url = scheme == "file" and not path.startswith("/")  # some write file://meshes/a.stl
        if scheme == "file":
            yield Path("/" + path.lstrip("/"))
        if not scheme or is_relative_url:
            yield from (folder / path for folder in (self._folder, *self._roots))
        package, path_in_package = _split_package(path)
        # With file://robot/meshes/a.stl, Gazebo looks for a package, too.
        if (scheme in _PACKAGE_SCHEMES or is_relative_url) and package not in _NOT_PACKAGES:
            yield from (folder / path_in_package for folder in self._package_folders(package))
            # Outside of ROS, the file may lie beside the robot file without its package's folder, as in PyBullet.
            if path_in_package:
                yield from (folder / path_in_package for folder in self.path.parents)

    def _package_folders(self, package: str) -> Iterator[Path]:
        """Yield folders that may be a package.

        - Folders that contain the robot file, with that folder name or package name.
        - Folders with that folder name or package name at or below a root; the folders of ``PATH_VARIABLES`` are roots,
          too, and come last.
        - The package below a prefix of ``AMENT_PREFIX_PATH``.
        - Folders of that name beside the robot file, or beside a folder that contains it, also in a folder ``models``
          there: Gazebo's worlds are in ``worlds``.
        - The versions of that model that Gazebo has downloaded.
        """
        for folder in self.path.parents:
            if folder.name == package or package_name(folder / "package.xml") == package:
                yield folder
        for root in self._package_roots:
            yield root / package
            if root.name == package:
                yield root
        if (found := self._packages.folder(package)) is not None:
            yield found
        yield from (prefix / "share" / package for prefix in folders_of("AMENT_PREFIX_PATH"))
        for folder in self.path.parents:
            yield folder / package
            yield folder / "models" / package
        downloads = Path(os.path.expanduser("~/.gz/fuel"))  # noqa: PTH111 - Path.expanduser raises without a home
        yield from sorted(downloads.glob(f"*/*/models/{glob.escape(package.lower())}/*"), key=_version, reverse=True)

    def _not_found(self, name: str, scheme: str, missing: list[Path]) -> str:
        """Return the reason why there is no file, with a similar name or the folders that were searched if possible.

        ``missing``: paths that the file could have had.
        """
        for candidate in missing:
            if candidate.exists() and not candidate.is_dir():
                return "it is not a regular file"
            other = _other_case(candidate)
            if other is not None:
                return f"there is no such file, but one whose name differs in upper and lower case: {other}"
        if scheme in _PACKAGE_SCHEMES:
            package, _ = _split_package(_split_name(name)[1])
            start = ""
        else:
            package = next((package for package, _, is_likely in _split_path(*split_url(name)) if is_likely), "")
            start = "there is no such file, and "
            if not package:
                return "there is no such file"
        folder = self.find_package(package)
        if folder is not None:
            return f"there is no such file{', nor one' if start else ''} in {folder}"
        return (
            f"{start}the package {package!r} is not above or beside the robot file, nor in a folder of "
            f"{', '.join(PATH_VARIABLES)} or AMENT_PREFIX_PATH; name a folder that contains it with --root"
        )

    def _note(self, path: Path, data: bytes) -> None:
        """Count the bytes of a file that was read, and note its digest."""
        self._remaining_bytes -= len(data)
        self.digests[Path(os.path.relpath(path, self._folder)).as_posix()] = hashlib.sha256(data).hexdigest()


def _split_name(name: str) -> tuple[str, str]:
    """Return the scheme and the rest of a name in a robot file; raises RobotFileError if it cannot name a file."""
    if not name or "\0" in name or len(name) > 4096:
        raise RobotFileError(f"{name[:100]!r} is not a file name")
    if match := _FUEL_URL.fullmatch(unquote(name)):
        return "model", f"{match[1]}/{match[2] or ''}"
    scheme, rest = split_url(name)
    if scheme not in ("", "file", *_PACKAGE_SCHEMES):
        raise RobotFileError("only files, package:// and file:// can be read, nothing is fetched")
    return scheme, rest


def _version(folder: Path) -> int:
    return int(folder.name) if folder.name.isdecimal() else 0


def _split_package(path: str) -> tuple[str, str]:
    """Return the package that the rest of a package URL names, and the path in it."""
    package, _, path_in_package = path.lstrip("/").partition("/")
    return package, path_in_package.lstrip("/")


def _split_path(scheme: str, path: str) -> Iterator[tuple[str, str, bool]]:
    """Yield the packages in whose folder a file of another machine may be, likely ones first.

    The tuples are package, path in it, and True if it is likely.
    """
    parts = path.replace("\\", "/").split("/")
    if scheme == "file" or (not scheme and (parts[0] in ("", "..", "~") or parts[0].endswith(":"))):
        likely = [parts[index - 1] == "share" or parts[index + 1] == "meshes" for index in range(len(parts) - 1)]
        for index in sorted(range(len(likely)), key=lambda each: not likely[each]):
            if parts[index] not in _NOT_PACKAGES:
                yield parts[index], "/".join(parts[index + 1 :]), likely[index]


def _files_of_config(config: Path) -> list[str]:
    """Return the SDF files that a ``model.config`` names, the last one first: that is the newest version."""
    try:
        text = read_regular(config, _MAX_CONFIG_BYTES).decode("utf-8", "replace")
    except OSError:
        return []
    return [name.strip() for name in _SDF_ELEMENT.findall(text)[::-1]]


def _other_case(path: Path) -> Path | None:
    """Return a file whose path differs from a missing one in upper and lower case only."""
    existing = next((folder for folder in path.parents if folder.is_dir()), None)
    if existing is None:
        return None
    found = existing
    for name in path.relative_to(existing).parts:
        try:
            matches = [entry for entry in found.iterdir() if entry.name.casefold() == name.casefold()]
        except OSError:
            return None
        if not matches:
            return None
        found = min(matches)
    return found if found.is_file() else None


Content = TypeVar("Content")

DEFAULT_RGBA: Final = (0.9, 0.9, 0.9, 1.0)
"""Colour of geometry without a material, as in Drake."""


class LinkFiles:
    """Finds, reads and parses files, each name once."""

    def __init__(self, files: RobotFiles, warnings: list[str], parse_errors: tuple[type[Exception], ...] = ()) -> None:
        """``parse_errors``: those of ``parse`` and ``decode`` for bad files, besides RobotFileError and OSError."""
        self._files = files
        self._warnings = warnings
        self._errors: tuple[type[Exception], ...] = (RobotFileError, OSError, *parse_errors)
        self._contents: dict[tuple[str, ...], Any] = {}
        """Contents, or the reason why a file cannot be read, by name or URL; for meshes also by submesh."""

    def mesh(self, link: str, mesh: MeshReference, parse: Callable[[Path, bytes], Content]) -> Content | None:
        """Return the result of ``parse`` for the path and bytes of a mesh file; None, with a warning, on failure."""
        warning = f"link {link!r}: the mesh {mesh.filename} is not shown"
        if Path(mesh.filename).suffix.lower() not in MESH_SUFFIXES:
            formats = ", ".join(suffix[1:] for suffix in MESH_SUFFIXES)
            self._warnings.append(f"{warning}: it is not one of the formats {formats}")
            return None
        return self._content((mesh.filename, mesh.submesh), parse, warning)

    def texture(
        self, link: str, material: LinkMaterial | None, decode: Callable[[Path, bytes], Content]
    ) -> Content | None:
        """Return the texture of a material as ``decode`` does; None if it has none or, with a warning, on failure."""
        if material is None or material.texture is None:
            return None
        warning = f"link {link!r}: the texture {material.texture} of its material is not shown"
        return self._content((material.texture,), decode, warning)

    def _content(self, key: tuple[str, ...], parse: Callable[[Path, bytes], Content], warning: str) -> Content | None:
        if key not in self._contents:
            try:
                path = self._files.find(key[0])
                data = self._files.read(path)
                self._contents[key] = parse(path, data)
            except self._errors as error:
                self._contents[key] = reason_of(error)
        content: Content | str = self._contents[key]
        if isinstance(content, str):
            self._warnings.append(f"{warning}: {content}")
            return None
        return content


def color_of(material: LinkMaterial | None) -> tuple[float, float, float, float]:
    """Return the colour of geometry with a material, sRGB and opacity."""
    return DEFAULT_RGBA if material is None or material.rgba is None else material.rgba
