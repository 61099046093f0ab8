"""Find the scenes of a command: the files that it names, those in the folders that it names, and those of scenarios."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Final

from gateway.datasets.errors import DatasetError
from gateway.datasets.scenario.catalogue import read_catalogue
from gateway.datasets.views import CameraFile, View, scene_views
from gateway.files.robots.scene_files import AMBIGUOUS_SUFFIXES, FOLDER_SUFFIXES
from scenegate.datasets import manifest
from scenegate.printable import printable
from scenegate.regular_files import is_pipe


class SourceKind(Enum):
    """Kind of a scene file."""

    FILE = "glTF, mesh or robot file"
    TREE = "request of a tree viewer client"
    """A request of Director's remote tree viewer protocol, as JSON."""
    REQUEST = "recorded render request"
    SCENARIO = "scenario"
    """A scene of a scenario file (TOML)."""


TREE_SUFFIX: Final = ".tree.json"
"""Suffix of tree viewer requests in folders. If the command names the file, .json suffices."""
REQUEST_SUFFIX: Final = ".multipart"
"""Suffix of render requests that ``--keep-failures`` recorded. The file is the unchanged body of the POST."""
_SUFFIXES: Final = ", ".join((*FOLDER_SUFFIXES, TREE_SUFFIX, REQUEST_SUFFIX))
"""Suffixes of scene files, for error messages."""
_NAMED_SUFFIXES: Final = {
    ".json": SourceKind.TREE,
    ".toml": SourceKind.SCENARIO,
    **dict.fromkeys(AMBIGUOUS_SUFFIXES, SourceKind.FILE),
}
"""Suffixes of files that may be something else, so that they are scenes only if a command names them."""
MAX_NAME_CHARS: Final = 200
"""Maximum length of a scene's name. It becomes a file name, for which file systems allow 255 bytes."""


@dataclass(frozen=True, slots=True)
class Source:
    """A scene file."""

    name: str
    """Unique name in the dataset: the path relative to the folder that the command names, or the name of the file."""
    path: str
    """Absolute path."""
    kind: SourceKind
    problem: str = ""
    """Reason why the name cannot be used in a dataset; empty if it can."""
    number: int = 0
    """Number of a scenario's scene."""
    recorded: str = ""
    """Folder of a dataset whose ``scene.json`` has the choices of a scenario's scene, if it is there."""

    @property
    def printable_name(self) -> str:
        """The name without control characters."""
        return printable(self.name)


def find_scenes(
    inputs: list[Path], cameras: CameraFile, numbers: range | None, recorded: Path | None, out: Path, has_views: bool
) -> tuple[tuple[Source, ...], CameraFile, str | None]:
    """Return the scenes of a command, its cameras with those of scenarios, and ``Settings.scenario_sha256``.

    ``numbers``: those of the scenes of scenarios; None: all. ``recorded``: dataset of the same scenario, whose choices
    are used; None: those in ``out``, if any. ``has_views``: the command names cameras, which replace those of
    scenarios. Raises DatasetError, ScenarioError or RecordError.
    """
    sources = find_sources(inputs, numbers)
    paths = sorted({source.path for source in sources if source.kind is SourceKind.SCENARIO})
    if not paths:
        if numbers is not None or recorded is not None:
            raise DatasetError("--scenes and --recorded are for scenarios (.toml)")
        return sources, cameras, None
    digest = hashlib.sha256("".join(read_catalogue(Path(path)).digest for path in paths).encode()).hexdigest()
    if recorded is not None and manifest.read_dataset(recorded).settings.scenario_sha256 != digest:
        raise DatasetError(f"--recorded {recorded}: it is not a dataset of {', '.join(paths)} as they are now")
    folder = str((recorded or out).absolute())
    sources = tuple(replace(s, recorded=folder) if s.kind is SourceKind.SCENARIO else s for s in sources)
    if has_views or cameras.default_views:
        return sources, cameras, digest
    views: dict[str, tuple[View, ...]] = {}
    for path in paths:
        scenario = read_catalogue(Path(path)).scenario
        # One tuple for all scenes, of which there may be millions.
        own = scene_views(scenario.camera_count, scenario.frame_count)
        views |= {source.name: own for source in sources if source.path == path}
    return sources, replace(cameras, scene_views={**views, **cameras.scene_views}), digest


def find_sources(inputs: Iterable[Path], numbers: range | None = None) -> tuple[Source, ...]:
    """Return the scenes of the inputs, which are files and folders, ordered by name; of scenarios those with numbers.

    Raises ScenarioError, or DatasetError if an input has no scene file, or two would have the same name.
    """
    by_name: dict[str, Source] = {}
    for path in inputs:
        sources = list(_sources_below(path)) if path.is_dir() else _named_sources(path, numbers)
        if not sources:
            raise DatasetError(f"{path} holds no scene: no {_SUFFIXES}")
        for source in sources:
            existing = by_name.setdefault(source.name, source)
            if existing.path != source.path:
                advice = "rename one" if source.kind is SourceKind.SCENARIO else "pass the folder above them"
                raise DatasetError(f"{existing.path} and {source.path} would both be called {source.name}; {advice}")
    return tuple(by_name[name] for name in sorted(by_name))


def _sources_below(folder: Path) -> Iterable[Source]:
    """Yield the scene files in a folder and its subfolders. Hidden files and folders are skipped."""
    for path in sorted(folder.rglob("*")):
        kind = kind_of(path)
        if kind is None or not path.is_file():
            continue
        if any(part.startswith(".") for part in path.relative_to(folder).parts):
            continue
        yield _make_source(path.relative_to(folder).as_posix(), path, kind)


def _named_sources(path: Path, numbers: range | None) -> list[Source]:
    """Return the scenes of a file that a command names: the scenes of a scenario, or the only one of another file."""
    if path.suffix.lower() != ".toml":
        kind = kind_of(path) or _NAMED_SUFFIXES.get(path.suffix.lower())
        if not path.suffix and is_pipe(path):
            kind = SourceKind.FILE
        if kind is None:
            raise DatasetError(f"{path} is not a scene: not {_SUFFIXES}, {', '.join(_NAMED_SUFFIXES)}")
        return [_make_source(path.name, path, kind)]
    count = read_catalogue(path.resolve()).scenario.scenes
    source = _make_source(f"{path.stem}-{0:06d}", path, SourceKind.SCENARIO)
    if numbers is not None and numbers.stop > count:
        raise DatasetError(f"--scenes: {path} has the scenes 0 to {count - 1}, not {numbers.stop - 1}")
    return [replace(source, name=f"{path.stem}-{k:06d}", number=k) for k in numbers or range(count)]


def _make_source(name: str, path: Path, kind: SourceKind) -> Source:
    """Return a scene file; set its ``problem`` if the name cannot be used."""
    problem = ""
    if len(name) > MAX_NAME_CHARS:
        problem = f"a name of {len(name)} characters; {MAX_NAME_CHARS} are the most: rename the file"
    elif bad_character := next((char for char in name if char == "\\" or not char.isprintable()), None):
        problem = f"a name with the character {bad_character!r}, which not every system can write: rename the file"
    return Source(name, str(path if is_pipe(path) else path.resolve()), kind, problem)


def kind_of(path: Path) -> SourceKind | None:
    """Return the kind of a scene file by its name, or None if it is not a scene file."""
    name = path.name.lower()
    if name.endswith(TREE_SUFFIX):
        return SourceKind.TREE
    if name.endswith(REQUEST_SUFFIX):
        return SourceKind.REQUEST
    return SourceKind.FILE if name.endswith(FOLDER_SUFFIXES) else None
