"""Reads datasets that ``scenegate render`` wrote, for training jobs: numpy and OpenCV, nothing of the server.

for sample in Dataset("out"):
    train(sample.color, sample.depth, sample.label, sample.K, sample.X_world_camera)
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Final, overload

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.client import manifest
from gateway.client.lines import Lines
from gateway.client.manifest import ImageType, RecordError

NO_LABEL: Final = 0xFFFFFF
"""In label pictures: the background, and what has no label."""


class Sample:
    """One scene from one camera. Pictures are read when they are asked for, and not kept."""

    def __init__(self, folder: Path, record: manifest.Sample, depth_format: str) -> None:
        self.record: Final = record
        """The manifest's line."""
        self._folder = folder
        self._depth_format = depth_format

    @property
    def id(self) -> str:
        return self.record.id

    @property
    def K(self) -> NDArray[np.float64]:
        """(3, 3) float64: intrinsics in pixels; the centre of the top left pixel is at (0.5, 0.5)."""
        c = self.record.camera
        return np.array(((c.fx, 0.0, c.cx), (0.0, c.fy, c.cy), (0.0, 0.0, 1.0)))

    @property
    def X_world_camera(self) -> NDArray[np.float64]:
        """(4, 4) float64: pose of the optical frame (+X right, +Y down, +Z forward) in the world, metres, Z up."""
        return np.array(self.record.camera.X_world_camera)

    @property
    def color(self) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 RGB."""
        bgr = self._read("color")
        return np.ascontiguousarray(bgr[..., ::-1], np.uint8)

    @property
    def depth(self) -> NDArray[np.float32]:
        """(H, W) float32: metres along the optical axis, inf where nothing is."""
        stored = self._read("depth")
        if stored.dtype != np.uint16:
            return stored.astype(np.float32, copy=False)
        metres = stored.astype(np.float32) / np.float32(1000.0)
        metres[stored == np.iinfo(np.uint16).max] = np.inf
        return metres

    @property
    def label(self) -> NDArray[np.uint32]:
        """(H, W) uint32: label, ``NO_LABEL`` where nothing is. ``Dataset.labels`` says what they mean."""
        bgr = self._read("label").astype(np.uint32)
        return np.ascontiguousarray(bgr[..., 2] | bgr[..., 1] << 8 | bgr[..., 0] << 16)

    @property
    def rays(self) -> NDArray[np.float64]:
        """(H, W, 3) float64: the ray of every pixel in the optical frame, z = 1; times ``depth``: points in metres."""
        c = self.record.camera
        x = (np.arange(c.width) + 0.5 - c.cx) / c.fx
        y = (np.arange(c.height) + 0.5 - c.cy) / c.fy
        return np.stack((*np.meshgrid(x, y), np.ones((c.height, c.width))), axis=-1)

    def path(self, image_type: ImageType) -> Path:
        """The file of a picture.

        Raises:
            RecordError: the sample has no such picture.
        """
        image = self.record.images.get(image_type)
        if image is None:
            raise RecordError(f"{self.id} has no {image_type} picture, only {', '.join(self.record.images)}")
        return self._folder / image.path

    def _read(self, image_type: ImageType) -> NDArray[Any]:
        path = self.path(image_type)
        pixels: NDArray[Any] | None = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if pixels is None:
            raise RecordError(f"{path}: missing, or no picture")
        return pixels


class Dataset(Sequence[Sample]):
    """The samples of a dataset, in the order of its manifest.

    Of the manifest only the places of its lines are kept in memory; a bad line is a RecordError when it is asked for.
    Can be pickled, as the workers of data loaders need it.
    """

    def __init__(self, folder: str | Path) -> None:
        """
        Raises:
            RecordError: there is no dataset, or it is not finished.
        """
        self.folder: Final = Path(folder)
        self.description: Final = manifest.read_dataset(self.folder)
        path = self.folder / manifest.MANIFEST
        if not path.is_file():
            raise RecordError(f"{folder}: the dataset is not finished; run the command that makes it again")
        self._lines = Lines(path)

    @cached_property
    def scenes(self) -> tuple[str, ...]:
        """Names of all scenes. Reads the whole manifest."""
        return tuple(dict.fromkeys(self._record(index).scene for index in range(len(self))))

    def labels(self, scene: str) -> Mapping[int, tuple[tuple[str | int, ...], ...]]:
        """What the labels of a scene's pictures mean: the paths of the nodes that carry each."""
        found = manifest.read_file(self.folder / manifest.SCENES / scene / manifest.SCENE, manifest.Scene)
        return {int(label): paths for label, paths in found.labels.items()}

    def __len__(self) -> int:
        return len(self._lines)

    @overload
    def __getitem__(self, index: int) -> Sample: ...
    @overload
    def __getitem__(self, index: slice) -> list[Sample]: ...
    def __getitem__(self, index: int | slice) -> Sample | list[Sample]:
        if isinstance(index, slice):
            return [self._sample(number) for number in range(*index.indices(len(self)))]
        return self._sample(index)

    def __iter__(self) -> Iterator[Sample]:
        return map(self._sample, range(len(self)))

    def _sample(self, index: int) -> Sample:
        return Sample(self.folder, self._record(index), self.description.settings.depth_format)

    def _record(self, index: int) -> manifest.Sample:
        return manifest.decode(self._lines[index], manifest.Sample, self._lines.where(index))
