"""Ids of meshes, textures and point clouds, and meshes encoded once for all browsers."""

from __future__ import annotations

import itertools
from collections import deque
from typing import Any, Final, Generic, TypeVar
from weakref import WeakKeyDictionary, WeakValueDictionary, finalize

import numpy as np
from numpy.typing import NDArray

from gateway.scene.geometry import PointCloud
from gateway.scene.meshing import MAX_EXTENT
from gateway.viewer.frames import FrameBuilder
from renderers.cache import Cache
from renderers.drawlist import Image, Mesh

T = TypeVar("T")

MESH_FRAME_BYTES: Final = 256 << 20
"""Maximum size of all encoded meshes that are kept for further browsers."""


class WeakIds(Generic[T]):
    """Assigns numeric ids to objects without keeping them alive. An id is never reused."""

    def __init__(self) -> None:
        self._counter = itertools.count(1)
        self._ids: WeakKeyDictionary[T, int] = WeakKeyDictionary()
        self._objects: WeakValueDictionary[int, T] = WeakValueDictionary()

    def find(self, value: T) -> int | None:
        """Return the id of an object, or None if it has none."""
        return self._ids.get(value)

    def add(self, value: T) -> int:
        """Assign an id to an object that has none."""
        number = self._ids[value] = next(self._counter)
        self._objects[number] = value
        return number

    def get(self, number: int) -> T | None:
        """Return the object with an id, or None if it no longer exists."""
        return self._objects.get(number)


class Resources:
    """The meshes, textures and point clouds that browsers refer to by id.

    Belongs to the event loop, except ``mesh_frame``, which is thread-safe.
    """

    def __init__(self, mesh_frame_bytes: int = MESH_FRAME_BYTES) -> None:
        self._meshes: WeakIds[Mesh] = WeakIds()
        self._images: WeakIds[Image] = WeakIds()
        self._clouds: WeakValueDictionary[int, PointCloud] = WeakValueDictionary()
        self._mesh_frames: Cache[Mesh, bytes] = Cache(mesh_frame_bytes, weak=True)
        self._removed: deque[int] = deque()
        """Ids of meshes that were garbage-collected, in any thread."""

    def mesh_id(self, mesh: Mesh) -> int:
        """Return the id of a mesh."""
        number = self._meshes.find(mesh)
        if number is None:
            number = self._meshes.add(mesh)
            finalize(mesh, self._removed.append, number).atexit = False
        return number

    def image_id(self, image: Image) -> int:
        """Return the id of an image."""
        number = self._images.find(image)
        return self._images.add(image) if number is None else number

    def image(self, number: int) -> Image | None:
        """Return the image with an id, or None if nothing in the scene uses it any more."""
        return self._images.get(number)

    def add_cloud(self, mesh_id: int, cloud: PointCloud) -> None:
        """Register the point cloud that a mesh draws."""
        self._clouds[mesh_id] = cloud

    def channel(self, mesh_id: int, name: str) -> NDArray[np.float32] | None:
        """Return a channel of the point cloud that a mesh draws.

        Returns:
            (N, k) float32 for the N points that are drawn; None if there is no such cloud or channel.
        """
        cloud = self._clouds.get(mesh_id)
        values = None if cloud is None else cloud.channels.get(name)
        if cloud is None or values is None or len(values) != len(cloud.points):
            return None
        is_drawn = (np.abs(cloud.points) < MAX_EXTENT).all(axis=1)
        return np.ascontiguousarray(values.reshape(len(values), -1)[is_drawn], dtype=np.float32)

    def take_removed_meshes(self) -> set[int]:
        """Return the ids of meshes that no longer exist, each id once."""
        removed = set()
        while self._removed:
            removed.add(self._removed.popleft())
        return removed

    def bytes_to_encode(self, mesh_id: int) -> int:
        """Return the size of a mesh's arrays; 0 if it is already encoded or no longer exists."""
        mesh = self._meshes.get(mesh_id)
        return 0 if mesh is None or self._mesh_frames.get(mesh) is not None else mesh.nbytes

    def mesh_frame(self, mesh_id: int) -> bytes | None:
        """Return the frame of a mesh, or None if the mesh no longer exists."""
        mesh = self._meshes.get(mesh_id)
        if mesh is None:
            return None
        frame = self._mesh_frames.get(mesh)
        if frame is None:
            frame = encode_mesh(mesh_id, mesh)
            self._mesh_frames.put(mesh, frame, len(frame))
        return frame


def encode_mesh(mesh_id: int, mesh: Mesh) -> bytes:
    """Encode a mesh: positions, normals and texture coordinates as float32, colours as uint8, indices as uint32.

    ``index`` is missing if the indices are 0, 1, 2, ...
    """
    builder = FrameBuilder()
    header: dict[str, Any] = {"kind": "mesh", "id": mesh_id, "topology": int(mesh.topology)}
    header["position"] = builder.add_array(mesh.positions)
    for name, values in (("normal", mesh.normals), ("uv", mesh.uv0), ("uv1", mesh.uv1)):
        if values is not None:
            header[name] = builder.add_array(values)
    if mesh.colors is not None:
        header["color"] = builder.add_array(colors_to_uint8(mesh.colors))
    indices = mesh.elements.ravel()
    if len(indices) != len(mesh.positions) or not np.array_equal(indices, np.arange(len(indices), dtype=indices.dtype)):
        header["index"] = builder.add_array(indices)
    return builder.finish(header)


def colors_to_uint8(colors: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Convert 0..1 to 0..255, rounded; NaN becomes 0."""
    return (np.nan_to_num(colors, nan=0.0).clip(0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
