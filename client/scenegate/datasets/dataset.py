"""Read datasets that ``scenegate render`` has written. Images need Pillow, ``scenegate-client[images]``.

for sample in Dataset("out"):
    train(sample.color, sample.depth, sample.label, sample.K, sample.X_world_camera)
"""

from __future__ import annotations

import io
import struct
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Final, TypeVar, overload

import msgspec
import numpy as np
from numpy.typing import NDArray

from scenegate.datasets import manifest
from scenegate.datasets.lines import Lines
from scenegate.datasets.manifest import ImageType, RecordError
from scenegate.pillow import pillow
from scenegate.regular_files import errors_as, read_regular

T = TypeVar("T")

NO_LABEL: Final = 0xFFFFFF
"""Label of the background and of objects without a label."""
FLOW_MAGIC: Final = 202021.25
"""First number of a flow file of the Middlebury benchmark (.flo). Width, height and float32 pairs follow."""
FLOW_HEADER_BYTES: Final = 12
PIXEL_CENTER: Final = 0.5
"""Coordinate of the centre of the top left pixel; 0 in OpenCV, BOP and COCO."""
NO_BOX: Final = (-1, -1, -1, -1)
"""Box of an object without visible pixels, in ``Sample.arrays``."""
_ZERO_POSE: Final = ((0.0, 0.0, 0.0, 0.0),) * 4
NO_OBJECT: Final = manifest.ObjectRecord(
    instance=0,
    path=(),
    model="",
    class_id=0,
    X_world_object=_ZERO_POSE,
    X_camera_object=_ZERO_POSE,
    scale=(0.0, 0.0, 0.0),
    box_3d=((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    box_visible=None,
    box_amodal=None,
    visible_pixels=0,
    amodal_pixels=0,
    visible_fraction=0.0,
    truncation=0.0,
)
"""Gives the arrays of a sample without objects their shapes and types."""
UNKNOWN_FLOW: Final = 1e9
"""Magnitude from which a flow file's numbers mean that the flow is not known."""


class Sample:
    """The images and the camera of one view of a scene. Images are read from disk on each access."""

    def __init__(self, folder: Path, record: manifest.SampleRecord) -> None:
        self.record: Final = record
        """The sample's line in the manifest."""
        self._folder = folder

    @property
    def id(self) -> str:
        """Unique name in the dataset, ``SCENE/VIEW``."""
        return self.record.id

    @property
    def K(self) -> NDArray[np.float64]:
        """Camera matrix in pixels, (3, 3). The centre of the top left pixel is at (0.5, 0.5)."""
        camera = self.record.camera
        return np.array(((camera.fx, 0.0, camera.cx), (0.0, camera.fy, camera.cy), (0.0, 0.0, 1.0)))

    @property
    def X_world_camera(self) -> NDArray[np.float64]:
        """Pose of the optical frame (+X right, +Y down, +Z forward) in the world (Z up, metres), (4, 4)."""
        return np.array(self.record.camera.X_world_camera)

    @property
    def color(self) -> NDArray[np.uint8]:
        """Colour image in RGB, (H, W, 3)."""
        return self._read_rgb("color")

    @property
    def depth(self) -> NDArray[np.float32]:
        """Depth along the optical axis in metres, (H, W). It is infinite for the background."""
        stored = self.stored("depth")
        if stored.dtype != np.uint16:
            return stored.astype(np.float32, copy=False)
        return np.where(stored == np.iinfo(np.uint16).max, np.float32(np.inf), stored / np.float32(1000.0))

    @property
    def label(self) -> NDArray[np.uint32]:
        """Labels, (H, W): ``NO_LABEL`` for the background. ``Dataset.labels`` returns the paths of each label."""
        channels = self.stored("label").astype(np.uint32)
        return np.ascontiguousarray(channels[..., 0] | channels[..., 1] << 8 | channels[..., 2] << 16)

    @property
    def objects(self) -> tuple[manifest.ObjectRecord, ...]:
        """Annotated objects, with their poses, boxes and visibility."""
        return self.record.objects

    @property
    def instance(self) -> NDArray[np.uint16]:
        """``ObjectRecord.instance`` of the object in each pixel, (H, W); 0: none."""
        return self.stored("instance").astype(np.uint16, copy=False)

    @property
    def class_ids(self) -> NDArray[np.uint16]:
        """``ObjectRecord.class_id`` of the object in each pixel, (H, W); 0: none."""
        return self.stored("class").astype(np.uint16, copy=False)

    @property
    def normal(self) -> NDArray[np.float32]:
        """Unit normals in the optical frame, facing the camera, (H, W, 3); 0 for the background.

        The file has 8 bits per coordinate: an angle is exact to 0.4 degrees.
        """
        stored = self.stored("normal")[..., :3].astype(np.float32) - np.float32(128.0)
        length = np.linalg.norm(stored, axis=-1, keepdims=True)
        return np.asarray(stored / np.maximum(length, np.float32(1.0)), np.float32)

    @property
    def albedo(self) -> NDArray[np.uint8]:
        """Base colour without light in RGB, sRGB, (H, W, 3)."""
        return self._read_rgb("albedo")

    @property
    def stereo(self) -> NDArray[np.uint8]:
        """Colour image of the right camera of a rectified pair in RGB, (H, W, 3)."""
        return self._read_rgb("stereo")

    @property
    def measured(self) -> NDArray[np.float32]:
        """Depth as the stereo camera measures it, along the optical axis in metres, (H, W). NaN: not measured."""
        stored = self.stored("measured")
        return np.where(stored == 0, np.float32(np.nan), stored / np.float32(1000.0))

    @property
    def flow(self) -> NDArray[np.float32]:
        """Optical flow to the next view in pixels, (H, W, 2): columns to the right, rows down. NaN: not known."""
        path = self.path("flow")
        flow = decode_flow(self._read_file(path), str(path))
        self._check_size(path, flow.shape[1], flow.shape[0])
        return flow

    def amodal_mask(self, instance: int) -> NDArray[np.bool_]:
        """Return the amodal mask of an object: its pixels if no other object hid it, (H, W).

        Raises:
            RecordError: the sample has no such object, or no amodal masks.
        """
        silhouettes = self.silhouettes
        if instance not in silhouettes:
            raise RecordError(f"{self.id}: there is no mask of instance {instance}")
        return silhouettes[instance].mask

    @property
    def silhouettes(self) -> dict[int, manifest.Silhouette]:
        """Amodal masks of all objects, as run lengths, by instance."""
        path = self.path("amodal")
        silhouettes = manifest.decode_silhouettes(self._read_file(path), str(path))
        for each in silhouettes.values():
            height, width = each.size
            self._check_size(path, width, height)
        return silhouettes

    @property
    def rays(self) -> NDArray[np.float64]:
        """Ray of each pixel in the optical frame, (H, W, 3), z = 1. ``rays * depth[..., None]`` is points in metres."""
        camera = self.record.camera
        x = (np.arange(camera.width) + PIXEL_CENTER - camera.cx) / camera.fx
        y = (np.arange(camera.height) + PIXEL_CENTER - camera.cy) / camera.fy
        return np.stack((*np.meshgrid(x, y), np.ones((camera.height, camera.width))), axis=-1)

    def path(self, image_type: ImageType) -> Path:
        """Return the path of an image file.

        Raises:
            RecordError: the sample has no image of this type, or it lies outside of the dataset.
        """
        image = self.record.images.get(image_type)
        if image is None:
            raise RecordError(f"{self.id} has no {image_type} image, only {', '.join(self.record.images) or 'none'}")
        try:
            return manifest.path_inside(self._folder, image.path)
        except RecordError as error:
            raise RecordError(f"{self.id}: the {image_type} image {error}") from None

    def file_bytes(self, image_type: ImageType) -> bytes:
        """Return the encoded bytes of an image file.

        Raises:
            RecordError: as ``path``, or the file has no image of the camera's size.
        """
        if image_type in ("amodal", "flow"):
            return self._read_file(self.path(image_type))
        return self._open_image(image_type)[0]

    def image(self, image_type: ImageType) -> NDArray[Any]:
        """Return an image as the property of its type does. For ``amodal``: all silhouettes by object, (N, H, W)."""
        if image_type == "amodal":
            masks = [self.amodal_mask(record.instance) for record in self.objects]
            return np.array(masks, np.bool_).reshape(-1, self.record.camera.height, self.record.camera.width)
        pixels: NDArray[Any] = getattr(self, "class_ids" if image_type == "class" else image_type)
        return pixels

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return all images by their type, ``K``, ``X_world_camera``, and each field of the objects' records.

        Arrays of objects are ``objects/FIELD``, (N, ...), also if N is 0; a box that is None is (-1, -1, -1, -1).
        Samples without annotations have none.
        """
        arrays = {str(image_type): self.image(image_type) for image_type in self.record.images}
        arrays |= {"K": self.K, "X_world_camera": self.X_world_camera}
        is_annotated = any(image_type in self.record.images for image_type in manifest.ANNOTATED_TYPES)
        for field in manifest.ObjectRecord.__struct_fields__ if is_annotated else ():
            values = [getattr(record, field) for record in (*self.objects, NO_OBJECT)]
            if field == "path":
                values = [msgspec.json.encode(value).decode() for value in values]
            arrays[f"objects/{field}"] = np.array([NO_BOX if value is None else value for value in values])[:-1]
        return arrays

    def stored(self, image_type: ImageType) -> NDArray[Any]:
        """Return the pixels of an image as its file has them: 8-bit RGB, 16-bit numbers, or depth in float32.

        Raises:
            RecordError: as ``file_bytes``.
        """
        _, image = self._open_image(image_type)
        try:
            return np.array(image)  # writable, as tensors have to be
        except (OSError, SyntaxError, ValueError) as error:
            raise RecordError(f"{self.path(image_type)}: not an image that can be read: {error}") from None

    def _open_image(self, image_type: ImageType) -> tuple[bytes, Any]:
        """Return the encoded bytes of an image file, and its image, which Pillow has not decoded yet."""
        path = self.path(image_type)
        encoded = self._read_file(path)
        Image = pillow()
        try:
            image = Image.open(io.BytesIO(encoded))
        except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
            raise RecordError(f"{path}: not an image that can be read: {error}") from None
        self._check_size(path, *image.size)
        return encoded, image

    def _read_rgb(self, image_type: ImageType) -> NDArray[np.uint8]:
        """Return an image without its alpha."""
        return np.ascontiguousarray(self.stored(image_type)[..., :3], np.uint8)

    def _check_size(self, path: Path, width: int, height: int) -> None:
        camera = self.record.camera
        if (width, height) != (camera.width, camera.height):
            raise RecordError(f"{path}: {width}x{height} pixels, the camera has {camera.width}x{camera.height}")
        if width * height > manifest.MAX_IMAGE_PIXELS:
            raise RecordError(f"{path}: {width}x{height} pixels, the limit is {manifest.MAX_IMAGE_PIXELS} in all")

    def _read_file(self, path: Path) -> bytes:
        """Return the content of an image file."""
        with errors_as(RecordError, path):
            return read_regular(path)


def decode_flow(data: bytes, location: str) -> NDArray[np.float32]:
    """Return the flow in the content of a file, (H, W, 2); NaN: not known.

    Raises RecordError, which begins with ``location``, if the data is not a flow file.
    """
    magic, width, height = struct.unpack_from("<fii", data) if len(data) >= FLOW_HEADER_BYTES else (0.0, 0, 0)
    if magic != FLOW_MAGIC or min(width, height) < 1 or len(data) != FLOW_HEADER_BYTES + 8 * width * height:
        raise RecordError(f"{location}: not a flow file (.flo) that can be read")
    flow = np.frombuffer(data, "<f4", offset=FLOW_HEADER_BYTES).reshape(height, width, 2).astype(np.float32)
    flow[np.abs(flow) >= UNKNOWN_FLOW] = np.nan
    return flow


class LazySequence(Sequence[T]):
    """Sequence that makes an item on each access and keeps none."""

    @abstractmethod
    def _make(self, index: int) -> T:
        """Return the item at an index; raises IndexError."""

    @overload
    def __getitem__(self, index: int) -> T: ...
    @overload
    def __getitem__(self, index: slice) -> list[T]: ...
    def __getitem__(self, index: int | slice) -> T | list[T]:
        if isinstance(index, slice):
            return [self._make(k) for k in range(*index.indices(len(self)))]
        return self._make(index)


class Dataset(LazySequence[Sample]):
    """The samples of a dataset, in the order of its manifest. It can be pickled, as data loaders require.

    It takes 8 bytes of memory per sample. Lines of the manifest are read on access; an invalid line raises RecordError.
    """

    def __init__(self, folder: str | Path) -> None:
        """Open the dataset in a folder.

        Raises:
            RecordError: there is no dataset, or it is not finished.
        """
        self.folder: Final = Path(folder)
        self.description: Final = manifest.read_dataset(self.folder)
        """Content of ``dataset.json``, with the settings of the images."""
        path = self.folder / manifest.MANIFEST_FILE
        if not path.is_file():
            raise RecordError(f"{folder}: the dataset is not finished; run the command that makes it again")
        self._lines = Lines(path)

    @cached_property
    def scenes(self) -> tuple[str, ...]:
        """Names of all scenes. The first access reads the whole manifest."""
        return tuple(dict.fromkeys(self._record(index).scene for index in range(len(self))))

    @property
    def classes(self) -> Mapping[int, str]:
        """Names of the classes by ``ObjectRecord.class_id``."""
        return {int(class_id): name for class_id, name in self.description.classes.items()}

    def scene(self, name: str) -> manifest.SceneRecord:
        """Return the description of a scene: its files, labels, lights and models."""
        return manifest.read_scene(self.folder, name)

    def labels(self, scene: str) -> Mapping[int, tuple[tuple[str | int, ...], ...]]:
        """Return the paths of a scene's nodes by their label."""
        return {int(label): paths for label, paths in self.scene(scene).labels.items()}

    def map(self, transform: Callable[[Sample], T]) -> Transformed[T]:
        """Return the sequence of ``transform(sample)``, for data loaders whose batches consist of arrays or tensors.

        ``transform`` is called on each access. To be pickled, it has to be a function of a module.
        """
        return Transformed(self, transform)

    def __len__(self) -> int:
        return len(self._lines)

    def _make(self, index: int) -> Sample:
        return Sample(self.folder, self._record(index))

    def _record(self, index: int) -> manifest.SampleRecord:
        return manifest.decode(self._lines[index], manifest.SampleRecord, self._lines.location(index))


class Transformed(LazySequence[T]):
    """The results of a function for each sample of a dataset, computed on each access; made by ``Dataset.map``."""

    def __init__(self, dataset: Dataset, transform: Callable[[Sample], T]) -> None:
        self.dataset: Final = dataset
        self._transform = transform

    def __len__(self) -> int:
        return len(self.dataset)

    def _make(self, index: int) -> T:
        return self._transform(self.dataset[index])
