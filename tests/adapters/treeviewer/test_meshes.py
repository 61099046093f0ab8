"""Meshes that clients send, their normals, and meshes in files."""

import base64
import io
import json
from typing import Any

import msgspec
import numpy as np
import pytest
from PIL import Image

from gateway.adapters.treeviewer.protocol import TreeViewerProtocol
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.transforms import from_pose, scaling
from renderers.drawlist import AlphaMode, Material, Mesh
from scenegate.messages import wire
from scenegate.messages.geometry import Sphere
from tests.adapters.treeviewer.conversation import TRIANGLE, Viewer, message
from tests.files.gltf.builder import Builder

NAN = float("nan")


def mesh_of(viewer: Viewer) -> Mesh:
    shape: Any = viewer.parts()[0].shape
    return shape.mesh


@pytest.mark.parametrize("faces", [[[0, 1, 2]], [[0.0, 1.0, 2.0]]])
def test_mesh_data(viewer: Viewer, faces: list[Any]) -> None:
    viewer.publish({"type": "mesh_data", **TRIANGLE, "faces": faces})
    mesh = mesh_of(viewer)
    np.testing.assert_array_equal(mesh.positions[mesh.elements[0]], np.array(TRIANGLE["vertices"], np.float32))
    assert mesh.normals is not None
    np.testing.assert_allclose(mesh.normals, np.tile((0, 0, 1), (3, 1)))


@pytest.mark.parametrize("kind", ["mesh_data", "mesh"])
@pytest.mark.parametrize("mesh", [{"vertices": [], "faces": []}, {**TRIANGLE, "faces": []}])
def test_a_mesh_without_faces_draws_nothing(viewer: Viewer, mesh: dict[str, Any], kind: str) -> None:
    assert viewer.publish({"type": kind, **mesh})["status"] == 0
    assert viewer.parts() == ()


def test_drops_faces_with_undrawable_vertices(viewer: Viewer) -> None:
    vertices = [*TRIANGLE["vertices"], [NAN, 0, 0]]
    answer = viewer.publish({"type": "mesh_data", "vertices": vertices, "faces": [[0, 1, 2], [0, 1, 3]]})
    assert "1 vertices are not finite" in answer["warnings"][0]
    assert len(mesh_of(viewer).elements) == 1
    assert np.isfinite(mesh_of(viewer).positions).all()


