"""Random damage to documents: the reader returns a scene or raises a ``GltfError``, within its limits."""

import copy
import json
import re
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.files.gltf import GltfCache, GltfError, GltfLimits, read_gltf
from gateway.scene.tree.geometry import Surface
from renderers.cache import CacheBudget
from renderers.drawlist import Material
from tests.files.gltf.builder import TRIANGLE, Builder, data_uri, glb, parts
from tests.files.gltf.test_material_reader import png
from tests.support.corpus import corpus_dir, drake_scene

LIMITS = GltfLimits(
    max_vertices=10_000,
    max_elements=10_000,
    max_drawn_elements=100_000,
    max_buffer_bytes=1 << 20,
    max_mesh_bytes=1 << 20,
    max_nodes=1000,
)


def everything() -> dict[str, Any]:
    """A small document with every property that the reader uses."""
    b = Builder("Drake glTF merger")
    b.json.update(scene=0, extensionsUsed=["KHR_texture_basisu"], extensionsRequired=[])
    positions = b.accessor(np.vstack([TRIANGLE, (1, 1, 0)]))
    sparse = b.accessor(np.zeros((4, 3)))
    b.json["accessors"][sparse]["sparse"] = {
        "count": 2,
        "indices": {"bufferView": b.view(b"\0\3"), "componentType": 5121},
        "values": {"bufferView": b.view(np.ones(6, np.float32).tobytes()), "byteOffset": 0},
    }
    attributes = {
        "POSITION": positions,
        "NORMAL": b.accessor([(0, 0, 127)] * 4, "b", normalized=True),
        "TEXCOORD_0": b.accessor(np.zeros((4, 2)), "H", normalized=True),
        "COLOR_0": b.accessor(np.ones((4, 3))),
        "TANGENT": b.accessor([(1, 0, 0, 1)] * 4),
    }
    b.add("images", {"uri": data_uri(png()), "mimeType": "image/png", "name": "i"})
    b.add("images", {"bufferView": b.view(png((1, 2, 3)))})
    b.add("samplers", {"magFilter": 9729, "minFilter": 9987, "wrapS": 33071})
    b.add("textures", {"source": 0, "sampler": 0, "extensions": {"KHR_texture_basisu": {"source": 1}}})
    b.add("textures", {"source": 1})
    texture = {"index": 0, "texCoord": 0, "extensions": {"KHR_texture_transform": {"offset": [0, 1], "rotation": 1}}}
    pbr = {"baseColorFactor": [1, 1, 1, 0.5], "metallicFactor": 0, "roughnessFactor": 1, "baseColorTexture": texture}
    b.add("materials", {"pbrMetallicRoughness": pbr})
    b.add("materials", {"normalTexture": {"index": 1, "scale": 2}, "alphaMode": "MASK", "extensions": {}})
    for mode in range(7):
        indices = b.accessor([0, 1, 2, 3], "BHI"[mode % 3])
        b.mesh({"attributes": attributes, "indices": indices, "material": mode % 2, "mode": mode})
        b.node(mesh=mode, name="n", translation=[1, 2, 3], rotation=[0, 0, 0, 1], scale=[1, 1, -1])
    b.node(mesh=b.mesh({"attributes": {"POSITION": sparse}}), children=[0, 1], matrix=np.eye(4).ravel().tolist())
    b.add("cameras", {"perspective": {"yfov": 1, "znear": 0.1}})
    b.node(camera=0, children=[2, 3, 4, 5, 6, 7])
    b.add("scenes", {"nodes": [8]})
    return b.json


DOCUMENT = everything()


def places(value: Any, path: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    found = [path] if path else []
    for key, item in items:
        found += places(item, (*path, key))
    return found


PLACES = places(DOCUMENT)
VALUES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-3, 20),
    st.sampled_from([2**31 - 1, 2**31, 2**32, 2**53, 2**63, 2**64, 10**30, -(2**63), 5120, 5126, 28, 252]),
    st.floats(),
    st.sampled_from(["", "data:,", "x", "VEC3", "VEC4", "SCALAR", "MASK", "data:;base64,AAAA", "../a", "\0data 0"]),
    st.lists(st.integers(-1, 5), max_size=4),
    st.lists(st.floats(), min_size=3, max_size=4),
    st.dictionaries(st.sampled_from(["index", "a"]), st.integers(-1, 3), max_size=2),
    st.just("delete"),
)


def change(document: Any, place: tuple[str | int, ...], value: Any) -> None:
    parent = document
    for key in place[:-1]:
        try:
            parent = parent[key]
        except (KeyError, IndexError, TypeError):
            return
    try:
        if value == "delete":
            del parent[place[-1]]
        else:
            parent[place[-1]] = value
    except (KeyError, IndexError, TypeError):
        return


