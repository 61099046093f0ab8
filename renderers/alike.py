"""What was made of a scene, found again for the next scene of the same meshes and materials in other places."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Generic, TypeVar
from weakref import ref

from renderers.drawlist import Instance, Material, Mesh
from renderers.weaklru import WeakLru

V = TypeVar("V")
KEPT_PER_MESH: Final = 4
"""Scenes that begin with the same mesh, of which more than this are rarely drawn in turn."""


class Alike(Generic[V]):
    """Values by the meshes and materials of a list of instances, in their order. Thread-safe.

    A value lives while the first mesh does and its bytes fit into the bound. It must not hold that mesh itself.
    """

    def __init__(self, max_bytes: int) -> None:
        self._kept: WeakLru[Mesh, tuple[tuple[tuple[tuple[ref[Mesh], Material], ...], V, int], ...]] = WeakLru(
            max_bytes
        )

    @property
    def nbytes(self) -> int:
        """Bytes of what is kept."""
        return self._kept.nbytes

    def get(self, instances: Sequence[Instance]) -> V | None:
        """What was put for instances of the very same meshes and equal materials; None when there is nothing."""
        if not instances:
            return None
        for parts, value, _ in self._kept.get(instances[0].mesh) or ():
            if len(parts) == len(instances) and all(
                mesh() is i.mesh and (material is i.material or material == i.material)
                for (mesh, material), i in zip(parts, instances, strict=True)
            ):
                return value
        return None

    def put(self, instances: Sequence[Instance], value: V, nbytes: int) -> None:
        """Keeps a value; of those whose scenes begin with the same mesh, the newest few."""
        if not instances:
            return
        first = instances[0].mesh
        parts = tuple((ref(i.mesh), i.material) for i in instances)
        kept = ((parts, value, nbytes), *(self._kept.get(first) or ()))[:KEPT_PER_MESH]
        self._kept.put(first, kept, sum(size for _, _, size in kept))
