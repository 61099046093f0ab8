"""A posted scene as a draw list, without the detour over a tree: the poses of hundreds of nodes are new every time, and
all the rest is what it was."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from operator import is_
from typing import Final
from weakref import ref

import numpy as np
from numpy.typing import NDArray

from gateway.gltf import DEFAULT_MATERIAL, GltfScene, label_from_material
from gateway.scene.flatten import DRAWABLE, images_of
from gateway.scene.geometry import Part, Surface
from renderers.drawlist import LABEL_NONE, DrawList, Image, InstanceSet, PosedInstances
from renderers.stop import check_stop

_REMEMBERED: Final = 8
"""Scenes whose things may stand elsewhere now: the colour, depth and label pictures of two or three."""
_NOBODY: Final[frozenset[int]] = frozenset()


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Company:
    """What of a posted scene stays the same while things move."""

    parts: list[tuple[Part, ...] | None]
    """As of ``NodeTree``."""
    parents: list[int]
    """As of ``NodeTree``."""
    away: frozenset[int]
    """Nodes that are too far away to be drawn."""
    cast: InstanceSet
    nodes: NDArray[np.intp]
    """(I,): each instance's node."""
    images: tuple[Image, ...]
    mesh_bytes: int
    """Of all meshes, each counted once."""


class Companies:
    """Makes draw lists of posted scenes. Thread-safe; knows the last companies again while somebody keeps them."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._known: list[ref[Company]] = []
        """The last one used first."""

    def drawn(self, scene: GltfScene) -> tuple[DrawList, Company]:
        """What ``flatten(scene.root, label_of=labels_of(scene.root))`` gives, in a fraction of the time, and what is to
        be kept for the next scene."""
        parts, parents, worlds = scene.nodes.parts, scene.nodes.parents, scene.nodes.X_world_node
        away = _NOBODY
        if not -DRAWABLE < worlds.min(initial=0.0) <= worlds.max(initial=0.0) < DRAWABLE:  # nor where it is no number
            with np.errstate(all="ignore"):
                drawable = (np.abs(worlds) < DRAWABLE).all(axis=(1, 2))
            away = frozenset(np.flatnonzero(~drawable).tolist())
        company = self._find(parts, parents, away) or _company(parts, parents, away)
        with self._lock:
            if not self._known or self._known[0]() is not company:
                others = [each for each in self._known if each() is not None and each() is not company]
                self._known = [ref(company), *others[: _REMEMBERED - 1]]
        return DrawList(PosedInstances(company.cast, worlds[company.nodes]), company.images, scene.lights), company

    def _find(self, parts: list[tuple[Part, ...] | None], parents: list[int], away: frozenset[int]) -> Company | None:
        with self._lock:
            known = tuple(self._known)
        for each in known:
            company = each()
            if (
                company is not None
                and len(company.parts) == len(parts)
                and all(map(is_, company.parts, parts))
                and company.parents == parents
                and company.away == away
            ):
                return company
        return None


def _company(parts: list[tuple[Part, ...] | None], parents: list[int], away: frozenset[int]) -> Company:
    meshes, materials, labels, nodes = [], [], [], []
    branches: list[int] = []
    for node, parent in enumerate(parents):
        branches.append(node if parent < 0 else branches[parent])
    bare = _labels_of_branches(parts, branches)
    for node, of_node in enumerate(parts):
        check_stop()
        for part in () if of_node is None or node in away else of_node:
            assert isinstance(part.shape, Surface)  # and without a transform of its own: glTF knows nothing else
            material = part.material
            meshes.append(part.shape.mesh)
            materials.append(material)
            named = material is not DEFAULT_MATERIAL
            labels.append(label_from_material(material) if named else bare.get(branches[node], LABEL_NONE))
            nodes.append(node)
    cast = InstanceSet(tuple(meshes), tuple(materials), tuple(labels))
    mesh_bytes = sum([mesh.nbytes for mesh in {id(mesh): mesh for mesh in meshes}.values()])
    return Company(parts, parents, away, cast, np.array(nodes, np.intp), images_of(materials), mesh_bytes)


def _labels_of_branches(parts: list[tuple[Part, ...] | None], branches: list[int]) -> dict[int, int]:
    """What is drawn without a material has, by the root that it is below, if the others there have one label."""
    if not any(part.material is DEFAULT_MATERIAL for of_node in parts for part in of_node or ()):
        return {}
    found: dict[int, set[int]] = {}
    for of_node, branch in zip(parts, branches, strict=True):
        materials = [part.material for part in of_node or () if part.material is not DEFAULT_MATERIAL]
        found.setdefault(branch, set()).update(map(label_from_material, materials))
    return {branch: next(iter(labels)) for branch, labels in found.items() if len(labels) == 1}
