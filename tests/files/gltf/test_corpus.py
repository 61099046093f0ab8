"""The recorded requests of Drake's client, and trimesh as an independent reader of the same geometry."""

import io
import json
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from gateway.files.gltf import GltfCache, GltfScene, label_from_material, read_gltf
from gateway.files.gltf.document_cache import MIN_BYTES
from gateway.scene.tree.nodes import Node
from renderers.drawlist import Light, Texture
from tests.files.gltf.builder import mesh_of, parts
from tests.support.corpus import IMAGE_TYPES, DrakeScene, corpus_dir, drake_scene, drake_scenes

pytestmark = pytest.mark.corpus

SCENES = pytest.mark.parametrize("scene", drake_scenes() or [None], ids=str)


def read(scene: DrakeScene | None, image_type: str = "color", **options: Any) -> tuple[GltfScene, dict[str, Any]]:
    corpus_dir()
    # Recordings of other versions share the description of the same scene.
    info = scene.path.parent.parent / "scenes" / scene.name / "info.json"
    return read_gltf(scene.request(image_type).scene, posted=True, **options), json.loads(info.read_text())


def world_triangles(root: Node) -> NDArray[np.float64]:
    """(N, 3, 3): all triangles in the world, walked here once more."""
    found: list[NDArray[np.float64]] = []
    stack = [(root, np.eye(4))]
    while stack:
        node, X = stack.pop()
        X = X @ node.matrix
        for part in node.parts or ():
            if isinstance(part.shape, Light):
                continue
            mesh = mesh_of(part)
            found.append(mesh.positions.astype(np.float64)[mesh.elements] @ X[:3, :3].T + X[:3, 3])
        stack += [(child, X) for child in node.children.values()]
    return np.concatenate(found)


@SCENES
@pytest.mark.parametrize("image_type", IMAGE_TYPES)
def test_every_scene_is_read(scene: DrakeScene | None, image_type: str) -> None:
    glTF, info = read(scene, image_type)
    assert glTF.generator == info["generator"]
    assert glTF.from_drake
    assert len(glTF.content.cameras) == info["cameras"]
    document = json.loads(scene.request(image_type).scene)
    by_mesh = [sum(_triangles(document, p) for p in mesh["primitives"]) for mesh in document["meshes"]]
    assert sum(by_mesh) == info["triangles"]
    used = _used_meshes(document)
    assert glTF.element_count == sum(by_mesh[i] for i in used)
    assert glTF.instance_count == sum(len(document["meshes"][i]["primitives"]) for i in used)
    assert all("KHR_lights_punctual" in warning for warning in glTF.warnings)


def _triangles(document: dict[str, Any], primitive: dict[str, Any]) -> int:
    accessor = primitive.get("indices", primitive["attributes"]["POSITION"])
    return int(document["accessors"][accessor]["count"]) // 3


def _used_meshes(document: dict[str, Any]) -> list[int]:
    stack = list(document["scenes"][document["scene"]]["nodes"])
    used = []
    while stack:
        node = document["nodes"][stack.pop()]
        used += [node["mesh"]] if "mesh" in node else []
        stack += node.get("children", [])
    return used


@SCENES
def test_camera_pose_matches_the_clients(scene: DrakeScene | None) -> None:
    glTF, info = read(scene)
    np.testing.assert_allclose(glTF.camera.X_world_camera, info["capture"]["X_WC"], atol=1e-6)
    assert glTF.camera.znear == pytest.approx(float(info["fields"]["near"]))


@SCENES
def test_geometry_matches_trimesh(scene: DrakeScene | None) -> None:
    corpus_dir()
    data = scene.request("color").scene
    without_nulls = {key: value for key, value in json.loads(data).items() if value is not None}
    file = io.BytesIO(json.dumps(without_nulls).encode())
    theirs = trimesh.load_scene(file, file_type="gltf", skip_materials=True).to_mesh().triangles
    ours = world_triangles(read_gltf(data).root)
    assert len(ours) == len(theirs)
    for axis in (None, 0):  # every triangle's centre, and every corner, as sorted lists
        a, b = (np.asarray(t).mean(axis=1) if axis is None else np.asarray(t).reshape(-1, 3) for t in (ours, theirs))
        np.testing.assert_allclose(_sorted(a), _sorted(b), atol=2e-5)


def _sorted(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Each axis on its own: rows that differ by rounding would sort differently."""
    return np.sort(points, axis=0)


@SCENES
def test_requests_share_meshes(scene: DrakeScene | None) -> None:
    cache = GltfCache()
    first, _ = read(scene, "color", cache=cache)
    second, _ = read(scene, "label", cache=cache)
    third, _ = read(scene, "color", cache=cache)
    for (path, a), (_, b), (_, c) in zip(parts(first), parts(second), parts(third), strict=True):
        assert mesh_of(a) is mesh_of(b) is mesh_of(c), path
        assert a.material == c.material


@SCENES
def test_every_texture_decodes(scene: DrakeScene | None) -> None:
    glTF, info = read(scene)
    images = {
        texture.image
        for _, part in parts(glTF)
        for texture in (getattr(part.material, field.name) for field in fields(part.material))
        if isinstance(texture, Texture)
    }
    assert len(images) <= info["images"]
    assert bool(images) == bool(info["images"])
    for image in images:
        pixels = image.decode()
        assert pixels.shape[2] == 4
        assert pixels.size


@SCENES
def test_labels_match_the_reference_image(scene: DrakeScene | None) -> None:
    glTF, _ = read(scene, "label")
    if scene.name == "017_vertex_color":
        pytest.skip("RenderEngineVtk multiplies its labels by the vertex colours")
    sent = {label_from_material(part.material) for _, part in parts(glTF)}
    shown = {int(label) for label in np.unique(scene.reference_label())} - {32764}
    assert shown <= sent | {32764}


def test_copies_of_a_model_are_one_mesh() -> None:
    glTF, _ = read(drake_scene("016_label_codes"), "label")
    assert glTF.instance_count == 9
    assert len({id(mesh_of(part)) for _, part in parts(glTF)}) == 1


def test_vtk_materials_are_distinguished_from_those_of_gltf_files() -> None:
    glTF, _ = read(drake_scene("019_hierarchy"))
    assert {path[-1] for path, part in parts(glTF) if part.material.vtk_export} == {"g2"}
    assert {part.material.vtk_export for _, part in parts(read(drake_scene("001_primitives"))[0])} == {True}


@SCENES
def test_moved_requests_are_document_cache_hits(scene: DrakeScene | None) -> None:
    corpus_dir()
    data = scene.request("color").scene
    begin = data.rindex(b'"nodes"', 0, data.rindex(b'"Camera Node"'))
    cache = GltfCache()
    for x in range(4):
        moved = data[:begin] + data[begin:].replace(b'"Camera Node"', b'"Camera %d"' % x)
        glTF = read_gltf(moved, cache=cache)
        assert glTF.root.find(("Renderer Node", f"Camera {x}")) is not None
    assert cache.documents.hits == (3 if begin >= MIN_BYTES else 0)
