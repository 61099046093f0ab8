"""Read and write the JSON files of a dataset. ``dataset`` reads them, ``gateway.datasets`` writes and checks them.

``dataset.json`` has the settings of all images. Each line of ``manifest.jsonl`` describes one sample: the images of a
scene from one camera. The folder of each scene has a ``scene.json``. No record has times or names of machines, so the
same input gives the same bytes. See ``docs/datasets.md``.
"""

import os
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Final, Literal, TypeVar, get_args

import msgspec
import numpy as np
from numpy.typing import NDArray

from scenegate.regular_files import errors_as, open_regular, read_regular

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
MODELS_FOLDER: Final = "models"
"""Folder with the meshes of the models, ``ModelRecord.path``."""
MAX_IMAGE_PIXELS: Final = 4096 * 4096
"""Maximum number of pixels of an image, as the server's ``--max-pixels``: its arrays take 200 MB at most."""
MAX_LINE_BYTES: Final = 16 << 20
"""Maximum size of a line. A sample's line has about 700 bytes, and 900 for each object in its image."""
MAX_DESCRIPTION_BYTES: Final = 256 << 20
"""Maximum size of a dataset.json or scene.json. A scene.json with a million labelled paths has 60 MB."""

ImageType = Literal[
    "color", "depth", "label", "instance", "class", "normal", "albedo", "amodal", "flow", "stereo", "measured"
]
IMAGE_TYPES: Final[tuple[ImageType, ...]] = get_args(ImageType)
ANNOTATED_TYPES: Final[tuple[ImageType, ...]] = ("instance", "class", "amodal")
"""Types of images for which samples have ``SampleRecord.objects``."""
Vector3 = tuple[float, float, float]
Row = tuple[float, float, float, float]
Pose = tuple[Row, Row, Row, Row]
"""A rotation and a translation: 4 x 4, row-major."""


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
    """Up axis of glTF and mesh files: ``y``, ``z`` or ``auto``."""
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
    scale: float = 1.0
    """Factor of all lengths in glTF, mesh and robot files."""
    joints: tuple[str, ...] = ()
    """Joint values of robot files, as ``name=value``."""
    roots: tuple[str, ...] = ()
    """Folders with the packages that robot files name."""
    xacro_args: tuple[str, ...] = ()
    """Arguments of xacro files, as ``name:=value``."""
    variant: str = ""
    """Variant of the materials of glTF files (KHR_materials_variants); empty: the default materials."""
    keyframe: str = ""
    """Keyframe of MJCF files; empty: the joints have the values of the model."""
    robot_gltf_up: str = "y"
    """Up axis of the glTF meshes of robot files: ``y``, ``z`` or ``auto``."""
    classes_sha256: str | None = None
    """SHA-256 of the file with the classes; None: a class for each model."""
    scenario_sha256: str | None = None
    """Digest of the scenarios without their numbers of scenes, and of the names of their files; None: no scenario."""
    baseline: float = 0.0
    """Distance of the right camera of ``stereo`` images in metres."""
    stereo_profile: str = ""
    """Name or path of the camera profile of ``measured`` images; empty: there are none."""
    stereo_profile_sha256: str | None = None
    """SHA-256 of the content of the profile; None: no profile."""
    depth_mode: Literal["matched", "ground_truth"] | None = None
    """Source of the depth of ``measured`` images: a matcher, or exact depth; None: the profile's."""
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
    classes: dict[str, str] = {}
    """Names of the classes by their number, which is written in decimal digits, from 1. Empty without annotations."""


class SourceFile(msgspec.Struct, frozen=True):
    """A file that a scene was read from."""

    path: str
    """Path relative to the folder of the scene file."""
    sha256: str


class ModelRecord(msgspec.Struct, frozen=True, kw_only=True):
    """Geometry of a model. Models of the same path in several scenes are equal."""

    path: str
    """Binary PLY file of triangles, relative to the folder of the dataset. Metres, in the frame of the model: that of
    its objects without ``ObjectRecord.scale``."""
    sha256: str
    """SHA-256 of the file."""
    box: tuple[Vector3, Vector3]
    """Smallest and largest coordinates in metres, in the frame of the model."""


class LightRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A light of a scene, as in KHR_lights_punctual."""

    kind: str
    """``directional``, ``point`` or ``spot``."""
    color: Vector3
    """Linear RGB."""
    intensity: float
    """Lux for directional lights, candela for the others."""
    position: Vector3
    """Position in the world in metres; unused for a directional light."""
    direction: Vector3
    """Unit vector in the world in which the light shines; unused for a point light."""


class SceneRecord(msgspec.Struct, frozen=True, kw_only=True):
    """Content of ``scene.json``."""

    scene: str
    """Name of the scene."""
    sha256: str
    """Digest of the names and digests of all source files."""
    sources: tuple[SourceFile, ...]
    """Files that the scene was read from. The first is the scene file. Of a scenario's scene: the files in use, without
    the scenario, whose digest is ``Settings.scenario_sha256``."""
    generator: str
    """``asset.generator`` of a glTF file; empty for other files."""
    warnings: tuple[str, ...]
    """Warnings about content of the scene that was ignored or repaired."""
    labels: dict[str, tuple[tuple[str | int, ...], ...]]
    """Paths of nodes by their label, which is written in decimal digits."""
    scenario: dict[str, Any] | None = None
    """Choices from which a scenario's scene can be made again, as ``docs/scenarios.md`` lists them; None: the scene is
    not of a scenario."""
    lights: tuple[LightRecord, ...] = ()
    """Lights of the scene. The dataset's settings name the rig, whose lights the scene has in addition or instead."""
    models: dict[str, ModelRecord] = {}
    """Models of the objects by ``ObjectRecord.model``. Empty without annotations."""


_Side = Annotated[int, msgspec.Meta(ge=1, le=1 << 16)]


class CameraRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A pinhole camera. The ray of pixel (column i, row j) is ((i + 0.5 - cx) / fx, (j + 0.5 - cy) / fy, 1)."""

    width: _Side
    """Width of the image in pixels."""
    height: _Side
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
    X_world_camera: Pose
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


class ObjectRecord(msgspec.Struct, frozen=True, kw_only=True):
    """An object of which something is in the image, or would be without the objects before it.

    Its frame is that of its node. Boxes of pixels are (x, y, width, height): column and row of the top left pixel.
    """

    instance: int
    """Value in ``instance`` images, from 1: number of the object in its scene."""
    path: tuple[str | int, ...]
    """Path of the node in the scene."""
    model: str
    """Name of the model, a key of ``SceneRecord.models``: the name of the mesh, of the file or of the robot's link."""
    class_id: int
    """Value in ``class`` images, a key of ``DatasetRecord.classes``."""
    X_world_object: Pose
    """Pose of the object in the world (Z up, metres)."""
    X_camera_object: Pose
    """Pose of the object in the optical frame of the camera (+X right, +Y down, +Z forward)."""
    scale: Vector3
    """Scale of the model along the axes of the object, negative if mirrored: a point p of the model is at scale * p in
    the frame of the object."""
    box_3d: tuple[Vector3, Vector3]
    """Smallest and largest coordinates in the frame of the object, in metres."""
    box_visible: tuple[int, int, int, int] | None
    """Box of the visible pixels; None if there are none."""
    box_amodal: tuple[int, int, int, int] | None
    """Box of the silhouette: of all pixels that the object would have without the others, those outside of the image
    included."""
    visible_pixels: int
    """Number of visible pixels."""
    amodal_pixels: int
    """Number of pixels of the silhouette, those outside of the image included."""
    visible_fraction: float
    """Share of the silhouette that is visible; the rest is hidden by other objects, or outside of the image."""
    truncation: float
    """Share of the silhouette that is outside of the image."""


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
    objects: tuple[ObjectRecord, ...] = ()
    """Annotated objects, by ``instance``. Empty without one of ``ANNOTATED_TYPES``."""


class Silhouette(msgspec.Struct, frozen=True, kw_only=True):
    """An element of an ``amodal`` file: the silhouette of an object in an image, as COCO's uncompressed RLE."""

    instance: int
    """``ObjectRecord.instance``."""
    size: tuple[int, int]
    """Height and width of the image in pixels."""
    counts: tuple[int, ...]
    """Lengths of the runs of pixels outside and inside, alternately, down the columns from left to right."""

    @property
    def mask(self) -> NDArray[np.bool_]:
        """The silhouette, (H, W)."""
        height, width = self.size
        runs = np.array(self.counts, np.int64)
        inside = np.repeat(np.arange(len(runs)) % 2 == 1, runs)
        return np.ascontiguousarray(inside.reshape(width, height).T)