def check(data: bytes, cache: GltfCache | None = None) -> bool:
    """Read a document, check the result, and return False for a GltfError."""
    try:
        scene = read_gltf(data, limits=LIMITS, cache=cache)
    except GltfError as error:
        assert 0 < len(str(error)) < 1000
        return False
    for _, part in parts(scene):
        assert isinstance(part.shape, Surface)
        mesh = part.shape.mesh
        assert mesh.elements.size
        assert mesh.elements.max() < len(mesh.positions)
        for array in (mesh.positions, mesh.normals, mesh.uv0, mesh.uv1, mesh.colors, mesh.tangents):
            assert array is None or (len(array) == len(mesh.positions) and np.isfinite(array).all())
    for _, node in scene.root.walk():
        assert np.isfinite(node.matrix).all()
    return True


def test_the_undamaged_document_is_read() -> None:
    assert check(json.dumps(DOCUMENT).encode())


NAN = "NaN"  # as JSON, without quotes
INFINITY = "1e400"


@pytest.mark.parametrize("value", [None, True, -1, 1e300, NAN, INFINITY, "x", ["x"], {}])
def test_no_single_flaw_costs_more_than_its_element(value: Any) -> None:
    """Of each list, the first item is damaged. Something is left, as no flaw takes a whole array or the root node."""
    seen: Counter[tuple[str, ...]] = Counter()
    for place in PLACES:
        kind = tuple("#" if isinstance(key, int) else key for key in place)
        seen[kind] += 1
        if seen[kind] > 1 or len(place) == 1 or kind == ("asset", "version"):
            continue
        document = copy.deepcopy(DOCUMENT)
        change(document, place, value)
        text = json.dumps(document)
        for number in (NAN, INFINITY):
            text = text.replace(f'"{number}"', number)
        scene = read_gltf(text.encode(), limits=LIMITS)
        assert scene.instance_count > 0 or place[0] in ("nodes", "scenes"), place
        assert all(warning.isprintable() and len(warning) < 300 for warning in scene.warnings)


@given(st.lists(st.tuples(st.sampled_from(PLACES), VALUES), min_size=1, max_size=3))
@settings(deadline=None, max_examples=200)
def test_damaged_values(changes: list[tuple[tuple[str | int, ...], Any]]) -> None:
    document = copy.deepcopy(DOCUMENT)
    for place, value in changes:
        change(document, place, value)
    check(json.dumps(document).encode())


CACHE = GltfCache(CacheBudget(2 << 20))


@given(st.lists(st.tuples(st.sampled_from(PLACES), VALUES), min_size=1, max_size=2))
@settings(deadline=None, max_examples=100)
def test_a_shared_cache_does_not_change_the_result(changes: list[tuple[tuple[str | int, ...], Any]]) -> None:
    document = copy.deepcopy(DOCUMENT)
    for place, value in changes:
        change(document, place, value)
    data = json.dumps(document).encode()
    outcome = check(data)
    assert check(data, CACHE) == outcome
    assert check(data, CACHE) == outcome


TEXT = json.dumps(DOCUMENT).encode()
GLB = glb(DOCUMENT, bytes(16))


@given(st.sampled_from([TEXT, GLB]), st.data())
@settings(deadline=None, max_examples=150)
def test_damaged_bytes(source: bytes, data: st.DataObject) -> None:
    damaged = bytearray(source)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(damaged) - 1))
        damaged[at : at + data.draw(st.integers(0, 3))] = data.draw(st.binary(max_size=3))
    check(bytes(damaged))


@pytest.mark.corpus
@given(st.data())
@settings(deadline=None, max_examples=100)
def test_damaged_requests_of_drake(data: st.DataObject) -> None:
    corpus_dir()
    name, image_type = data.draw(st.sampled_from(["018_accessors", "019_hierarchy", "020_transparent"])), "label"
    document = json.loads(drake_scene(name).request(image_type).scene)
    found = places(document)
    for _ in range(data.draw(st.integers(1, 2))):
        change(document, data.draw(st.sampled_from(found)), data.draw(VALUES))
    check(json.dumps(document).encode())


@given(st.binary(max_size=200))
@settings(deadline=None, max_examples=100)
def test_any_bytes_are_read_or_a_gltf_error(data: bytes) -> None:
    for start in (b"", b"{", b"glTF\2\0\0\0"):
        assert check(start + data) in (True, False)


