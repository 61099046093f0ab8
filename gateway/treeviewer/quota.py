"""Keeps the live tree within its bounds without counting it at every message."""

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
from gateway.scene.tree import Node
from gateway.treeviewer.config import Limits

RECOUNT_SECONDS: Final = 1.0
"""Counting 250,000 nodes takes 0.1 s, so a full tree is counted at most this often."""
SMALL_ARRAY: Final = 4096
"""Bytes; smaller arrays are covered by the bound on geometries."""


class Census:
    """Upper estimates of nodes and geometries, made exact when they reach the bound; and the bytes of big arrays.

    Others edit the tree too: what they add is seen at the next count.
    """

    def __init__(self, limits: Limits, clock: Callable[[], float] = time.monotonic) -> None:
        self._limits = limits
        self._clock = clock
        self._counted = -RECOUNT_SECONDS
        self.nodes = 1  # the root
        self.parts = 0
        self._arrays: dict[int, weakref.ref[Any]] = {}
        self._lock = threading.RLock()
        self.array_bytes = 0
        """Of big arrays made by this interface and still in use by anyone."""

    def adopt(self, root: Node) -> None:
        """Takes a tree into account that is there before the first request; nothing of it is refused."""
        self._count(root)
        for _, node in root.walk():
            self._book([a for part in node.parts or () for a in _arrays(part) if a.nbytes > SMALL_ARRAY])

    def surely_room(self, nodes: int, parts: int) -> bool:
        """Whether so many more fit, without a closer look."""
        return self.nodes + nodes <= self._limits.nodes and self.parts + parts <= self._limits.parts

    def room(self, root: Node, nodes: int, parts: int) -> str:
        """Whether ``nodes`` and ``parts`` more fit: empty, or the reason why not."""
        if self.nodes + nodes > self._limits.nodes or self.parts + parts > self._limits.parts:
            now = self._clock()
            if now - self._counted >= RECOUNT_SECONDS:
                self._counted = now
                self._count(root)
        if nodes and self.nodes + nodes > self._limits.nodes:
            return f"the tree has {self.nodes} nodes, the limit is {self._limits.nodes}"
        if parts and self.parts + parts > self._limits.parts:
            return f"the tree has {self.parts} geometries, the limit is {self._limits.parts}"
        return ""

    def _count(self, root: Node) -> None:
        nodes = parts = 0
        stack = [root]
        while stack:
            node = stack.pop()
            nodes += 1
            parts += len(node.parts or ())
            stack.extend(node.children.values())
        self.nodes, self.parts = nodes, parts

    def admit(self, parts: Iterable[Part]) -> str:
        """Takes the big arrays of ``parts`` into account until they are freed: empty, or why they do not fit."""
        big = [part for part in parts if type(part.shape) in _WITH_ARRAYS]
        if not big:
            return ""
        arrays = [array for part in big for array in _arrays(part) if array.nbytes > SMALL_ARRAY]
        return self._book(arrays, self._limits.geometry_bytes)

    def _book(self, arrays: list[NDArray[np.generic]], most: float = math.inf) -> str:
        with self._lock:
            fresh = {id(array): array for array in arrays if id(array) not in self._arrays}
            size = sum(array.nbytes for array in fresh.values())
            if self.array_bytes + size > most:
                return (
                    f"the tree's geometry holds {self.array_bytes} bytes and {size} more are wanted, "
                    f"the limit is {most}"
                )
            for key, array in fresh.items():
                self._arrays[key] = weakref.ref(array, self._freeing(key, array.nbytes))
            self.array_bytes += size
        return ""

    def _freeing(self, key: int, size: int) -> Callable[[Any], None]:
        def freed(_: Any) -> None:
            with self._lock:
                del self._arrays[key]
                self.array_bytes -= size

        return freed


_WITH_ARRAYS: Final = frozenset((Surface, PointCloud, Line))


def _arrays(part: Part) -> Iterable[NDArray[np.generic]]:
    shape = part.shape
    if isinstance(shape, Surface):
        return (shape.mesh.positions, shape.mesh.elements)
    if isinstance(shape, PointCloud):
        return (shape.points, *shape.channels.values())
    if isinstance(shape, Line):
        return (shape.points,)
    return ()
