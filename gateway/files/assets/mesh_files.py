"""Loads mesh files that clients name, from the folders that the operator opens (``--mesh-root``), with a cache.

All names, including those of materials and textures in mesh files, are resolved with their symbolic links; the result
must be below one of these roots. With ``any_folder``, for programs on this machine, it may also be elsewhere, if its
extension is one of ``READABLE_EXTENSIONS``. Only regular files are read, and nothing from the network.
"""

import errno
import os
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote

import msgspec

from gateway.files.assets.mesh_formats import FORMATS, MESH_LIMITS, MeshFormatError, ReadReferencedFile, parse_mesh
from gateway.files.gltf import GltfError, GltfLimits
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.transforms import scaling
from renderers.cache import SHARED, Cache, CacheBudget
from scenegate.regular_files import read_regular
from scenegate.robots.ros_packages import Packages, folders_of_environment, split_url

SIBLING_EXTENSIONS = ("obj", "gltf", "glb", "stl", "ply", "dae")
"""If a file is missing or of an unknown format (``.vtp``, ``.sdf``), files of the same name with these extensions are
tried, in this order. Director tries them even for existing files."""

IMAGE_EXTENSIONS = frozenset({"png", "jpg", "jpeg", "webp", "ktx2", "bmp", "dds", "gif", "tga", "tif", "tiff"})
READABLE_EXTENSIONS = FORMATS | IMAGE_EXTENSIONS | {"mtl", "bin"}
"""Extensions of mesh files and of the files that these refer to: materials, buffers of glTF, images."""


class MeshFileError(ValueError):
    """A mesh file that is not allowed, missing or unreadable. The message names the file and the reason."""

    def __init__(self, message: str, *, missing: bool = False) -> None:
        super().__init__(message)
        self.missing = missing
        """True if the file does not exist; False if it cannot be used."""


@dataclass(frozen=True, slots=True)
class MeshFileLimits:
    """Limits of mesh files."""

    max_bytes: int = 256 << 20
    """Size of one file. A typical mesh for a viewer has 10 MB, a scan of ten million triangles in binary STL 500 MB."""
    max_total_bytes: int = 512 << 20
    """Total size of a mesh file and the files that it refers to."""
    gltf: GltfLimits = MESH_LIMITS
    """Limits of the content. Those on vertices, elements, instances and pixels hold for all formats."""


class _Stamp(NamedTuple):
    """State of a file: two different stamps show that it has changed."""

    real_path: str
    changed_ns: int
    nbytes: int


@dataclass(frozen=True, slots=True, eq=False)
class _LoadedFile:
    """A mesh file in the cache."""

    parts: tuple[Part, ...]
    warnings: tuple[str, ...]
    """Sentences about content that is not shown."""
    stamps: tuple[_Stamp, ...]
    """Stamps of the file and of those files that it refers to and that could be read."""