@pytest.mark.parametrize(
    ("text", "path"),
    [
        (r'{"asset":{"version":"2.0","generator":"a\ud800"}}', "asset.generator"),
        (r'{"extras":{"a\ud800":1}}', None),
        (r'{"nodes":[{"name":"a\ud800"}]}', "nodes[0].name"),
    ],
)
def test_strings_with_unpaired_surrogates_are_ignored(text: str, path: str | None) -> None:
    warnings = read_gltf(text.encode()).warnings
    assert warnings == ((rf'{path}: expected a string, got "a\ud800"; it is ignored',) if path else ())


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        (lambda b: b.json["buffers"][1].pop("uri"), "buffers[1]: there is neither a uri nor a binary chunk"),
        (lambda b: b.json["bufferViews"][1].update(byteLength=99), "bufferViews[1]: bytes 0 .. 99 are outside"),
        (lambda b: b.json["meshes"][1]["primitives"][0].update(mode=9), "mode: 9 is not between 0 and 6"),
        (lambda b: b.json["nodes"][1].update(mesh=9), ".mesh: 9 is out of range"),
        (lambda b: b.json["accessors"][1].update(count=4), "accessors[1]"),
    ],
)
def test_a_primitive_that_cannot_be_read_is_left_out(damage: Callable[[Builder], object], reason: str) -> None:
    """The others are drawn. A document of which nothing can be drawn is refused."""
    b = Builder()
    for _ in range(2):
        b.node(mesh=b.triangle())
    damage(b)
    scene = b.read()
    assert scene.instance_count == 1
    (warning,) = scene.warnings
    assert reason in warning
    assert warning.endswith(("; meshes[1].primitives[0] is left out", "; the node has no mesh"))
    del b.json["nodes"][0]
    with pytest.raises(GltfError, match=re.escape(reason)):
        b.read()


@pytest.mark.parametrize(
    ("primitive", "warning", "drawn"),
    [
        ({"indices": "x"}, 'indices: expected an integer, got "x"; meshes[1].primitives[0] is left out', 1),
        ("x", ': expected an object, got "x"; meshes[1].primitives[0] is left out', 1),
        ({"material": "x"}, '.material: expected an integer, got "x"; it is ignored', 2),
        ({"mode": None, "targets": 3}, ".targets: expected an array, got 3; it is ignored", 2),
    ],
)
def test_a_wrong_type_costs_the_primitive_only_if_it_must(primitive: Any, warning: str, drawn: int) -> None:
    b = Builder()
    for _ in range(2):
        b.node(mesh=b.triangle())
    primitives = b.json["meshes"][1]["primitives"]
    primitives[0] = {**primitives[0], **primitive} if isinstance(primitive, dict) else primitive
    scene = b.read()
    assert scene.instance_count == drawn
    (found,) = scene.warnings
    assert found.startswith("meshes[1].primitives[0]")
    assert found.endswith(warning)


@pytest.mark.parametrize(
    ("change", "warning"),
    [
        ({"pbrMetallicRoughness": {"baseColorFactor": "red"}}, '.baseColorFactor: expected an array, got "red"'),
        ({"pbrMetallicRoughness": {"baseColorFactor": [1, 0]}}, ".baseColorFactor: 2 numbers instead of 4"),
        ({"emissiveFactor": [0, None, 0]}, ".emissiveFactor[1]: expected a finite number, got null"),
        ({"extensions": {"KHR_materials_ior": "x"}}, '.extensions.KHR_materials_ior: expected an object, got "x"'),
        ({"normalTexture": {"index": "x"}}, '.normalTexture.index: expected an integer, got "x"'),
    ],
)
def test_a_wrong_property_of_a_material_leaves_the_others(change: dict[str, Any], warning: str) -> None:
    b = Builder()
    b.node(mesh=b.triangle(material=0))
    b.add("materials", {"doubleSided": True, **change})
    scene = b.read()
    ((_, part),) = parts(scene)
    assert part.material == Material(double_sided=True)
    (found,) = scene.warnings
    assert found.startswith("materials[0].")
    assert found.endswith(f"{warning}; it is ignored")


COLOR = "meshes[0].primitives[0].attributes.COLOR_0"
DEFAULT = "; meshes[0].primitives[0] has the default material"


@pytest.mark.parametrize(
    ("changes", "warning"),
    [
        ({"material": 3}, f"meshes[0].primitives[0].material: 3 is out of range (1 materials){DEFAULT}"),
        ({"material": -1}, f"meshes[0].primitives[0].material: -1 is out of range (1 materials){DEFAULT}"),
        ({"material": 0}, f'materials[0]: expected an object, got "red"{DEFAULT}'),
        ({"COLOR_0": 7}, f"{COLOR}: 7 is out of range (1 accessors); {COLOR} is ignored"),
        ({"camera": 2}, "nodes[0].camera: 2 is out of range (0 cameras); the node has no camera"),
    ],
)
def test_a_reference_that_cannot_be_followed_leaves_the_mesh(changes: dict[str, Any], warning: str) -> None:
    b = Builder()
    b.json["materials"] = ["red"]
    b.draw(**{name: value for name, value in changes.items() if name != "camera"})
    b.json["nodes"][0]["camera"] = changes.get("camera")
    scene = b.read()
    assert (scene.instance_count, scene.cameras) == (1, ())
    assert scene.warnings == (warning,)
