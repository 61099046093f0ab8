"""Ids of meshes, textures and point clouds, and a cache of encoded meshes, shared by all browsers."""

import itertools
import math
from collections import deque
from typing import Any, Final, Generic, TypeVar
from weakref import WeakKeyDictionary, WeakValueDictionary, finalize

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.viewer.frames import FrameBuilder
from gateway.adapters.viewer.messages import MeshPayload, Span
from gateway.scene.draw.meshing import MAX_EXTENT
from gateway.scene.tree.geometry import PointCloud
from renderers.cache import WeakCache
from renderers.color import srgb_colors_from_linear
from renderers.drawlist import Image, Mesh, Topology

T = TypeVar("T")

RECENT_IMAGES: Final = 8
"""Number of new images that are kept although the scene may use them no more: pages may still download them."""


class WeakIds(Generic[T]):
    """Assigns numeric ids to objects, by weak references. An id is never reused."""

    def __init__(self) -> None:
        self._counter = itertools.count(1)
        self._ids: WeakKeyDictionary[T, int] = WeakKeyDictionary()
        self.objects: WeakValueDictionary[int, T] = WeakValueDictionary()
        """Objects that exist, by their ids."""

    def id_of(self, value: T) -> tuple[int, bool]:
        """Return the id of an object, and True if it is new."""
        object_id = self._ids.get(value)
        if object_id is not None:
            return object_id, False
        object_id = self._ids[value] = next(self._counter)
        self.objects[object_id] = value
        return object_id, True


class Resources:
    """Meshes, textures and point clouds by id, used in the event loop; ``mesh_frame`` also in threads."""

    def __init__(self) -> None:
        self._meshes: WeakIds[Mesh] = WeakIds()
        self._images: WeakIds[Image] = WeakIds()
        self._recent_images: deque[Image] = deque(maxlen=RECENT_IMAGES)
        self.clouds: WeakValueDictionary[int, PointCloud] = WeakValueDictionary()
        """Point clouds by the id of the mesh that draws them."""
        self._mesh_frames: WeakCache[Mesh, bytes] = WeakCache("browser_meshes")
        self.removed_meshes: deque[int] = deque()
        """Ids of meshes that were garbage-collected. Any thread may append to it."""

    def mesh_id(self, mesh: Mesh) -> int:
        """Return the id of a mesh. A new mesh is assigned one."""
        mesh_id, is_new = self._meshes.id_of(mesh)
        if is_new:
            finalize(mesh, self.removed_meshes.append, mesh_id).atexit = False
        return mesh_id

    def image_id(self, image: Image) -> int:
        """Return the id of an image. A new image is assigned one."""
        image_id, is_new = self._images.id_of(image)
        if is_new:
            self._recent_images.append(image)
        return image_id

    def image(self, image_id: int) -> Image | None:
        """Return the image with an id, or None if the scene no longer uses it and it is not recent."""
        return self._images.objects.get(image_id)

    def take_removed_meshes(self) -> set[int]:
        """Return the ids of the meshes that were removed since the last call."""
        removed = set()
        while self.removed_meshes:
            removed.add(self.removed_meshes.popleft())
        return removed

    def bytes_to_encode(self, mesh_id: int) -> int:
        """Return the bytes of a mesh's arrays, or 0 if the mesh is already encoded or no longer exists."""
        mesh = self._meshes.objects.get(mesh_id)
        return 0 if mesh is None or self._mesh_frames.get(mesh) is not None else mesh.nbytes

    def mesh_frame(self, mesh_id: int) -> bytes | None:
        """Return the frame of a mesh, or None if the mesh no longer exists."""
        mesh = self._meshes.objects.get(mesh_id)
        if mesh is None:
            return None
        frame = self._mesh_frames.get(mesh)
        if frame is None:
            frame = encode_mesh(mesh_id, mesh)
            self._mesh_frames.put(mesh, frame, len(frame))
        return frame


def encode_mesh(mesh_id: int, mesh: Mesh) -> bytes:
    """Return the frame of a mesh.

    Positions, normals and texture coordinates are float32, colours uint8 and sRGB, indices uint32. The header has no
    ``index`` if the indices are 0, 1, 2, ... A mesh of points also has its bounds, ``box``: minimum and maximum. Points
    are in the order of ``sample_order``.
    """
    builder = FrameBuilder()
    indices = mesh.elements.ravel()
    is_indexed = len(indices) != len(mesh.positions) or not np.array_equal(
        indices, np.arange(len(indices), dtype=indices.dtype)
    )
    order: NDArray[np.int64] | slice = slice(None)
    box = None
    if mesh.topology is Topology.POINTS and len(mesh.positions):
        box = (tuple(mesh.positions.min(axis=0).tolist()), tuple(mesh.positions.max(axis=0).tolist()))
        if not is_indexed:
            order = sample_order(len(mesh.positions))
    colors = None if mesh.colors is None else colors_to_uint8(srgb_colors_from_linear(mesh.colors))

    def add(values: NDArray[Any] | None) -> Span | None:
        return None if values is None else builder.add_array(values[order])

    return builder.finish(
        MeshPayload(
            id=mesh_id,
            topology=mesh.topology.value,
            position=builder.add_array(mesh.positions[order]),
            box=box,
            normal=add(mesh.normals),
            uv=add(mesh.uv0),
            uv1=add(mesh.uv1),
            color=add(colors),
            index=builder.add_array(indices) if is_indexed else None,
        )
    )


def sample_order(count: int) -> NDArray[np.int64]:
    """Return a permutation of 0 to ``count`` - 1 in which each range is an even sample of all.

    Pages draw large clouds in such ranges. Each index is about ``count`` divided by the golden ratio above the previous
    one, modulo ``count``.
    """
    step = max(1, int(count * (5**0.5 - 1) / 2))
    while math.gcd(step, count) > 1:
        step += 1
    return np.arange(count, dtype=np.int64) * step % max(1, count)


def channel_values(cloud: PointCloud, name: str) -> NDArray[np.float32] | None:
    """Return a channel of a point cloud, (N, k) for the N points that are drawn, in their order; or None."""
    values = cloud.channels.get(name)
    if values is None or len(values) != len(cloud.points):
        return None
    is_drawn = (np.abs(cloud.points) < MAX_EXTENT).all(axis=1)
    drawn = values.reshape(len(values), -1)[is_drawn]
    return np.ascontiguousarray(drawn[sample_order(len(drawn))], dtype=np.float32)


def colors_to_uint8(colors: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Convert colours of 0 to 1 to 0 to 255, rounded. NaN becomes 0."""
    return (np.nan_to_num(colors, nan=0.0).clip(0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
