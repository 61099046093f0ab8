"""Limits of the live tree: its nodes, its geometries, and the bytes of its arrays."""

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

RECOUNT_SECONDS: Final = 1.0
"""Minimum interval between counts of a full tree's geometries: a count of 250,000 nodes takes 0.1 s."""
SMALL_ARRAY_BYTES: Final = 4096
"""Arrays up to this size are covered by the limit on geometries."""


class TreeQuota:
    """Usage of the tree's limits. Other interfaces edit the tree, too, and are not limited."""

    def __init__(self, limits: Limits, clock: Callable[[], float] = time.monotonic) -> None:
        self._limits = limits
        self._clock = clock
        self._last_count = -math.inf
        self._parts = 0
        """Upper estimate of the tree's geometries: replaced and deleted ones are subtracted by the next count."""
        self._arrays: dict[int, weakref.ref[Any]] = {}
        self._lock = threading.RLock()
        self.array_bytes = 0
        """Bytes of large arrays from this interface that are still in use anywhere."""

    def adopt(self, root: Node) -> None:
        """Count a tree that exists before the first request; nothing of it is refused."""
        self._parts = _count_parts(root)
        for _, node in root.walk():
            self._reserve(_large_arrays(node.parts or ()))

    def check(self, root: Node, path: Path, parts: int = 0) -> str:
        """Return the reason why ``path`` cannot get ``parts`` more geometries, or an empty string."""
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
        """Count geometries that were added to the tree."""
        self._parts += count

    def reserve_arrays(self, parts: Iterable[Part]) -> str:
        """Count the large arrays of ``parts`` until they are freed; return why they do not fit, or an empty string."""
        arrays = _large_arrays(parts)
        return self._reserve(arrays, self._limits.geometry_bytes) if arrays else ""

    def _recount(self, root: Node) -> None:
        now = self._clock()
        if now - self._last_count >= RECOUNT_SECONDS:
            self._last_count = now
            self._parts = _count_parts(root)

    def _reserve(self, arrays: list[NDArray[np.generic]], max_bytes: float = math.inf) -> str:
        with self._lock:
            new = {id(array): array for array in arrays if id(array) not in self._arrays}
            size = sum(array.nbytes for array in new.values())
            if self.array_bytes + size > max_bytes:
                return (
                    f"the tree's geometry holds {self.array_bytes} bytes and {size} more are wanted, "
                    f"the limit is {max_bytes}"
                )
            for key, array in new.items():
                self._arrays[key] = weakref.ref(array, self._on_freed(key, array.nbytes))
            self.array_bytes += size
        return ""

    def _on_freed(self, key: int, size: int) -> Callable[[Any], None]:
        def freed(_: Any) -> None:
            with self._lock:
                del self._arrays[key]
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


def _large_arrays(parts: Iterable[Part]) -> list[NDArray[np.generic]]:
    return [array for part in parts for array in _arrays(part) if array.nbytes > SMALL_ARRAY_BYTES]


def _arrays(part: Part) -> Iterable[NDArray[np.generic]]:
    match part.shape:
        case Surface(mesh=mesh):
            return mesh.positions, mesh.elements
        case PointCloud(points=points, channels=channels):
            return points, *channels.values()
        case Line(points=points):
            return (points,)
    return ()
