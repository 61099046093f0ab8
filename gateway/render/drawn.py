"""A posted scene as a draw list, without the detour over a tree: the poses of hundreds of nodes are new every time."""

from __future__ import annotations

import numpy as np

from gateway.scene.flatten import DRAWABLE, images_of
from gateway.scene.geometry import Surface
from gateway.scene.gltf import DEFAULT_MATERIAL, GltfScene, label_from_material
from renderers.drawlist import LABEL_NONE, DrawList, Instance


def drawn(scene: GltfScene) -> DrawList:
    """What ``flatten(scene.root, label_of=labels_of(scene.root))`` gives, several times as fast."""
    placed = scene.nodes.placed()
    bare: dict[int, int] = {}
    if any(part.material is DEFAULT_MATERIAL for place in placed for part in place.parts):
        neighbours: dict[int, set[int]] = {}
        for place in placed:
            of_branch = neighbours.setdefault(place.branch, set())
            of_branch.update(label_from_material(p.material) for p in place.parts if p.material is not DEFAULT_MATERIAL)
        bare = {branch: next(iter(found)) for branch, found in neighbours.items() if len(found) == 1}
    instances: list[Instance] = []
    worlds = np.array([place.X_world_node for place in placed]).reshape(-1, 4, 4)
    with np.errstate(all="ignore"):
        drawable = (np.abs(worlds) < DRAWABLE).all(axis=(1, 2)).tolist()
    for place, is_drawable in zip(placed, drawable, strict=True):
        if not is_drawable:
            continue
        for part in place.parts:
            assert isinstance(part.shape, Surface)  # and without a transform of its own: glTF knows nothing else
            material = part.material
            if material is DEFAULT_MATERIAL:
                label = bare.get(place.branch, LABEL_NONE)
            else:
                label = label_from_material(material)
            instances.append(Instance(part.shape.mesh, material, place.X_world_node, label, len(instances)))
    return DrawList(tuple(instances), images_of(instances), scene.lights)