class FailureRecord(msgspec.Struct, frozen=True):
    """A line of ``failed.jsonl``: a view or a scene that could not be rendered."""

    scene: str
    """Name of the scene."""
    view: str | None
    """Name of the view; None: no view of the scene could be rendered."""
    reason: str


Record = TypeVar("Record")
_encoder = msgspec.json.Encoder()


def encode(record: DatasetRecord | SceneRecord | SampleRecord | FailureRecord) -> bytes:
    """Return a record as one line of JSON, without the newline."""
    return _encoder.encode(record)


def encode_indented(record: DatasetRecord | SceneRecord | dict[str, Any]) -> bytes:
    """Return a record, or a value of one, as indented JSON."""
    return msgspec.json.format(_encoder.encode(record), indent=1) + b"\n"


def decode(data: bytes, record_type: type[Record], location: str) -> Record:
    """Decode a record.

    Args:
        location: file and line, for the error message.

    Raises:
        RecordError: the data is not a record of this type.
    """
    try:
        return msgspec.json.decode(data, type=record_type)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise RecordError(f"{location}: {error}") from None


def path_inside(folder: Path, path: str) -> Path:
    """Return the path of a file that a record names relative to the dataset's folder.

    Raises:
        RecordError: it leads out of the folder, be it by symbolic links.
    """
    pure = PurePosixPath(path)
    if pure.is_absolute() or ".." in pure.parts or "\0" in path:
        raise RecordError(f"{path!r} lies outside of the dataset")
    if not Path(os.path.realpath(folder / path)).is_relative_to(os.path.realpath(folder)):
        raise RecordError(f"{path!r} lies outside of the dataset, by a symbolic link")
    return folder / path


def pose_rows(X: NDArray[np.float64]) -> Pose:
    """Return a (4, 4) matrix as rows."""
    first, second, third, fourth = map(tuple, X.tolist())
    return first, second, third, fourth


def decode_silhouettes(data: bytes, location: str) -> dict[int, Silhouette]:
    """Decode an ``amodal`` file: silhouettes by instance.

    Raises:
        RecordError: the data is not such a file, or its runs do not fill the image.
    """
    silhouettes: tuple[Silhouette, ...] = decode(data, tuple[Silhouette, ...], location)
    for each in silhouettes:
        height, width = each.size
        if sum(each.counts) != height * width or min(each.counts, default=0) < 0 or min(each.size) < 1:
            raise RecordError(f"{location}: the runs of instance {each.instance} do not fill the image")
    return {each.instance: each for each in silhouettes}


def read_file(path: Path, record_type: type[Record]) -> Record:
    """Read a file that consists of one record.

    Raises:
        RecordError: the file cannot be read, is too large, or is not a record of this type.
    """
    with errors_as(RecordError, path):
        data = read_regular(path, MAX_DESCRIPTION_BYTES)
    return decode(data, record_type, str(path))


def read_lines(path: Path, record_type: type[Record], *, allow_partial_end: bool = False) -> Iterator[Record]:
    """Yield the records of a file that has one record per line.

    Args:
        allow_partial_end: ignore a last line without newline, which a killed process may have written.

    Raises:
        RecordError: the file cannot be read, or a line is invalid.
    """
    with errors_as(RecordError, path), open_regular(path) as file:
        for line_number, line in enumerate(iter(lambda: file.readline(MAX_LINE_BYTES + 1), b""), 1):
            location = f"{path}, line {line_number}"
            if not line.endswith(b"\n"):
                if allow_partial_end and len(line) <= MAX_LINE_BYTES:
                    break
                problem = "longer than the limit" if len(line) > MAX_LINE_BYTES else "cut off"
                raise RecordError(f"{location}: {problem}")
            yield decode(line, record_type, location)


def read_scene(folder: Path, name: str) -> SceneRecord:
    """Read the description of a scene of the dataset in a folder; raises as ``path_inside`` and ``read_file``."""
    return read_file(path_inside(folder, f"{SCENES_FOLDER}/{name}/{SCENE_FILE}"), SceneRecord)


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
