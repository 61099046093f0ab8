"""Write datasets in the formats that other programs read: BOP, COCO, WebDataset, HDF5. See ``docs/dataset-formats.md``.

COCO, WebDataset and HDF5 need the packages of ``scenegate-client[formats]``. The folder of an export appears when it
is complete.
"""

import importlib
import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Final, Literal, get_args

import msgspec

from scenegate.datasets.dataset import Dataset, Sample
from scenegate.datasets.manifest import DATASET_FILE, MANIFEST_FILE, ImageType, RecordError, read_file
from scenegate.regular_files import sha256_of

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
RECORD_FILE: Final = "export.json"
"""An ``ExportRecord``, in the folder of an export."""
ReportProgress = Callable[[int], object]
"""Called with the number of samples that are written."""


class ExportError(ValueError):
    """A dataset cannot be written in a format; the message is one sentence."""


class ExportRecord(msgspec.Struct, frozen=True):
    """State of a dataset, and of the folder with its export, when the export was written."""

    format_name: FormatName
    dataset: tuple[str | None, str | None]
    """SHA-256 of ``DATASET_FILE`` and of ``MANIFEST_FILE``, which lists those of all images; None: unreadable."""
    files: str
    """Digest of the names and contents of all other files of the folder, and of the names of its folders."""


def check_types(types: Sequence[ImageType], format_name: FormatName) -> None:
    """Raise ExportError if a format needs types of images that are not among these."""
    missing = [image_type for image_type in NEEDED_TYPES[format_name] if image_type not in types]
    if missing:
        wanted = ",".join((*types, *missing))
        raise ExportError(f"the format {format_name} needs {', '.join(missing)} images: render with --type {wanted}")


def export(
    dataset: Dataset,
    destination: Path,
    format_name: FormatName,
    report: ReportProgress = lambda done: None,
    *,
    replace: bool = False,
) -> bool:
    """Write all samples of a dataset in another format. Return False if ``replace`` finds the same export there.

    The same dataset gives the same bytes. The folder is written under a temporary name, so that it is complete or
    missing.

    Args:
        destination: folder to write.
        replace: replace an earlier export in the folder, unless it is of the same dataset and format. False: the folder
            must be empty or missing.

    Raises:
        ExportError: the dataset lacks images that the format needs; or as ``check_destination``.
        RecordError: a sample, a model or an image cannot be read.
        ImportError: a package is missing; the message names it and the remedy.
        OSError: the folder cannot be written.
    """
    check_types(dataset.description.settings.types, format_name)
    earlier = check_destination(destination, dataset.folder, format_name, replace=replace)
    dataset_hashes = (sha256_of(dataset.folder / DATASET_FILE), sha256_of(dataset.folder / MANIFEST_FILE))
    if earlier is not None and (earlier.format_name, earlier.dataset) == (format_name, dataset_hashes):
        return False
    write = _writer(format_name)
    temporary = destination.with_name(f".{destination.name}{TEMPORARY_SUFFIX}")
    shutil.rmtree(temporary, ignore_errors=True)  # of a process that was killed
    temporary.mkdir(parents=True)
    try:
        write(dataset, temporary, _counted(dataset, report))
        record = ExportRecord(format_name, dataset_hashes, _files_digest(temporary))
        (temporary / RECORD_FILE).write_bytes(msgspec.json.encode(record) + b"\n")
        # Again: a program may have written there meanwhile.
        if check_destination(destination, dataset.folder, format_name, replace=replace) is not None:
            shutil.rmtree(destination)
        temporary.replace(destination)
    except BaseException as error:
        shutil.rmtree(temporary, ignore_errors=True)
        if isinstance(error, OSError) and error.strerror and error.filename is None:  # of writing, as on a full disk
            error.filename = str(destination)
        raise
    return True


def check_destination(
    destination: Path, dataset_folder: Path, format_name: FormatName, *, replace: bool
) -> ExportRecord | None:
    """Return the record of the export that is in a folder; None if the folder is empty or missing.

    Raises ExportError if the folder is a symbolic link, is in the dataset's folder under another name than the
    format's, is not empty although ``replace`` is False, or has files that are not as an export wrote them.
    """
    if destination.is_symlink():
        raise ExportError(f"{destination} is a symbolic link; name a folder")
    target, format_folder = destination.resolve(), dataset_folder / format_name
    if target != format_folder.resolve() and target.is_relative_to(dataset_folder.resolve()):
        raise ExportError(f"{destination} is in the dataset, where only {format_folder} can be; name another folder")
    if not destination.exists() or (destination.is_dir() and not any(destination.iterdir())):
        return None
    if not replace:
        raise ExportError(f"{destination} is there and not empty; name another folder")
    try:
        record = read_file(destination / RECORD_FILE, ExportRecord)
    except RecordError:
        record = None
    if record is None or record.files != _files_digest(destination):
        raise ExportError(f"{destination} is not as an export wrote it: files were added, changed or removed; move it")
    return record


def _files_digest(folder: Path) -> str:
    digest = sha256()
    for path in sorted({*folder.rglob("*")} - {folder / RECORD_FILE}):
        content_hash = sha256_of(path)  # None for a folder
        digest.update(json.dumps((str(path.relative_to(folder)), content_hash)).encode())
    return digest.hexdigest()


def _writer(format_name: FormatName) -> Callable[[Dataset, Path, Iterator[Sample]], None]:
    """Return the function that writes a format; its module imports the format's package."""
    try:
        module = importlib.import_module(f"scenegate.datasets.formats.{format_name}_format")
    except ImportError as error:
        raise ImportError(f"{error}: the format {format_name} needs pip install 'scenegate-client[formats]'") from None
    write: Callable[[Dataset, Path, Iterator[Sample]], None] = module.write
    return write


def _counted(dataset: Dataset, report: ReportProgress) -> Iterator[Sample]:
    """Yield the samples; report the number of those that are written."""
    for done, sample in enumerate(dataset):
        report(done)
        yield sample
    report(len(dataset))
