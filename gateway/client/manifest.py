"""The files that describe a dataset: their names, and their content as values. See ``docs/datasets.md``.

``dataset.json`` says how all pictures were made, each line of ``manifest.jsonl`` is a ``Sample``, and every scene has a
folder with a ``scene.json``. No times, no machine names: the same input gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final, Literal, TypeVar

import msgspec

DATASET: Final = "dataset.json"
MANIFEST: Final = "manifest.jsonl"
JOURNAL: Final = "journal.jsonl"
"""What a run that has not ended has made so far, in the order in which it was made."""
FAILED: Final = "failed.jsonl"
SCENES: Final = "scenes"
SCENE: Final = "scene.json"
FORMAT: Final = "scenegate-dataset"
FORMAT_VERSION: Final = 1
MAX_LINE: Final = 1 << 20
"""Bytes of a line; a sample has about 700."""
MAX_DESCRIPTION: Final = 256 << 20
"""Bytes of a dataset.json or scene.json; a scene of a million labelled paths has 60 MB."""

ImageType = Literal["color", "depth", "label"]
IMAGE_TYPES: Final[tuple[ImageType, ...]] = ("color", "depth", "label")


class RecordError(ValueError):
    """A description cannot be read; the message names the file (and line) and the reason."""


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What holds for all pictures of a dataset, except those of recorded requests, which say all themselves."""

    types: tuple[ImageType, ...]
    width: int
    height: int
    """Pixels, where the camera does not say itself."""
    fovy: float
    """Degrees, likewise."""
    look: str
    up: str
    antialias: str
    depth_format: str
    """``tiff``: 32-bit float, metres; ``png``: 16 bit, millimetres, 65535 is too far or nothing."""
    background: tuple[int, int, int]
    samples: int = 0
    """A pixel of colour; 0: 4 of the studio look, 1 (and ``antialias``) of the others."""
    rig: str | None = None
    """File with the lights of the studio look; None: the built-in ones."""
    rig_sha256: str | None = None
    """Of that file, and of the picture of the surroundings that it names."""


class Dataset(msgspec.Struct, frozen=True, kw_only=True):
    """``dataset.json``."""

    format: str = FORMAT
    version: int = FORMAT_VERSION
    generator: str
    """Name and version of the program."""
    renderer: str
    """Digest of the rasterizer's sources: pictures of equal digests are equal to the last bit."""
    settings: Settings
    conventions: dict[str, str]
    """For people who find the folder without its documentation."""


class SourceFile(msgspec.Struct, frozen=True):
    """A file that a scene was read from."""

    path: str
    """Relative to the scene's own file."""
    sha256: str


class Scene(msgspec.Struct, frozen=True, kw_only=True):
    """``scene.json``."""

    scene: str
    sha256: str
    """Of the names and hashes of all source files."""
    sources: tuple[SourceFile, ...]
    """The scene's own file first."""
    generator: str
    """``asset.generator`` of a glTF file, else empty."""
    warnings: tuple[str, ...]
    """What was ignored or repaired when it was read."""
    labels: dict[str, tuple[tuple[str | int, ...], ...]]
    """Label in decimal digits -> the paths of the nodes that carry it."""


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
    """A picture."""

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
    """What the view was made of: the camera's text, or a digest of its parameters."""
    scene_sha256: str
    camera: CameraRecord
    images: dict[ImageType, ImageFile]


class Failure(msgspec.Struct, frozen=True):
    """A line of ``failed.jsonl``."""

    scene: str
    view: str | None
    """None: no view of the scene can be drawn."""
    reason: str


Record = TypeVar("Record", Dataset, Scene, Sample, Failure)
_encoder = msgspec.json.Encoder()


def encode(record: Dataset | Scene | Sample | Failure) -> bytes:
    """JSON in one line, without its end."""
    return _encoder.encode(record)


def encode_for_people(record: Dataset | Scene) -> bytes:
    """JSON with line breaks."""
    return msgspec.json.format(_encoder.encode(record), indent=1) + b"\n"


def encode_labels(scene: Scene) -> bytes:
    """What the labels of a scene mean, as JSON with line breaks: what lies beside a single label picture."""
    return msgspec.json.format(msgspec.json.encode(scene.labels), indent=1) + b"\n"


def decode(data: bytes, kind: type[Record], where: str) -> Record:
    """
    Raises:
        RecordError: it is no such record; names ``where``.
    """
    try:
        return msgspec.json.decode(data, type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise RecordError(f"{where}: {error}") from None


def read_file(path: Path, kind: type[Record]) -> Record:
    """A record that is a file of its own.

    Raises:
        RecordError: it is missing, not readable or no such record.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MAX_DESCRIPTION + 1)
    except OSError as error:
        raise RecordError(f"{path}: {error.strerror or error}") from None
    if len(data) > MAX_DESCRIPTION:
        raise RecordError(f"{path}: more than {MAX_DESCRIPTION} bytes")
    return decode(data, kind, str(path))


def read_lines(path: Path, kind: type[Record], *, torn_end: bool = False) -> Iterator[Record]:
    """The records of a file of JSON lines, one after the other.

    Args:
        torn_end: whether the last line may be cut off, as a process leaves it that was killed; it is left out then.

    Raises:
        RecordError: names the line.
    """
    try:
        with path.open("rb") as file:
            number = 0
            while line := file.readline(MAX_LINE + 1):
                number += 1
                where = f"{path}, line {number}"
                if not line.endswith(b"\n"):
                    if torn_end and len(line) <= MAX_LINE:
                        break
                    raise RecordError(f"{where}: {'longer than the limit' if len(line) > MAX_LINE else 'cut off'}")
                yield decode(line, kind, where)
    except OSError as error:
        raise RecordError(f"{path}: {error.strerror or error}") from None


def read_dataset(folder: Path) -> Dataset:
    """The description of the dataset in ``folder``.

    Raises:
        RecordError: there is none, or it is of a format or version that is not understood.
    """
    path = folder / DATASET
    if not path.is_file():
        raise RecordError(f"{folder} holds no dataset: there is no {DATASET}")
    found = read_file(path, Dataset)
    if found.format != FORMAT or found.version != FORMAT_VERSION:
        raise RecordError(f"{path}: format {found.format!r} version {found.version}, not {FORMAT} {FORMAT_VERSION}")
    return found
