"""What is large and shared: meshes and texture images, as frames of their own, made once for all browsers."""

from __future__ import annotations

import itertools
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Final
from weakref import WeakKeyDictionary, WeakValueDictionary, finalize

import numpy as np
from numpy.typing import NDArray

from gateway.scene.geometry import PointCloud
from gateway.scene.meshing import LARGEST
from gateway.viewer.frames import FrameBuilder
from renderers.drawlist import Image, Mesh

KEPT_BYTES: Final = 256 << 20
"""Encoded meshes kept for the next browser; beyond it the least recently used is encoded again when it is wanted."""


class Payloads:
    """Numbers for meshes and images by identity, and their bytes. Lives on the event loop, but ``mesh_frame`` may be
    called from any thread."""

    def __init__(self, kept_bytes: int = KEPT_BYTES) -> None:
        self._numbers = itertools.count(1)
        self._mesh_ids: WeakKeyDictionary[Mesh, int] = WeakKeyDictionary()
        self._meshes: WeakValueDictionary[int, Mesh] = WeakValueDictionary()
        self._image_ids: WeakKeyDictionary[Image, int] = WeakKeyDictionary()
        self._images: WeakValueDictionary[int, Image] = WeakValueDictionary()
        self._clouds: WeakValueDictionary[int, PointCloud] = WeakValueDictionary()
        self._frames: OrderedDict[int, bytes] = OrderedDict()
        self._size = 0
        self._kept_bytes = kept_bytes
        self._on_gone: list[Callable[[int], None]] = []

    def mesh_id(self, mesh: Mesh) -> int:
        """The mesh's number; never given to another one."""
        number = self._mesh_ids.get(mesh)
        if number is None:
            number = next(self._numbers)
            self._mesh_ids[mesh] = number
            self._meshes[number] = mesh
            finalize(mesh, self._gone, number).atexit = False
        return number

    def image_id(self, image: Image) -> int:
        """The image's number, by which ``image`` finds it."""
        number = self._image_ids.get(image)
        if number is None:
            number = next(self._numbers)
            self._image_ids[image] = number
            self._images[number] = image
        return number

    def image(self, number: int) -> Image | None:
        """The image with this number while something uses it."""
        return self._images.get(number)

    def note_cloud(self, number: int, cloud: PointCloud) -> None:
        """Remembers of which cloud the mesh is, while the cloud is used."""
        self._clouds[number] = cloud

    def channel(self, number: int, name: str) -> NDArray[np.float32] | None:
        """(N, k) float32: a channel of a mesh's cloud, for the points that are drawn; None: there is none."""
        cloud = self._clouds.get(number)
        values = None if cloud is None else cloud.channels.get(name)
        if cloud is None or values is None or len(values) != len(cloud.points):
            return None
        finite = (np.abs(cloud.points) < LARGEST).all(axis=1)
        return np.ascontiguousarray(values.reshape(len(values), -1)[finite], dtype=np.float32)

    def when_gone(self, callback: Callable[[int], None]) -> Callable[[], None]:
        """Calls back with the number of every mesh that nothing uses any more, from any thread; returns a way to
        end it."""
        self._on_gone.append(callback)
        return lambda: self._on_gone.remove(callback) if callback in self._on_gone else None

    def mesh_size(self, number: int) -> int:
        """Bytes of the mesh's arrays; 0 when it is gone or already encoded."""
        mesh = None if number in self._frames else self._meshes.get(number)
        return 0 if mesh is None else mesh.nbytes

    def mesh_frame(self, number: int) -> bytes | None:
        """The mesh as a frame; None when it is gone."""
        frame = self._frames.get(number)
        if frame is not None:
            return frame
        mesh = self._meshes.get(number)
        if mesh is None:
            return None
        frame = encode_mesh(number, mesh)
        if number not in self._frames:
            self._frames[number] = frame
            self._size += len(frame)
            while self._size > self._kept_bytes and len(self._frames) > 1:
                self._size -= len(self._frames.popitem(last=False)[1])
        return frame

    def _gone(self, number: int) -> None:
        frame = self._frames.pop(number, None)
        if frame is not None:
            self._size -= len(frame)
        for callback in tuple(self._on_gone):
            callback(number)


def encode_mesh(number: int, mesh: Mesh) -> bytes:
    """Positions and normals as f32, colours as u8 (half of the precision is more than a screen shows), indices as u32;
    ``index`` is absent when the elements are simply 0, 1, 2 ..."""
    builder = FrameBuilder()
    header: dict[str, Any] = {"kind": "mesh", "id": number, "topology": int(mesh.topology)}
    header["position"] = builder.array(mesh.positions)
    if mesh.normals is not None:
        header["normal"] = builder.array(mesh.normals)
    if mesh.colors is not None:
        header["color"] = builder.array(to_bytes(mesh.colors))
    if mesh.uv0 is not None:
        header["uv"] = builder.array(mesh.uv0)
    if mesh.uv1 is not None:
        header["uv1"] = builder.array(mesh.uv1)
    flat = mesh.elements.ravel()
    if len(flat) != len(mesh.positions) or not np.array_equal(flat, np.arange(len(flat), dtype=flat.dtype)):
        header["index"] = builder.array(flat)
    return builder.finish(header)


def to_bytes(colors: NDArray[np.float32]) -> NDArray[np.uint8]:
    """0..1 to 0..255, rounded; NaN becomes 0."""
    return (np.nan_to_num(colors, nan=0.0).clip(0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