class MeshFiles:
    """Loads mesh files by the names that clients send, in the caller's thread. Thread-safe."""

    def __init__(
        self,
        roots: Iterable[str | Path],
        limits: MeshFileLimits | None = None,
        caches: CacheBudget = SHARED,
        *,
        any_folder: bool = False,
    ) -> None:
        """``roots``: folders that may be read; none: no file is allowed. ``caches``: limit shared with other caches.

        ``any_folder`` True: files of ``READABLE_EXTENSIONS`` may be read from all folders.
        """
        self._roots = tuple(Path(os.path.realpath(root)) for root in roots)
        self._any_folder = any_folder
        self._limits = MeshFileLimits() if limits is None else limits
        self._packages = Packages((*self._roots, *folders_of_environment()) if any_folder else self._roots)
        self._lock = threading.Lock()
        self._loading: dict[str, threading.Lock] = {}
        """Locks by real path, so that threads that need the same file load it only once."""
        self.cache: Cache[str, _LoadedFile] = Cache("mesh_files", budget=caches)
        """Loaded files by real path."""

    def load(
        self, filename: str, scale: tuple[float, float, float] = (1.0, 1.0, 1.0), warnings: list[str] | None = None
    ) -> tuple[Part, ...]:
        """Return the parts of a mesh file, Z up and in metres, scaled along its axes; append warnings.

        ``filename``: ``package://name/path``, ``file:///path``, an absolute path, or a path relative to a root. Raises
        MeshFileError if it is not allowed, missing or unreadable.
        """
        path = self._find(filename)
        key = str(path)
        with self._lock:
            lock = self._loading.setdefault(key, threading.Lock())
        try:
            with lock:
                loaded = self.cache.get(key)
                if loaded is None or any(_stamp(stamp.real_path) != stamp for stamp in loaded.stamps):
                    loaded = self._load(path, filename)
        finally:
            with self._lock:
                self._loading.pop(key, None)
        if warnings is not None:
            warnings += loaded.warnings
        return _scaled(loaded.parts, scale)

    def parse(
        self,
        data: bytes,
        extension: str,
        resolve: ReadReferencedFile,
        name: str,
        scale: tuple[float, float, float],
        warnings: list[str],
    ) -> tuple[Part, ...]:
        """Return the parts of a mesh file in memory, Z up and in metres, scaled along its axes; append warnings.

        ``extension`` is one of ``FORMATS``, ``resolve`` returns the files that it refers to, ``name`` is for messages,
        and the source of the parts. Raises MeshFileError.
        """
        if extension not in FORMATS:
            formats = ", ".join(sorted(FORMATS))
            raise MeshFileError(f"{quoted(name)} is not a file of a known format ({formats})")
        if len(data) > self._limits.max_bytes:
            raise MeshFileError(f"{quoted(name)} has {len(data)} bytes, the limit is {self._limits.max_bytes}")
        return _scaled(self._parsed(data, extension, resolve, name, warnings), scale)

    def read(self, filename: str) -> bytes:
        """Return the bytes of a file that a client names. Raises MeshFileError if it is not allowed or unreadable."""
        for path in self._named_paths(filename):
            if self._is_allowed(path) and _is_file(path):
                try:
                    return _FileReader(path, self._is_allowed, self._limits).read(path, filename)
                except OSError as error:
                    raise MeshFileError(f"{quoted(filename)} cannot be read: {error.strerror}") from error
        raise MeshFileError(f"{quoted(filename)}: there is no such file", missing=True)

    def _find(self, filename: str) -> Path:
        """Return the real path of an existing, allowed file of a known format."""
        named = self._named_paths(filename)
        for path in named:
            if path.suffix[1:].lower() in FORMATS and _is_file(path):
                return path
        for path in named:
            for extension in SIBLING_EXTENSIONS:
                sibling = Path(os.path.realpath(path.with_suffix("." + extension))) if path.name else path
                if self._is_allowed(sibling) and _is_file(sibling):
                    return sibling
        for path in named:
            if _stamp(str(path)) is not None:
                formats = ", ".join(sorted(FORMATS))
                raise MeshFileError(f"{quoted(filename)} is not a file of a known format ({formats})")
        raise MeshFileError(f"{quoted(filename)}: there is no such file", missing=True)

    def _candidates(self, filename: str) -> list[Path]:
        """Return the paths that a client's name may refer to, in any folder, with symbolic links resolved."""
        if "\0" in filename or not filename or len(filename) > 4096:
            raise MeshFileError(f"{quoted(filename)} is not a file name")
        scheme, rest = split_url(filename)
        if scheme == "package":
            package, _, path_in_package = rest.partition("/")
            folder = self._packages.folder(package)
            if folder is None:
                raise MeshFileError(f"{quoted(filename)}: there is no package {quoted(package)}", missing=True)
            paths = [folder / path_in_package.lstrip("/")]
        elif scheme == "file":
            paths = [Path("/" + unquote(rest.removeprefix("localhost/")).lstrip("/"))]
        elif scheme:
            raise MeshFileError(f"{quoted(filename)}: only package:// and file:// can be read, nothing is fetched")
        elif filename.startswith("/"):
            paths = [Path(filename)]
        else:
            paths = [root / filename for root in self._roots]
        try:
            return [Path(os.path.realpath(path)) for path in paths]
        except (OSError, ValueError):
            raise MeshFileError(f"{quoted(filename)} is not a file name") from None

    def _named_paths(self, filename: str) -> list[Path]:
        """Return those of ``_candidates`` in folders that are open to the client. Raises MeshFileError without any."""
        if not self._roots and not self._any_folder:
            raise MeshFileError(
                f"{quoted(filename)}: no folder is open to clients (--mesh-root), and only to programs on this "
                "machine are all (--mesh-root auto)"
            )
        paths = [path for path in self._candidates(filename) if self._any_folder or self._is_below_root(path)]
        if not paths:
            if self._any_folder:
                raise MeshFileError(f"{quoted(filename)} is relative to a folder of --mesh-root, and there is none")
            raise MeshFileError(f"{quoted(filename)} lies outside of the folders that are open to clients")
        return paths

    def _is_below_root(self, path: Path) -> bool:
        return any(path.is_relative_to(root) for root in self._roots)

    def _is_allowed(self, path: Path) -> bool:
        """Return True if a path, with symbolic links resolved, may be read."""
        is_of_known_format = path.suffix[1:].lower() in READABLE_EXTENSIONS
        return self._is_below_root(path) or (self._any_folder and is_of_known_format)

    def _load(self, path: Path, filename: str) -> _LoadedFile:
        reader = _FileReader(path, self._is_allowed, self._limits)
        warnings: list[str] = []
        try:
            data = reader.read(path, filename)
            parts = self._parsed(data, path.suffix[1:].lower(), reader.resolve, filename, warnings)
        except OSError as error:
            raise MeshFileError(f"{quoted(filename)} cannot be read: {error.strerror}") from error
        loaded = _LoadedFile(parts, tuple(warnings), tuple(reader.stamps))
        self.cache.put(str(path), loaded, _nbytes(parts))
        return loaded

    def _parsed(
        self, data: bytes, extension: str, resolve: ReadReferencedFile, name: str, warnings: list[str]
    ) -> tuple[Part, ...]:
        """Return the parts of a file; errors and warnings start with its name."""
        found: list[str] = []
        try:
            parts = parse_mesh(data, extension, resolve, self._limits.gltf, found)
        except (MeshFormatError, GltfError) as error:
            raise MeshFileError(f"{quoted(name)}: {error}") from error
        warnings += [f"{quoted(name)}: {text}" for text in found]
        return tuple(msgspec.structs.replace(part, kind="mesh_file", source=name) for part in parts)


