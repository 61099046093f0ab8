"""Warnings of the reader, with and without a cache."""

import json
from typing import Any

import numpy as np
import pytest

from gateway.files.gltf import GltfCache, GltfError, read_gltf
from tests.files.gltf.builder import Builder, meshes, parts


def document() -> dict[str, Any]:
    """Three meshes: a triangle; one of which a vertex is not finite; one without positions."""
    b = Builder()
    b.json["asset"]["extras"] = "long enough to be kept " * 300
    good = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], np.float32)
    b.draw(good, (0, 1, 2, 1, 2, 3))
    b.draw(np.vstack((good[:3], [np.inf] * 3)), (0, 1, 2, 1, 2, 3))
    b.json["meshes"][1]["weights"] = [0.5]
    b.node(mesh=b.mesh({"attributes": {"NORMAL": 0}, "indices": 1}))
    b.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    b.json |= {"extensionsUsed": ["EXT_unheard_of"], "materials": [{}], "scenes": [{"nodes": [0, 1, 2]}]}
    return dict(sorted(b.json.items()))


CHANGES: list[dict[str, Any]] = [
    {"nodes": [{"mesh": 0}, {"mesh": 1}, {"mesh": 2, "translation": [1, 0, 0]}]},
    {"nodes": [{"mesh": 2}, {"mesh": 0}, {"mesh": 1}]},
    {"nodes": [{"mesh": 0}, {}, {"mesh": 2}]},
    {"nodes": [{"mesh": 0}, {}, {}]},
    {"nodes": [{"mesh": 2}, {}, {}]},
    {"nodes": [{"mesh": 0, "skin": 0}, {"mesh": 1, "skin": 0}, {"mesh": 2}]},
    {"nodes": [{"mesh": 0, "weights": [1.0]}, {"mesh": 1}, {"mesh": 2}]},
    {"nodes": [{"mesh": 0, "extensions": {"KHR_lights_punctual": {"light": 7}}}, {"mesh": 1}, {"mesh": 2}]},
    {"scenes": [{"nodes": [1]}]},
]


def outcome_of(source: dict[str, Any], cache: GltfCache | None = None) -> Any:
    try:
        scene = read_gltf(json.dumps(source).encode(), cache=cache)
    except GltfError as error:
        return str(error)
    return scene.warnings, [path for path, _ in parts(scene)], scene.instance_count


@pytest.mark.parametrize("first", CHANGES)
def test_warnings_do_not_depend_on_the_cache(first: dict[str, Any]) -> None:
    cache = GltfCache()
    for change in (first, first, first, *CHANGES, first, *CHANGES):
        source = document() | change
        assert outcome_of(source, cache) == outcome_of(source)


def test_all_kinds_of_warnings() -> None:
    warnings, _, _ = outcome_of(document() | CHANGES[7])
    for piece in ("EXT_unheard_of", "not finite", "no POSITION", "lights"):
        assert sum(piece in warning for warning in warnings) == 1


def test_documents_without_warnings_are_hits() -> None:
    cache = GltfCache()
    for z in range(5):
        outcome_of(document() | {"nodes": [{"mesh": 0, "translation": [0, 0, z]}, {}, {}]}, cache)
    outcome_of(document() | {"nodes": [{"mesh": 0, "skin": 1}, {}, {}]}, cache)
    assert cache.documents.hits == 5


def test_repaired_meshes_warn_in_every_document() -> None:
    cache = GltfCache()
    for name in ("a", "b", "c"):
        source = document() | {"materials": [{"name": name}]}
        assert outcome_of(source, cache) == outcome_of(source)
        other = {"asset": {"version": "2.0", "extras": name * 8000}, **document()}
        assert outcome_of(other, cache) == outcome_of(other)


@pytest.mark.parametrize(("count", "last"), [(100, "has no direction"), (101, "1 more"), (150, "50 more")])
def test_at_most_100_warnings_are_listed(count: int, last: str) -> None:
    name = "KHR_lights_punctual"
    nodes = [{"scale": [0, 0, 0], "extensions": {name: {"light": 0}}}] * count
    source = {"extensions": {name: {"lights": [{"type": "point"}]}}, "nodes": nodes}
    warnings = read_gltf(json.dumps(source).encode()).warnings
    assert len(warnings) == min(count, 101)
    assert last in warnings[-1]


def test_meshes_without_primitives_have_a_warning() -> None:
    b = Builder()
    for mesh in (b.triangle(), b.mesh(), b.add("meshes", {"primitives": [None]})):
        b.node(mesh=mesh)
    scene = b.read()
    assert len(meshes(scene)) == 1
    empty, null = sorted(scene.warnings)
    assert empty == "meshes[1].primitives: there are none; the node has no mesh"
    assert null.startswith("meshes[2].primitives[0]")