class Files:
    """Two parts, red and plain."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, tuple[float, float, float]]] = []

    def load(self, filename: str, scale: tuple[float, float, float], warnings: list[str]) -> tuple[Part, ...]:
        self.asked.append((filename, scale))
        if filename == "missing.obj":
            raise FileNotFoundError("missing.obj does not exist")
        if filename == "broken.obj":
            raise ValueError("broken.obj is \ud800 broken")
        return (Part(Sphere(1), Material(base_color=(1, 0, 0, 0.5)), scaling(*scale)), Part(Sphere(2), Material()))


def test_the_texture_of_a_robots_material_may_be_tga(viewer: Viewer) -> None:
    file = io.BytesIO()
    Image.new("RGB", (2, 2), (255, 0, 0)).save(file, "TGA")
    triangle = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n"
    sent = {"data": base64.b64encode(triangle).decode(), "default_texture": base64.b64encode(file.getvalue()).decode()}
    assert "warnings" not in viewer.publish({"type": "mesh_file", "filename": "a.obj", **sent})
    texture: Any = viewer.parts()[0].material.base_color_texture
    assert texture.image.decode()[0, 0].tolist() == [255, 0, 0, 255]


@pytest.mark.parametrize(
    "uri", ["buffer.bin", "parts\\\\buffer.bin", "C:\\\\me\\\\buffer.bin", "file:///me/buffer.bin"]
)
def test_files_of_gltf_documents_are_found_as_they_were_sent(viewer: Viewer, uri: str) -> None:
    b = Builder()
    b.node(mesh=b.triangle())
    buffer = b.json["buffers"][0]
    content, buffer["uri"] = buffer["uri"].partition(",")[2], json.loads(f'"{uri}"')
    data = base64.b64encode(b.text()).decode()
    answer = viewer.publish(
        {"type": "mesh_file", "filename": "a.gltf", "data": data, "files": {buffer["uri"]: content}}
    )
    assert answer["status"] == 0
    assert mesh_of(viewer).positions.shape == (3, 3)


def test_a_file_of_another_folder_is_not_taken_for_one_that_was_not_sent(viewer: Viewer) -> None:
    obj, mtl = (base64.b64encode(text).decode() for text in (b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3", b""))
    answer = viewer.publish({"type": "mesh_file", "filename": "a.obj", "data": obj, "files": {"b/a.mtl": mtl}})
    assert "'a.mtl' is left out" in answer["warnings"][0]


def test_a_file_name_that_cannot_be_encoded_is_an_error(viewer: Viewer) -> None:
    answer = viewer.publish({"type": "mesh_file", "filename": "a\ud800.obj", "data": "djAK"})
    assert "filename is not Unicode text: <str>" in answer["error"]


@pytest.mark.parametrize(
    ("scale", "asked"), [(None, (1, 1, 1)), (2, (2, 2, 2)), ([2], (2, 2, 2)), ([1, 2, 3], (1, 2, 3)), (True, (1, 1, 1))]
)
def test_a_mesh_file_may_be_scaled_by_one_number_or_three(scale: Any, asked: tuple[float, ...]) -> None:
    files = Files()
    viewer = Viewer(meshes=files)
    assert viewer.publish({"type": "mesh_file", "filename": "a.obj", "scale": scale})["status"] == 0
    assert files.asked == [("a.obj", asked)]
    assert [part.kind for part in viewer.parts()] == ["mesh_file"] * 2
    assert [part.source for part in viewer.parts()] == ["a.obj"] * 2


@pytest.mark.parametrize("scale", [[1, 2], "x", [None]])
def test_a_bad_scale_is_refused(scale: Any) -> None:
    answer = Viewer(meshes=Files()).publish({"type": "mesh_file", "filename": "a.obj", "scale": scale})
    assert answer["status"] == -3
    assert answer["errors"][0]["reason"] == f"geometry.scale must be a number or three, not {json.dumps(scale)}"


def test_a_files_parts_are_tinted_and_placed() -> None:
    viewer = Viewer(meshes=Files())
    viewer.publish(
        {
            "type": "mesh_file",
            "filename": "a.obj",
            "scale": 2,
            "color": [1, 1, 0, 0.5],
            "transform": {"translation": [1, 2, 3]},
        }
    )
    red, plain = viewer.parts()
    assert list(red.material.base_color) == [1, 0, 0, 0.25]
    assert list(plain.material.base_color) == [1, 1, 0, 0.5]
    assert plain.material.alpha_mode is AlphaMode.BLEND
    np.testing.assert_array_equal(red.X_node_part, from_pose((1, 2, 3), (1, 0, 0, 0)) @ scaling(2, 2, 2))
    viewer.publish({"type": "mesh_file", "filename": "a.obj", "color": [1, 1, 1, 1]})
    assert viewer.parts()[0].material.base_color == (1, 0, 0, 0.5), "white leaves the file's colours"


def test_a_missing_file_is_a_warning_and_a_broken_one_an_error() -> None:
    viewer = Viewer(meshes=Files())
    missing = viewer.publish({"type": "mesh_file", "filename": "missing.obj"})
    assert (missing["status"], missing["added_geometries"]) == (0, [["it"]])
    assert "missing.obj does not exist, so nothing is drawn" in missing["warnings"][0]
    assert viewer.parts() == ()
    broken = viewer.publish({"type": "mesh_file", "filename": "broken.obj"})
    assert broken["status"] == -3
    assert broken["errors"][0]["reason"] == "geometry.filename: broken.obj is ? broken"


def test_programs_on_this_machine_name_files_of_their_own_loader() -> None:
    everybody, local = Files(), Files()
    protocol = TreeViewerProtocol(LiveTree(), meshes=everybody, local_meshes=local)
    geometry = {"type": "mesh_file", "filename": "a.obj"}
    for binary in (False, True):
        request = {"setgeometry": [{"path": ["a"], "geometry": geometry}]}
        data = wire.encode(msgspec.msgpack.encode(request), 1, wire.BINARY) if binary else message(request)
        for is_local in (False, True):
            assert protocol.read(wire.decode(data), is_local).request.geometries
    assert everybody.asked == local.asked == [("a.obj", (1.0, 1.0, 1.0))] * 2
