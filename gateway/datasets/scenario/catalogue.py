"""Lists the files that a scenario names: models, textures, rigs, environments and backgrounds."""

import glob
import hashlib
import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Final

import msgspec

from gateway.datasets.scenario.file import read_scenario
from gateway.datasets.scenario.tables import Scenario, ScenarioError
from gateway.files.robots.scene_files import FOLDER_SUFFIXES, SCENE_SUFFIXES
from renderers.stop import check_stop
from scenegate.regular_files import errors_as

MAX_ENTRIES: Final = 100_000
"""Maximum number of files and folders in the folders of a path or pattern."""
IMAGE_SUFFIXES: Final = (".png", ".jpg", ".jpeg", ".webp")
RIG_SUFFIXES: Final = (".toml", ".hdr")
_CACHED_CATALOGUES: Final = 8


@dataclass(frozen=True, eq=False)
class Catalogue:
    """A scenario with the lists of its files."""

    path: Path
    scenario: Scenario

    @cached_property
    def models(self) -> dict[tuple[str, int], tuple[str, ...]]:
        """Files of each table of models, by the table's name and index."""
        scenario = self.scenario
        files: dict[tuple[str, int], tuple[str, ...]] = {}
        for kind, models in (("models", scenario.models), ("distractors", scenario.distractors)):
            for index, model in enumerate(models):
                patterns = (model.path,) if isinstance(model.path, str) else model.path
                found = [self.files(pattern, FOLDER_SUFFIXES, f"{kind}[{index}].path") for pattern in patterns]
                files[kind, index] = tuple(sorted({file for each in found for file in each}))
        return files

    @cached_property
    def model_names(self) -> dict[str, str]:
        """Name of each model by its file: the shortest end of its path that no other model has.

        It has no suffix, unless another file differs in that alone. Paths are relative to the scenario's folder.
        """
        folder = self.path.parent
        relative_by_file = {
            file: os.path.relpath(folder / file, folder) for files in self.models.values() for file in files
        }
        unnamed = list(dict.fromkeys(relative_by_file.values()))
        stem_counts = Counter(Path(path).with_suffix("") for path in unnamed)
        parts: dict[str, tuple[str, ...]] = {}
        for path in unnamed:
            stem = Path(path).with_suffix("")
            parts[path] = stem.parts if stem_counts[stem] == 1 else Path(path).parts
        names: dict[str, str] = {}
        part_count = 1
        while unnamed:
            paths_by_name: dict[str, list[str]] = {}
            for path in unnamed:
                paths_by_name.setdefault("/".join(parts[path][-part_count:]), []).append(path)
            for name, paths in paths_by_name.items():
                if len(paths) == 1:
                    names[paths[0]] = name
                elif all(part_count >= len(parts[path]) for path in paths):  # a.obj and a.obj.stl
                    names |= {path: path for path in paths}
            unnamed = [path for path in unnamed if path not in names]
            part_count += 1
        return {file: names[path] for file, path in relative_by_file.items()}

    @cached_property
    def other_files(self) -> dict[str, tuple[str, ...]]:
        """Files of each key that names textures, lights, backgrounds or tracks, and is not empty."""
        scenario = self.scenario
        models = [*enumerate(scenario.models), *enumerate(scenario.distractors, len(scenario.models))]
        keys = {
            "materials.textures": (scenario.materials.textures if scenario.materials else "", IMAGE_SUFFIXES),
            **{
                f"surfaces[{index}].material.textures": (surface.material.textures, IMAGE_SUFFIXES)
                for index, surface in enumerate(scenario.surfaces)
            },
            "lights.rigs": (scenario.lights.rigs, RIG_SUFFIXES),
            "lights.environments": (scenario.lights.environments, (".hdr",)),
            "backgrounds.images": (scenario.backgrounds.images, IMAGE_SUFFIXES),
            **{f"track {index}": (model.joint_track or model.pose_track, (".csv",)) for index, model in models},
        }
        return {key: self.files(pattern, suffixes, key) for key, (pattern, suffixes) in keys.items() if pattern}

    def files(self, pattern: str, suffixes: tuple[str, ...], key: str) -> tuple[str, ...]:
        """Return the files of a path, folder or pattern in ascending order, relative to the scenario's folder.

        They begin as the pattern does. ``suffixes``: those of the files in a folder. ``key``: key in the scenario, for
        the message. Raises ScenarioError if there are none, or too many.
        """
        folder = self.path.parent
        if (folder / pattern).is_file():
            return (pattern,)
        is_folder = (folder / pattern).is_dir()
        search = f"{glob.escape(pattern)}/**/*" if is_folder else pattern
        wanted = SCENE_SUFFIXES if suffixes is FOLDER_SUFFIXES and not is_folder else suffixes
        found: set[str] = set()
        for count, name in enumerate(_matches(folder, search)):
            check_stop()
            if count > MAX_ENTRIES:
                raise ScenarioError(f"{self.path}: {key}: {pattern!r} has more than {MAX_ENTRIES} files and folders")
            if name.lower().endswith(wanted) and (folder / name).is_file():
                found.add(Path(name).as_posix())
        if not found:
            raise ScenarioError(f"{self.path}: {key}: {pattern!r} names no file ({', '.join(suffixes)})")
        return tuple(sorted(found))

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the scenario without its number of scenes, and of the names of its files.

        With the same digest, and the same content of files, a number means the same scene.
        """
        lists = [*self.models.values(), *self.other_files.values()]
        text = msgspec.json.encode([msgspec.structs.replace(self.scenario, scenes=1), lists])
        return hashlib.sha256(text).hexdigest()


def _matches(folder: Path, pattern: str) -> Iterator[str]:
    """Yield the paths that match a pattern as it is written, and an empty text for each other entry on the way.

    ``**`` is this folder and all below it that are not hidden. Links to folders are not followed: they may be loops.
    """
    parts = pattern.split("/")
    if "**" not in parts:
        yield from glob.iglob(pattern, root_dir=folder)  # noqa: PTH207 - keeps the names as written
        return
    index = parts.index("**")
    before, after = "/".join((*parts[:index], "")), "/".join(parts[index + 1 :]) or "*"
    for base in glob.iglob(before, root_dir=folder) if before.strip("/") else (before,):  # noqa: PTH207 - as above
        for path, folders, files in os.walk(folder / base):
            folders[:] = [name for name in folders if not name.startswith(".")]
            yield from [""] * (1 + len(folders) + len(files))
            below = glob.escape(str(Path(base) / Path(path).relative_to(folder / base)))
            yield from _matches(folder, f"{below}/{after}")


def read_catalogue(path: Path) -> Catalogue:
    """Read a scenario, or return it from the cache if its file has not changed. Raises ScenarioError."""
    with errors_as(ScenarioError, path):
        status = path.stat()
    return _read_cached(path, status.st_mtime_ns, status.st_size)


@lru_cache(_CACHED_CATALOGUES)
def _read_cached(path: Path, modified_ns: int, size: int) -> Catalogue:
    """Read a scenario. The time and size of its file are part of the cache's key."""
    return Catalogue(path, read_scenario(path))