class _FileReader:
    """Reads one mesh file and the allowed files that it refers to, within the limits."""

    def __init__(self, path: Path, is_allowed: Callable[[Path], bool], limits: MeshFileLimits) -> None:
        self._folder = path.parent
        self._is_allowed = is_allowed
        self._limits = limits
        self._remaining_bytes = limits.max_total_bytes
        """Bytes that may still be read."""
        self.stamps: list[_Stamp] = []
        """Stamps of the files read so far."""

    def resolve(self, name: str) -> bytes:
        """Return the bytes of a file that the mesh file refers to, relative to its folder and percent-encoded."""
        if "\0" in name or "://" in name:
            raise MeshFileError(f"{quoted(name)} is not a file beside it")
        path = Path(os.path.realpath(self._folder / unquote(name).replace("\\", "/")))
        if not self._is_allowed(path):
            raise MeshFileError(f"{quoted(name)} lies outside of the folders or formats that are open to clients")
        return self.read(path, name)

    def read(self, path: Path, name: str) -> bytes:
        """Return the bytes of a regular file, whose path has its links resolved. ``name`` is for messages."""
        stamp = _stamp(str(path))
        limit = min(self._limits.max_bytes, self._remaining_bytes)
        try:
            data = read_regular(path, limit, follow_links=False)
        except OSError as error:
            if error.errno == errno.EFBIG:
                raise MeshFileError(f"{quoted(name)} is larger than the {limit} bytes that are left to it") from None
            raise
        self._remaining_bytes -= len(data)
        if stamp is not None:
            self.stamps.append(stamp)
        return data


def _scaled(parts: tuple[Part, ...], scale: tuple[float, float, float]) -> tuple[Part, ...]:
    if scale == (1.0, 1.0, 1.0):
        return parts
    X = scaling(*scale)
    return tuple(msgspec.structs.replace(part, X_node_part=X @ part.X_node_part) for part in parts)


def _is_file(path: Path) -> bool:
    """Return True for an existing file. For an invalid name, the result is False; ``Path.is_file`` raises an error."""
    return os.path.isfile(path)  # noqa: PTH113 - see the docstring


def _stamp(path: str) -> _Stamp | None:
    """Return the stamp of a file; None if it does not exist."""
    try:
        status = os.stat(path)  # noqa: PTH116 - a stamp holds a string
    except (OSError, ValueError):
        return None
    return _Stamp(path, status.st_mtime_ns, status.st_size)


def _nbytes(parts: tuple[Part, ...]) -> int:
    """Return the approximate size of all parts in bytes; shared shapes are counted once."""
    part_by_shape = {id(part.shape): part for part in parts}
    return 1024 * len(parts) + sum(part.array_bytes for part in part_by_shape.values())


def quoted(name: str) -> str:
    """Return a name from a client for a message: quoted, and shortened to 120 characters."""
    return repr(name if len(name) <= 120 else name[:117] + "...")
