"""Check requests against the limits of the live tree: numbers of nodes and geometries, bytes of arrays and images."""

import math
import threading
import time
import weakref
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.treeviewer.config import Limits
from gateway.scene.tree.geometry import Line, Part, PointCloud, Surface
from gateway.scene.tree.nodes import Node, Path
from renderers.drawlist import Image, ImageError
from renderers.images import ImageFile, image_header

RECOUNT_SECONDS: Final = 1.0
"""Minimum interval between counts of the geometries in the tree: counting those of 250,000 nodes takes 0.1 s."""
RGBA_BYTES: Final = 4
"""Bytes of a decoded pixel."""
SMALL_ARRAY_BYTES: Final = 4096
"""Size up to which arrays are not counted: the limit on the number of geometries covers them."""


class _ObjectsInUse:
    """Total size of objects that have not been freed. Each object counts once."""

    def __init__(self) -> None:
        self.total = 0
        self._counted: set[int] = set()
        """``id`` of the counted objects."""
        self._lock = threading.RLock()
        """Reentrant: while a thread holds it, the garbage collector may free a counted object in this thread."""

    def add(self, objects: list[tuple[Any, int]], maximum: float = math.inf) -> int:
        """Count objects with their sizes, unless their total would exceed the maximum; return the total with them."""
        with self._lock:
            new = {id(each): (each, size) for each, size in objects if id(each) not in self._counted}
            added = sum(size for _, size in new.values())
            if self.total + added > maximum:
                return self.total + added
            self.total += added
            for key, (each, size) in new.items():
                self._counted.add(key)
                weakref.finalize(each, self._freed, key, size).atexit = False
            return self.total

    def _freed(self, key: int, size: int) -> None:
        with self._lock:
            self._counted.remove(key)
            self.total -= size


class TreeQuota:
    """Counts what is in use, and checks requests against its limits. Edits of other interfaces always pass."""

    def __init__(self, limits: Limits, clock: Callable[[], float] = time.monotonic) -> None:
        self._limits = limits
        self._clock = clock
        self._last_count = -math.inf
        self.unpublished_nodes = 0
        """Number of nodes that a big request has added to its own copy of the tree so far. ``RequestApplier.slices``
        sets it while other requests run."""
        self._part_count = 0
        """Upper bound of the number of geometries in the tree; exact when they were counted at ``_last_count``."""
        self._arrays_in_use = _ObjectsInUse()
        """Bytes of large arrays and images."""
        self._labels_in_use = _ObjectsInUse()
        """Images of text labels."""

    @property
    def array_bytes(self) -> int:
        """Bytes of large arrays and images from this interface that are still in use anywhere."""
        return self._arrays_in_use.total

    def count_existing(self, root: Node) -> None:
        """Count a tree that exists before the first request, even if it exceeds the limits."""
        self._part_count = _count_parts(root)
        for _, node in root.walk():
            self._arrays_in_use.add(_large_objects(node.parts or ()))
            self._labels_in_use.add(_labels(node.parts or ()))

    def admit(self, root: Node, node_count: int, path: Path, parts: Sequence[Part] = ()) -> str:
        """Count what a command adds to the tree: geometries, and their arrays, images and labels until they are freed.

        Returns the reason why it exceeds a limit and must not be executed; or an empty string. ``root`` is the edited
        tree, ``node_count`` that of its nodes and of those that others have added since the edit began.
        """
        node_count += self.unpublished_nodes
        max_nodes = self._limits.nodes
        if node_count + len(path) > max_nodes:  # else no node of the path can be too many
            missing_nodes = _count_missing(root, path)
            if missing_nodes and node_count + missing_nodes > max_nodes:
                return f"the tree has {node_count} nodes, the limit is {max_nodes}"
        max_parts = self._limits.parts
        if parts and self._part_count + len(parts) > max_parts:
            now = self._clock()
            if now - self._last_count >= RECOUNT_SECONDS:
                self._last_count = now
                self._part_count = _count_parts(root)
            if self._part_count + len(parts) > max_parts:
                return f"the tree has {self._part_count} geometries, the limit is {max_parts}"
        labels = _labels(parts)
        max_labels = self._limits.text_labels
        if labels and (label_count := self._labels_in_use.add(labels, max_labels)) > max_labels:
            return f"{label_count} different text labels would be in use, the limit is {max_labels}"
        objects = _large_objects(parts)
        max_bytes = self._limits.geometry_bytes
        bytes_before = self.array_bytes
        if objects and (nbytes := self._arrays_in_use.add(objects, max_bytes)) > max_bytes:
            return (
                f"the tree's geometry holds {bytes_before} bytes and {nbytes - bytes_before} more are wanted, "
                f"the limit is {max_bytes}"
            )
        self._part_count += len(parts)
        return ""


def _count_missing(root: Node, path: Path) -> int:
    """Return the number of nodes on a path that do not exist."""
    node = root
    for depth, element in enumerate(path):
        child = node.children.get(element)
        if child is None:
            return len(path) - depth
        node = child
    return 0


def _count_parts(root: Node) -> int:
    return sum(len(node.parts or ()) for _, node in root.walk())


def _large_objects(parts: Iterable[Part]) -> list[tuple[Any, int]]:
    """Return the large arrays and the images of parts, with their sizes in bytes."""
    objects: list[tuple[Any, int]] = []
    for part in parts:
        objects.extend((array, array.nbytes) for array in _arrays_of(part) if array.nbytes > SMALL_ARRAY_BYTES)
        texture = part.material.base_color_texture
        if texture is not None:
            objects.append((texture.image, _image_bytes(texture.image)))
    return objects


def _labels(parts: Iterable[Part]) -> list[tuple[Any, int]]:
    """Return the images of text labels, each of which counts as one."""
    textures = (part.material.base_color_texture for part in parts if part.kind == "text")
    return [(texture.image, 1) for texture in textures if texture is not None]


def _image_bytes(image: Image) -> int:
    """Return the bytes of an image from a file, encoded and decoded; 0 for other images."""
    file = image.decode  # an ImageFile is the function that decodes it
    if not isinstance(file, ImageFile):
        return 0
    try:
        return len(file.data) + RGBA_BYTES * image_header(file.data).pixels
    except ImageError:
        return len(file.data)


def _arrays_of(part: Part) -> Iterable[NDArray[np.generic]]:
    match part.shape:
        case Surface(mesh=mesh):
            return [array for array in (mesh.positions, mesh.elements, mesh.uv0, mesh.colors) if array is not None]
        case PointCloud(points=points, channels=channels):
            return points, *channels.values()
        case Line(points=points):
            return (points,)
    return ()
