"""Read and write the JSON files of a dataset. ``dataset`` reads them, ``gateway.datasets`` writes and checks them.

``dataset.json`` has the settings of all images. Each line of ``manifest.jsonl`` describes one sample: the images of a
scene from one camera. The folder of each scene has a ``scene.json``. No record has times or names of machines, so the
same input gives the same bytes. See ``docs/datasets.md``.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final, Literal, TypeVar

import msgspec

from scenegate.regular_files import open_regular, read_regular

DATASET_FILE: Final = "dataset.json"
"""A ``DatasetRecord``."""
MANIFEST_FILE: Final = "manifest.jsonl"
"""A ``SampleRecord`` per line. Written at the end of a run."""
JOURNAL_FILE: Final = "journal.jsonl"
"""A ``SampleRecord`` per line, in the order in which a run finished them. Removed at the end of the run."""
FAILURES_FILE: Final = "failed.jsonl"
"""A ``FailureRecord`` per line."""
SCENES_FOLDER: Final = "scenes"
"""Folder with a folder for each scene, which has its ``SCENE_FILE`` and its images."""
SCENE_FILE: Final = "scene.json"
"""A ``SceneRecord``."""
FORMAT: Final = "scenegate-dataset"
"""Value of ``DatasetRecord.format``."""
FORMAT_VERSION: Final = 1
"""Value of ``DatasetRecord.version``."""
MAX_LINE_BYTES: Final = 1 << 20
"""Maximum size of a line. A sample's line has about 700 bytes."""
MAX_DESCRIPTION_BYTES: Final = 256 << 20
"""Maximum size of a dataset.json or scene.json. A scene.json with a million labelled paths has 60 MB."""

ImageType = Literal["color", "depth", "label"]
IMAGE_TYPES: Final[tuple[ImageType, ...]] = ("color", "depth", "label")


class RecordError(ValueError):
    """A record cannot be read; the message names the file, the line if there is one, and the reason."""


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings of all images of a dataset. Recorded render requests contain their own size and camera."""

    types: tuple[ImageType, ...]
    """Types of the images of each sample."""
    width: int
    """Default width of images in pixels."""
    height: int
    """Default height of images in pixels."""
    fovy: float
    """Default vertical field of view in degrees."""
    look: str
    """Shading of colour images: a ``renderers.interface.LookName``, or ``auto`` for a choice by the scene."""
    up: str
    """Up axis of glTF files: ``y``, ``z`` or ``auto``."""
    antialias: str
    """Smoothing of colour images with one sample per pixel: ``fxaa`` or ``none``."""
    depth_format: str
    """``tiff``: metres as float32; ``png``: millimetres as uint16, 65535: too far, or background."""
    background: tuple[int, int, int]
    """RGB background of colour images."""
    samples: int = 0
    """Samples per pixel of colour images; 0: 4 for the look ``studio``, 1 for the others."""
    alpha_threshold: float = 0.0
    """Alpha below which blended surfaces are left out of depth and label images."""
    rig: str | None = None
    """Path of the rig file, which has the lights of the look ``studio``; None: the built-in lights."""
    rig_sha256: str | None = None
    """SHA-256 of the rig file and of the environment map that it names; None: no rig file."""
    joints: tuple[str, ...] = ()
    """Joint values of robot files, as ``name=value``."""
    roots: tuple[str, ...] = ()
    """Folders with the packages that robot files name."""
    variant: str = ""
    """Variant of the materials of glTF files (KHR_materials_variants); empty: the default materials."""
    keyframe: str = ""
    """Keyframe of MJCF files; empty: the joints have the values of the model."""
    robot_gltf_up: str = "y"
    """Up axis of the glTF meshes of robot files: ``y``, ``z`` or ``auto``."""
    strict: bool = False
    """True: a scene with a warning is not rendered."""


class DatasetRecord(msgspec.Struct, frozen=True, kw_only=True):
    """Content of ``dataset.json``."""

    format: str = FORMAT
    version: int = FORMAT_VERSION
    generator: str
    """Name and version of the program that rendered the dataset."""
    renderer: str
    """Digest of the rasterizer's source code. Equal digests give bit-identical images."""
    settings: Settings
    conventions: dict[str, str]
    """Units and encodings by topic, as texts for people who do not have the documentation."""


class SourceFile(msgspec.Struct, frozen=True):
    """A file that a scene was read from."""

    path: str
    """Path relative to the folder of the scene file."""
    sha256: str


class SceneRecord(msgspec.Struct, frozen=True, kw_only=True):
    """Content of ``scene.json``."""

    scene: str
    """Name of the scene."""
    sha256: str
    """Digest of the names and digests of all source files."""
    sources: tuple[SourceFile, ...]
    """Files that the scene was read from. The first is the scene file."""
    generator: str
    """``asset.generator`` of a glTF file; empty for other files."""
    warnings: tuple[str, ...]
    """Warnings about content of the scene that was ignored or repaired."""
    labels: dict[str, tuple[tuple[str | int, ...], ...]]
    """Paths of nodes by their label, which is written in decimal digits."""


class CameraRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A pinhole camera. The ray of pixel (column i, row j) is ((i + 0.5 - cx) / fx, (j + 0.5 - cy) / fy, 1)."""

    width: int
    """Width of the image in pixels."""
    height: int
    """Height of the image in pixels."""
    fx: float
    """Horizontal focal length in pixels."""
    fy: float
    """Vertical focal length in pixels."""
    cx: float
    """Principal point in pixels from the left edge."""
    cy: float
    """Principal point in pixels from the top edge."""
    near: float
    """Distance of the near plane along the optical axis in metres."""
    far: float | None
    """Distance of the far plane along the optical axis in metres; None: no far plane."""
    X_world_camera: tuple[tuple[float, float, float, float], ...]
    """Pose of the optical frame (+X right, +Y down, +Z forward) in the world (Z up, metres): 4 x 4, row-major."""
    depth_origin: float = 0.0
    """Metres along the optical axis from which depth images count. Not 0 for an orthographic camera, which is
    written as a pinhole far behind it."""


class ImageFile(msgspec.Struct, frozen=True):
    """An image file."""

    path: str
    """Path relative to the folder of the dataset."""
    sha256: str
    bytes: int
    """Size of the file in bytes."""


class SampleRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A line of ``manifest.jsonl`` or ``journal.jsonl``: the images of one scene from one camera."""

    id: str
    """Unique name: ``scene/view``."""
    scene: str
    """Name of the scene."""
    view: str
    """Name of the view."""
    view_description: str = msgspec.field(name="asked")
    """Input from which the camera was computed: the camera text, or a digest of the camera's parameters."""
    scene_sha256: str
    """``SceneRecord.sha256`` when the sample was rendered."""
    camera: CameraRecord
    images: dict[ImageType, ImageFile]
    """Image files by type."""


class FailureRecord(msgspec.Struct, frozen=True):
    """A line of ``failed.jsonl``: a view or a scene that could not be rendered."""

    scene: str
    """Name of the scene."""
    view: str | None
    """Name of the view; None: no view of the scene could be rendered."""
    reason: str


Record = TypeVar("Record", DatasetRecord, SceneRecord, SampleRecord, FailureRecord)
_encoder = msgspec.json.Encoder()


def encode(record: DatasetRecord | SceneRecord | SampleRecord | FailureRecord) -> bytes:
    """Return a record as one line of JSON, without the newline."""
    return _encoder.encode(record)


def encode_indented(record: DatasetRecord | SceneRecord) -> bytes:
    """Return a record as indented JSON."""
    return msgspec.json.format(_encoder.encode(record), indent=1) + b"\n"


def encode_labels(scene: SceneRecord) -> bytes:
    """Return a scene's labels as indented JSON. ``scenegate render`` writes them beside a single label image."""
    return msgspec.json.format(msgspec.json.encode(scene.labels), indent=1) + b"\n"


def decode(data: bytes, record_type: type[Record], location: str) -> Record:
    """Decode a record.

    Args:
        data: the record as JSON.
        record_type: type of the record.
        location: file and line, for the error message.

    Raises:
        RecordError: the data is not a record of this type.
    """
    try:
        return msgspec.json.decode(data, type=record_type)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise RecordError(f"{location}: {error}") from None


def read_file(path: Path, record_type: type[Record]) -> Record:
    """Read a file that consists of one record.

    Raises:
        RecordError: the file cannot be read, is too large, or is not a record of this type.
    """
    try:
        data = read_regular(path, MAX_DESCRIPTION_BYTES)
    except OSError as error:
        raise RecordError(f"{path}: {error.strerror or error}") from None
    return decode(data, record_type, str(path))


def read_lines(path: Path, record_type: type[Record], *, allow_partial_end: bool = False) -> Iterator[Record]:
    """Yield the records of a file that has one record per line.

    Args:
        path: the file.
        record_type: type of the records.
        allow_partial_end: ignore a last line without newline, which a killed process may have written.

    Raises:
        RecordError: the file cannot be read, or a line is invalid.
    """
    try:
        with open_regular(path) as file:
            line_number = 0
            while line := file.readline(MAX_LINE_BYTES + 1):
                line_number += 1
                location = f"{path}, line {line_number}"
                if not line.endswith(b"\n"):
                    if allow_partial_end and len(line) <= MAX_LINE_BYTES:
                        break
                    problem = "longer than the limit" if len(line) > MAX_LINE_BYTES else "cut off"
                    raise RecordError(f"{location}: {problem}")
                yield decode(line, record_type, location)
    except OSError as error:
        raise RecordError(f"{path}: {error.strerror or error}") from None


def read_dataset(folder: Path) -> DatasetRecord:
    """Read the ``dataset.json`` in a folder.

    Raises:
        RecordError: there is no dataset, or its format or version is not supported.
    """
    path = folder / DATASET_FILE
    if not path.is_file():
        raise RecordError(f"{folder} holds no dataset: there is no {DATASET_FILE}")
    dataset = read_file(path, DatasetRecord)
    if dataset.format != FORMAT or dataset.version != FORMAT_VERSION:
        raise RecordError(f"{path}: format {dataset.format!r} version {dataset.version}, not {FORMAT} {FORMAT_VERSION}")
    return dataset
