"""Finds the scenes of a command with scenarios: their views, the digest of the scenarios, and earlier choices."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

from gateway.datasets.camera_file import CameraFile
from gateway.datasets.errors import DatasetError
from gateway.datasets.scenario.catalogue import read_catalogue
from gateway.datasets.sources import Source, SourceKind, find_sources
from gateway.datasets.views import View, scene_views
from scenegate.datasets import manifest


def find_scenes(
    inputs: list[Path], cameras: CameraFile, numbers: range | None, recorded: Path | None, out: Path, has_views: bool
) -> tuple[tuple[Source, ...], CameraFile, str | None]:
    """Return the scenes of a command, its cameras with those of scenarios, and ``Settings.scenario_sha256``.

    Args:
        numbers: numbers of the scenes of scenarios; None: all of them.
        recorded: dataset of the same scenario, whose choices are used; None: those in ``out``, if there are any.
        has_views: the command names cameras, which replace those of scenarios.

    Raises:
        DatasetError, ScenarioError, RecordError: a file or folder cannot be used.
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
