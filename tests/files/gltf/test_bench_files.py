import pytest

from bench import gltf_files
from bench.gltf_files import Model
from gateway.files.gltf import read_gltf

SMALL = (
    Model("one", 1, 99, 44, 3, 2, pictures=(300,)),
    Model("some", 7, 203, 151, 20, 4, textured=False),
    Model("looks", 1, 66_000, 10, 1, pictures=(200, 300, 400, 500, 600)),
)


def test_bench_files_match_their_description(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gltf_files, "MODELS", SMALL)
    files = [*gltf_files.files()]
    assert [kind for _, kind, _ in files] == ["glb", "gltf"] * 3
    for (name, _, data), model in zip(files, (model for model in SMALL for _ in range(2)), strict=True):
        scene = read_gltf(data)
        assert name.startswith(model.name)
        assert scene.warnings == ()
        assert (scene.element_count, scene.instance_count) == (model.triangles, model.meshes)
        assert len(scene.nodes.indices) == model.nodes
        meshes = [part.shape.mesh for of_node in scene.parts for part in of_node or ()]  # type: ignore[union-attr]  # surfaces
        assert sum(len(mesh.positions) for mesh in meshes) == model.vertices
        assert all(mesh.normals is not None and (mesh.uv0 is not None) == model.textured for mesh in meshes)
