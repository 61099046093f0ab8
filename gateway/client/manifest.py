"""File formats of a dataset: names of the files, and their records. See ``docs/datasets.md``.

``dataset.json`` has the settings of all images, each line of ``manifest.jsonl`` is a ``Sample``, and every scene has a
folder with a ``scene.json``. No record has times or machine names, so that the same input gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final, Literal, TypeVar

import msgspec

DATASET: Final = "dataset.json"
MANIFEST: Final = "manifest.jsonl"
JOURNAL: Final = "journal.jsonl"
"""Finished samples of a run that has not ended, in the order in which they finished."""
FAILED: Final = "failed.jsonl"
SCENES: Final = "scenes"
SCENE: Final = "scene.json"
FORMAT: Final = "scenegate-dataset"
FORMAT_VERSION: Final = 1
MAX_LINE: Final = 1 << 20
"""Maximum size of a line in bytes; a sample has about 700."""
MAX_DESCRIPTION: Final = 256 << 20
"""Maximum size of a dataset.json or scene.json in bytes; a scene with a million labelled paths has 60 MB."""

ImageType = Literal["color", "depth", "label"]
IMAGE_TYPES: Final[tuple[ImageType, ...]] = ("color", "depth", "label")


class RecordError(ValueError):
    """A record cannot be read; the message names the file, the line and the reason."""


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings of all images of a dataset, except recorded requests, which contain their own."""

    types: tuple[ImageType, ...]
    width: int
    height: int
    """Default image size in pixels, for cameras without their own."""
    fovy: float
    """Default vertical field of view in degrees."""
    look: str
    up: str
    antialias: str
    depth_format: str
    """``tiff``: 32-bit float, metres; ``png``: 16 bit, millimetres, 65535 is too far or nothing."""
    background: tuple[int, int, int]
    samples: int = 0
    """Samples per pixel of colour images; 0: 4 for the studio look, 1 (with ``antialias``) for the others."""
    rig: str | None = None
    """File with the lights of the studio look; None: the built-in lights."""
    rig_sha256: str | None = None
    """Digest of that file and of the environment map that it names."""


class Dataset(msgspec.Struct, frozen=True, kw_only=True):
    """``dataset.json``."""

    format: str = FORMAT
    version: int = FORMAT_VERSION
    generator: str
    """Name and version of the program."""
    renderer: str
    """Digest of the rasterizer's sources; equal digests give bit-identical images."""
    settings: Settings
    conventions: dict[str, str]
    """Units and encodings in prose, for readers without the documentation."""


class SourceFile(msgspec.Struct, frozen=True):
    """A file that a scene was read from."""

    path: str
    """Relative to the scene's own file."""
    sha256: str


class Scene(msgspec.Struct, frozen=True, kw_only=True):
    """``scene.json``."""

    scene: str
    sha256: str
    """Digest of the names and digests of all source files."""
    sources: tuple[SourceFile, ...]
    """Files that the scene was read from; the scene's own file is the first."""
    generator: str
    """``asset.generator`` of a glTF file, else empty."""
    warnings: tuple[str, ...]
    """Warnings about content that was ignored or repaired."""
    labels: dict[str, tuple[tuple[str | int, ...], ...]]
    """Paths of the nodes with each label, by label in decimal digits."""


class CameraRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A pinhole camera; pixel (column i, row j) samples the ray ((i + 0.5 - cx) / fx, (j + 0.5 - cy) / fy, 1)."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    """Pixels from the left and the top edge."""
    near: float
    far: float | None
    """Metres along the optical axis; None: no far plane."""
    X_world_camera: tuple[tuple[float, float, float, float], ...]
    """4 x 4, row-major: pose of the optical frame (+X right, +Y down, +Z forward) in the world (Z up, metres)."""


class ImageFile(msgspec.Struct, frozen=True):
    """An image file."""

    path: str
    """Relative to the dataset."""
    sha256: str
    bytes: int


class Sample(msgspec.Struct, frozen=True, kw_only=True):
    """A line of ``manifest.jsonl``: one scene from one camera."""

    id: str
    """``scene``/``view``; unique."""
    scene: str
    view: str
    asked: str
    """Input of the view: the camera text, or a digest of the camera's parameters."""
    scene_sha256: str
    camera: CameraRecord
    images: dict[ImageType, ImageFile]


class Failure(msgspec.Struct, frozen=True):
    """A line of ``failed.jsonl``."""

    scene: str
    view: str | None
    """Name of the view; None: no view of the scene could be rendered."""
    reason: str


Record = TypeVar("Record", Dataset, Scene, Sample, Failure)
_encoder = msgspec.json.Encoder()


def encode(record: Dataset | Scene | Sample | Failure) -> bytes:
    """Return a record as one line of JSON, without the newline."""
    return _encoder.encode(record)


def encode_indented(record: Dataset | Scene) -> bytes:
    """Return a record as indented JSON."""
    return msgspec.json.format(_encoder.encode(record), indent=1) + b"\n"


def encode_labels(scene: Scene) -> bytes:
    """Return a scene's labels as indented JSON, the file beside a single label image."""
    return msgspec.json.format(msgspec.json.encode(scene.labels), indent=1) + b"\n"


def decode(data: bytes, record_type: type[Record], location: str) -> Record:
    """Return the record in a piece of JSON.

    Args:
        location: file and line, for the error message.

    Raises:
        RecordError: the JSON is not such a record.
    """
    try:
        return msgspec.json.decode(data, type=record_type)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise RecordError(f"{location}: {error}") from None


def read_file(path: Path, record_type: type[Record]) -> Record:
    """Return the record in a file.

    Raises:
        RecordError: the file is missing, not readable or not such a record.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MAX_DESCRIPTION + 1)
    except OSError as error:
        raise RecordError(f"{path}: {error.strerror or error}") from None
    if len(data) > MAX_DESCRIPTION:
        raise RecordError(f"{path}: more than {MAX_DESCRIPTION} bytes")
    return decode(data, record_type, str(path))


def read_lines(path: Path, record_type: type[Record], *, allow_partial_end: bool = False) -> Iterator[Record]:
    """Iterate over the records of a file of JSON lines.

    Args:
        allow_partial_end: skip a last line without newline, which a killed process may leave.

    Raises:
        RecordError: a line is invalid; the message names it.
    """
    try:
        with path.open("rb") as file:
            number = 0
            while line := file.readline(MAX_LINE + 1):
                number += 1
                location = f"{path}, line {number}"
                if not line.endswith(b"\n"):
                    if allow_partial_end and len(line) <= MAX_LINE:
                        break
                    raise RecordError(f"{location}: {'longer than the limit' if len(line) > MAX_LINE else 'cut off'}")
                yield decode(line, record_type, location)
    except OSError as error:
        raise RecordError(f"{path}: {error.strerror or error}") from None


def read_dataset(folder: Path) -> Dataset:
    """Return the description of the dataset in ``folder``.

    Raises:
        RecordError: there is none, or its format or version is not supported.
    """
    path = folder / DATASET
    if not path.is_file():
        raise RecordError(f"{folder} holds no dataset: there is no {DATASET}")
    dataset = read_file(path, Dataset)
    if dataset.format != FORMAT or dataset.version != FORMAT_VERSION:
        raise RecordError(f"{path}: format {dataset.format!r} version {dataset.version}, not {FORMAT} {FORMAT_VERSION}")
    return dataset
