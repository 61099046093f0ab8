"""Write a dataset in another format: checks, progress, and a folder that appears when it is complete."""

from __future__ import annotations

import importlib
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final, Literal, get_args

from scenegate.datasets.dataset import Dataset, Sample
from scenegate.datasets.manifest import ImageType

FormatName = Literal["bop", "coco", "webdataset", "hdf5"]
FORMATS: Final[tuple[FormatName, ...]] = get_args(FormatName)
NEEDED_TYPES: Final[dict[FormatName, tuple[ImageType, ...]]] = {
    "bop": ("color", "depth", "instance", "amodal"),
    "coco": ("color", "instance"),
    "webdataset": (),
    "hdf5": (),
}
"""Types of images that a dataset must have for a format."""
TEMPORARY_SUFFIX: Final = ".scenegate-export"
"""Suffix of a folder that is being written."""
Report = Callable[[int], object]
"""Called with the number of samples that are written."""


class ExportError(ValueError):
    """A dataset cannot be written in a format; the message is one sentence."""


def check_types(types: Sequence[ImageType], format_name: FormatName) -> None:
    """Raise ExportError if a format needs types of images that are not among these."""
    missing = [name for name in NEEDED_TYPES[format_name] if name not in types]
    if missing:
        wanted = ",".join((*types, *missing))
        raise ExportError(f"the format {format_name} needs {', '.join(missing)} images: render with --type {wanted}")


def export(
    dataset: Dataset,
    destination: Path,
    format_name: FormatName,
    report: Report = lambda done: None,
    *,
    replace: bool = False,
) -> None:
    """Write all samples of a dataset in another format.

    The same dataset gives the same bytes. The folder is written under a temporary name, so that it is complete or
    missing.

    Args:
        destination: folder to write, which must be empty or missing.
        replace: remove the folder if it is there.

    Raises:
        ExportError: the folder is not empty, or the dataset lacks images that the format needs.
        RecordError: a sample, a model or an image cannot be read.
        ImportError: a package is missing; the message names it and the remedy.
        OSError: the folder cannot be written.
    """
    check_types(dataset.description.settings.types, format_name)
    if not replace and destination.exists() and (not destination.is_dir() or any(destination.iterdir())):
        raise ExportError(f"{destination} is there and not empty; name another folder")
    write = _writer(format_name)
    temporary = destination.with_name(f".{destination.name}{TEMPORARY_SUFFIX}")
    shutil.rmtree(temporary, ignore_errors=True)  # of a process that was killed
    temporary.mkdir(parents=True)
    try:
        write(dataset, temporary, _counted(dataset, report))
        if replace and destination.is_dir():
            shutil.rmtree(destination)
        temporary.replace(destination)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise


def _writer(format_name: FormatName) -> Callable[[Dataset, Path, Iterator[Sample]], None]:
    """Return the function that writes a format; its module imports the format's package."""
    try:
        module = importlib.import_module(f"scenegate.datasets.formats.{format_name}_format")
    except ImportError as error:
        raise ImportError(f"{error}: the format {format_name} needs pip install 'scenegate-client[formats]'") from None
    write: Callable[[Dataset, Path, Iterator[Sample]], None] = module.write
    return write


def _counted(dataset: Dataset, report: Report) -> Iterator[Sample]:
    """Yield the samples; report the number of those that are written."""
    for done, sample in enumerate(dataset):
        report(done)
        yield sample
    report(len(dataset))
