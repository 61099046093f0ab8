"""Check requests against the limits of the live tree: numbers of nodes and geometries, bytes of arrays.

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

RECOUNT_SECONDS: Final = 1.0
"""Minimum interval between counts of the geometries in the tree: to count 250,000 nodes takes 0.1 s."""
SMALL_ARRAY_BYTES: Final = 4096
"""Maximum size of arrays that are not counted: the limit on the number of geometries covers them."""


class TreeQuota:
    """Nodes, geometries and array bytes in use, and the checks against their limits.

    Other interfaces also edit the tree. Their edits are never refused.
    """

    def __init__(self, limits: Limits, clock: Callable[[], float] = time.monotonic) -> None:
        self._limits = limits
        self._clock = clock
        self._last_count = -math.inf
        self._parts = 0
        """Geometries in the tree, or more: ``_recount`` subtracts those that were replaced or deleted."""
        self._arrays: dict[int, weakref.ref[Any]] = {}
        """Counted arrays, by ``id``."""
        self._lock = threading.RLock()
        self.array_bytes = 0
        """Bytes of large arrays from this interface that are still in use anywhere."""

    def adopt(self, root: Node) -> None:
        """Count a tree that exists before the first request, even if it exceeds the limits."""
        self._parts = _count_parts(root)
        for _, node in root.walk():
            self._reserve(_large_arrays(node.parts or ()))

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
        """Count the large arrays of ``parts`` until they are freed.

        Returns the reason why they exceed the limit, or an empty string. Arrays over the limit are not counted.
        """
        arrays = _large_arrays(parts)
        return self._reserve(arrays, self._limits.geometry_bytes) if arrays else ""

    def _recount(self, root: Node) -> None:
        """Count the geometries in the tree, at most once in ``RECOUNT_SECONDS``."""
        now = self._clock()
        if now - self._last_count >= RECOUNT_SECONDS:
            self._last_count = now
            self._parts = _count_parts(root)

    def _reserve(self, arrays: list[NDArray[np.generic]], max_bytes: float = math.inf) -> str:
        """Count arrays that are not counted yet, as ``reserve_arrays`` does."""
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
        """Return the callback of a weak reference that subtracts an array of ``size`` bytes."""

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
