"""Check requests against the limits of the live tree: numbers of nodes and geometries, bytes of arrays and images.

``apply`` checks each command before it edits the tree.
"""

from __future__ import annotations

import math
import threading
import time
import weakref
from collections.abc import Callable, Iterable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.scene.geometry import Line, Part, PointCloud, Surface
from gateway.scene.tree import Node, Path
from gateway.treeviewer.config import Limits
from renderers.drawlist import Image, ImageError
from renderers.images import ImageFile, image_header

RECOUNT_SECONDS: Final = 1.0
"""Minimum interval between counts of the geometries in the tree: to count 250,000 nodes takes 0.1 s."""
RGBA_BYTES: Final = 4
"""Bytes of a decoded pixel."""
SMALL_ARRAY_BYTES: Final = 4096
"""Maximum size of arrays that are not counted: the limit on the number of geometries covers them."""


class TreeQuota:
    """Nodes, geometries, and bytes of arrays and images in use, and the checks against their limits.

    Other interfaces also edit the tree. Their edits are never refused.
    """

    def __init__(self, limits: Limits, clock: Callable[[], float] = time.monotonic) -> None:
        self._limits = limits
        self._clock = clock
        self._last_count = -math.inf
        self._parts = 0
        """Geometries in the tree, or more: ``_recount`` subtracts those that were replaced or deleted."""
        self._counted: dict[int, weakref.ref[Any]] = {}
        """Counted arrays and images, by ``id``."""
        self._lock = threading.RLock()
        self.array_bytes = 0
        """Bytes of large arrays and images from this interface that are still in use anywhere."""

    def adopt(self, root: Node) -> None:
        """Count a tree that exists before the first request, even if it exceeds the limits."""
        self._parts = _count_parts(root)
        for _, node in root.walk():
            self._reserve(_large_objects(node.parts or ()))

    def check(self, root: Node, path: Path, parts: int = 0) -> str:
        """Return the reason why ``parts`` geometries cannot be added at ``path``, or an empty string.

        With 0 geometries this checks only the nodes that the path needs.
        """
        nodes, max_nodes = root.node_count, self._limits.nodes
        if nodes + len(path) > max_nodes:
            created = _missing_nodes(root, path)
            if created and nodes + created > max_nodes:
                return f"the tree has {nodes} nodes, the limit is {max_nodes}"
        max_parts = self._limits.parts
        if parts and self._parts + parts > max_parts:
            self._recount(root)
            if self._parts + parts > max_parts:
                return f"the tree has {self._parts} geometries, the limit is {max_parts}"
        return ""

    def add_parts(self, count: int) -> None:
        """Count geometries that have been added to the tree."""
        self._parts += count

    def reserve_arrays(self, parts: Iterable[Part]) -> str:
        """Count the large arrays and images of ``parts`` until they are freed.

        Returns the reason why they exceed the limit, or an empty string. Objects over the limit are not counted.
        """
        objects = _large_objects(parts)
        return self._reserve(objects, self._limits.geometry_bytes) if objects else ""

    def _recount(self, root: Node) -> None:
        """Count the geometries in the tree, at most once in ``RECOUNT_SECONDS``."""
        now = self._clock()
        if now - self._last_count >= RECOUNT_SECONDS:
            self._last_count = now
            self._parts = _count_parts(root)

    def _reserve(self, objects: list[tuple[Any, int]], max_bytes: float = math.inf) -> str:
        """Count objects that are not counted yet, as ``reserve_arrays`` does.

        Args:
            objects: arrays and images with their sizes in bytes.
            max_bytes: limit on the bytes of all counted objects.
        """
        with self._lock:
            new = {id(each): (each, nbytes) for each, nbytes in objects if id(each) not in self._counted}
            size = sum(nbytes for _, nbytes in new.values())
            if self.array_bytes + size > max_bytes:
                return (
                    f"the tree's geometry holds {self.array_bytes} bytes and {size} more are wanted, "
                    f"the limit is {max_bytes}"
                )
            for key, (each, nbytes) in new.items():
                self._counted[key] = weakref.ref(each, self._on_freed(key, nbytes))
            self.array_bytes += size
        return ""

    def _on_freed(self, key: int, size: int) -> Callable[[Any], None]:
        """Return the callback of a weak reference that subtracts an object of ``size`` bytes."""

        def freed(_: Any) -> None:
            with self._lock:
                del self._counted[key]
                self.array_bytes -= size

        return freed


def _missing_nodes(root: Node, path: Path) -> int:
    """Return the number of nodes that must be created for ``path``."""
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
    """Return the large arrays of parts and their images, with their sizes in bytes."""
    objects: list[tuple[Any, int]] = []
    for part in parts:
        objects.extend((array, array.nbytes) for array in _arrays(part) if array.nbytes > SMALL_ARRAY_BYTES)
        texture = part.material.base_color_texture
        if texture is not None:
            objects.append((texture.image, _image_bytes(texture.image)))
    return objects


def _image_bytes(image: Image) -> int:
    """Return the bytes of an image from a file, encoded and decoded; 0 for other images."""
    if not isinstance(image.decode, ImageFile):
        return 0
    try:
        return len(image.decode.data) + RGBA_BYTES * image_header(image.decode.data).pixels
    except ImageError:
        return len(image.decode.data)


def _arrays(part: Part) -> Iterable[NDArray[np.generic]]:
    match part.shape:
        case Surface(mesh=mesh):
            return [array for array in (mesh.positions, mesh.elements, mesh.uv0, mesh.colors) if array is not None]
        case PointCloud(points=points, channels=channels):
            return points, *channels.values()
        case Line(points=points):
            return (points,)
    return ()
