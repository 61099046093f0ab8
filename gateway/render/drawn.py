"""A posted scene as a draw list, without the detour over a tree: the poses of hundreds of nodes are new every time, and
all the rest is what it was."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from operator import is_
from typing import Final
from weakref import ref

import numpy as np

from gateway.scene.flatten import DRAWABLE, images_of
from gateway.scene.geometry import Part, Surface
from gateway.scene.gltf import DEFAULT_MATERIAL, GltfScene, label_from_material
from renderers.drawlist import LABEL_NONE, Cast, DrawList, Image, Placed

_REMEMBERED: Final = 8
"""Scenes whose things may stand elsewhere now: the colour, depth and label pictures of two or three."""
_EVERYBODY: Final[frozenset[int]] = frozenset()


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Company:
    """What of a posted scene stays the same while things move."""

    parts: Sequence[tuple[Part, ...]]
    """Of each node that has some."""
    branches: Sequence[int]
    """Of these nodes; they are equal below the same root of the scene."""
    away: frozenset[int]
    """Which of them are left out, being too far away."""
    cast: Cast
    images: tuple[Image, ...]
    mesh_bytes: int
    """Of all meshes, each counted once."""


class Companies:
    """Makes draw lists of posted scenes. Thread-safe; knows the last companies again while somebody keeps them."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._known: deque[ref[Company]] = deque(maxlen=_REMEMBERED)
        """The newest first."""

    def drawn(self, scene: GltfScene) -> tuple[DrawList, Company]:
        """What ``flatten(scene.root, label_of=labels_of(scene.root))`` gives, in a fraction of the time, and what is to
        be kept for the next scene."""
        placed = scene.nodes.placed()
        parts, branches = [place.parts for place in placed], [place.branch for place in placed]
        worlds = np.array([place.X_world_node for place in placed]).reshape(-1, 4, 4)
        away = _EVERYBODY
        if not -DRAWABLE < worlds.min(initial=0.0) <= worlds.max(initial=0.0) < DRAWABLE:  # nor where it is no number
            with np.errstate(all="ignore"):
                drawable = (np.abs(worlds) < DRAWABLE).all(axis=(1, 2))
            away = frozenset(np.flatnonzero(~drawable).tolist())
        company = self._find(parts, branches, away)
        if company is None:
            company = _company(parts, branches, away)
            with self._lock:
                self._known.appendleft(ref(company))
        if len(company.cast.meshes) != len(parts):
            times = [0 if number in away else len(of_node) for number, of_node in enumerate(parts)]
            worlds = np.repeat(worlds, times, axis=0)
        return DrawList(Placed(company.cast, worlds), company.images, scene.lights), company

    def _find(self, parts: list[tuple[Part, ...]], branches: list[int], away: frozenset[int]) -> Company | None:
        with self._lock:
            known = tuple(self._known)
        for each in known:
            company = each()
            if (
                company is not None
                and len(company.parts) == len(parts)
                and all(map(is_, company.parts, parts))
                and company.branches == branches
                and company.away == away
            ):
                return company
        return None


def _company(parts: list[tuple[Part, ...]], branches: list[int], away: frozenset[int]) -> Company:
    meshes, materials, labels = [], [], []
    bare = _labels_of_branches(parts, branches)
    for number, (of_node, branch) in enumerate(zip(parts, branches, strict=True)):
        for part in () if number in away else of_node:
            assert isinstance(part.shape, Surface)  # and without a transform of its own: glTF knows nothing else
            material = part.material
            meshes.append(part.shape.mesh)
            materials.append(material)
            named = material is not DEFAULT_MATERIAL
            labels.append(label_from_material(material) if named else bare.get(branch, LABEL_NONE))
    cast = Cast(tuple(meshes), tuple(materials), tuple(labels))
    mesh_bytes = sum([mesh.nbytes for mesh in {id(mesh): mesh for mesh in meshes}.values()])
    return Company(parts, branches, away, cast, images_of(materials), mesh_bytes)


def _labels_of_branches(parts: list[tuple[Part, ...]], branches: list[int]) -> dict[int, int]:
    """What is drawn without a material has, by branch, if the others there have one label."""
    if not any(part.material is DEFAULT_MATERIAL for of_node in parts for part in of_node):
        return {}
    found: dict[int, set[int]] = {}
    for of_node, branch in zip(parts, branches, strict=True):
        materials = [part.material for part in of_node if part.material is not DEFAULT_MATERIAL]
        found.setdefault(branch, set()).update(map(label_from_material, materials))
    return {branch: next(iter(labels)) for branch, labels in found.items() if len(labels) == 1}
