"""What Scenegate adds: meshes with colours or an image, planes, heightmaps, text, frustums, sizes in pixels."""

import base64
import io
from typing import Any

import numpy as np
import PIL.Image
import pytest
from numpy.typing import NDArray

from gateway.adapters.treeviewer.config import Limits
from gateway.scene.tree.geometry import Line, PointCloud
from renderers.color import linear_from_srgb
from renderers.drawlist import AlphaMode, Topology
from scenegate.messages.request_encoding import pack
from tests.adapters.treeviewer.conversation import BOX, CLOUD, TRIANGLE, Viewer
from tests.adapters.treeviewer.test_msgpack import tell

PIXELS = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3)
"""Two rows of three pixels."""
UV = [[0, 0], [1, 0], [0, 1]]
GREY = 0.5
LINEAR_GREY = linear_from_srgb(GREY)


def file(pixels: NDArray[np.uint8] = PIXELS, kind: str = "PNG") -> bytes:
    out = io.BytesIO()
    PIL.Image.fromarray(pixels).save(out, kind)
    return out.getvalue()


def text(data: bytes) -> str:
    return base64.b64encode(data).decode()


def image(**fields: Any) -> dict[str, Any]:
    return {"type": "image", "image": text(file()), "width": 3, **fields}


def mesh(**fields: Any) -> dict[str, Any]:
    return {"type": "mesh", **TRIANGLE, **fields}


def only_part(viewer: Viewer) -> Any:
    (part,) = viewer.parts()
    return part


def pixels_of(part: Any) -> NDArray[np.uint8]:
    pixels: NDArray[np.uint8] = part.material.base_color_texture.image.decode()
    return pixels


def bounds(part: Any) -> list[list[float]]:
    positions = part.shape.mesh.positions
    return [positions.min(axis=0).round(5).tolist(), positions.max(axis=0).round(5).tolist()]


def test_vertex_colours_are_linear_in_the_tree(viewer: Viewer) -> None:
    answer = viewer.publish(mesh(colors=[[1, 0, 0], [0, GREY, 0], [0, 0, 2]], color=[1, 1, 1, 0.5]))
    assert (answer["status"], len(answer["warnings"])) == (0, 1)
    part = only_part(viewer)
    assert part.kind == "mesh"
    found = sorted(part.shape.mesh.colors.tolist())
    expected: Any = [[0, 0, 1, 1], [0, LINEAR_GREY, 0, 1], [1, 0, 0, 1]]
    np.testing.assert_allclose(found, expected, atol=1e-6)
    assert part.material.base_color == (1.0, 1.0, 1.0, 0.5)
    assert part.material.alpha_mode is AlphaMode.BLEND


@pytest.mark.parametrize(
    ("fields", "base_color", "mode"),
    [
        ({"color": [1, 0, 0, 1]}, (1.0, 0.0, 0.0, 1.0), AlphaMode.OPAQUE),
        ({"colors": [[1, 0, 0, 0.5]] * 3}, (1.0, 1.0, 1.0, 1.0), AlphaMode.BLEND),
        ({"colors": [[1, 0, 0, 1]] * 3}, (1.0, 1.0, 1.0, 1.0), AlphaMode.OPAQUE),
    ],
)
def test_a_mesh_is_as_translucent_as_its_vertices(
    viewer: Viewer, fields: dict[str, Any], base_color: tuple[float, ...], mode: AlphaMode
) -> None:
    viewer.publish(mesh(**fields))
    assert (only_part(viewer).material.base_color, only_part(viewer).material.alpha_mode) == (base_color, mode)


def test_a_mesh_with_an_image(viewer: Viewer) -> None:
    assert viewer.publish(mesh(uv=UV, image=text(file())))["status"] == 0
    part = only_part(viewer)
    np.testing.assert_array_equal(pixels_of(part)[:, :, :3], PIXELS)
    found = np.hstack((part.shape.mesh.positions, part.shape.mesh.uv0)).tolist()
    assert sorted(found) == sorted(np.hstack((TRIANGLE["vertices"], UV)).tolist())
    assert not part.material.unlit


@pytest.mark.parametrize(
    ("sizes", "corner"), [({"width": 3}, [1.5, 1]), ({"height": 4}, [3, 2]), ({"width": 1, "height": 4}, [0.5, 2])]
)
def test_an_image_on_a_plane(viewer: Viewer, sizes: dict[str, float], corner: list[float]) -> None:
    assert viewer.publish({"type": "image", "image": text(file()), **sizes})["status"] == 0
    part = only_part(viewer)
    assert bounds(part) == [[-corner[0], -corner[1], 0], [*corner, 0]]
    top_left = part.shape.mesh.positions[(part.shape.mesh.uv0 == 0).all(axis=1)]
    np.testing.assert_allclose(top_left, [[-corner[0], corner[1], 0]])
    assert part.material.unlit
    assert part.material.alpha_mode is AlphaMode.OPAQUE


def test_images_may_be_jpeg_or_have_alpha(viewer: Viewer) -> None:
    assert viewer.publish(image(image=text(file(kind="JPEG"))))["status"] == 0
    rgba = np.dstack((PIXELS, np.full((2, 3), 254, np.uint8)))
    viewer.publish(image(image=text(file(rgba))))
    assert only_part(viewer).material.alpha_mode is AlphaMode.BLEND
    np.testing.assert_array_equal(pixels_of(only_part(viewer)), rgba)


@pytest.mark.parametrize("pixels", [PIXELS, PIXELS[:, :, 0], PIXELS[:, :, :1], np.dstack((PIXELS, PIXELS[:, :, 0]))])
def test_images_come_as_arrays_or_files_in_messagepack(viewer: Viewer, pixels: NDArray[np.uint8]) -> None:
    rgb = np.broadcast_to(pixels.reshape(2, 3, -1)[:, :, :3], (2, 3, 3))
    packed = pack(pixels)
    geometries = [{"type": "image", "image": value, "width": 1} for value in (packed, file(rgb))]
    assert tell(viewer, {"setgeometry": [{"path": ["it"], "geometries": geometries}]})["status"] == 0
    for part in viewer.parts():
        np.testing.assert_array_equal(pixels_of(part)[:, :, :3], rgb)


def test_equal_images_are_one_object(viewer: Viewer) -> None:
    viewer.publish(image(), image(width=1), mesh(uv=UV, image=text(file())))
    textures = [part.material.base_color_texture for part in viewer.parts()]
    assert len({texture.image for texture in textures if texture}) == 1


@pytest.mark.parametrize(
    ("geometry", "reason"),
    [
        (mesh(colors=[[1, 0, 0]]), "colors has 1 rows for 3"),
        (mesh(colors=[[1, 0]] * 3), "colors has rows of 2, not rows of 3 or 4 numbers"),
        (mesh(image=text(file())), "uv is missing, which an image needs"),
        (mesh(image=text(file()), uv=UV[:2]), "uv has 2 rows for 3 vertices"),
        ({"type": "image", "width": 1}, "image is missing"),
        ({"type": "image", "image": text(file())}, "width or height is missing"),
        (image(width=0), "width must be above 0, not 0"),
        (image(height="1"), 'height must be a number, not "1"'),
        (image(image=5), "image must be a PNG or JPEG file (base64 in JSON) or a uint8 array, not 5"),
        (image(image="°"), "image is not base64"),
        (image(image=text(b"GIF89a")), "image cannot be decoded: GIF images are not supported, only PNG, JPEG"),
        (image(image=text(file()[:-20])), "image cannot be decoded: broken PNG data"),
        (image(image=text(file(np.zeros((9, 9), np.uint8)))), "9x9 pixels are more than the limit of 80"),
        (image(image=text(file() + bytes(3000))), "bytes, the limit is 3000"),
        ({"type": "heightmap", "lengths": [1, 1]}, "heights is missing"),
        ({"type": "heightmap", "heights": [[1, 2]], "lengths": [1, 1]}, "heights has 1 rows of 2 numbers, 2 rows of 2"),
        ({"type": "heightmap", "heights": [[1, 2], [3]], "lengths": [1, 1]}, "heights has 1 number in row 1"),
        ({"type": "heightmap", "heights": [1, 2], "lengths": [1, 1]}, "heights has numbers, not rows of numbers"),
        ({"type": "heightmap", "heights": [[1] * 5] * 5, "lengths": [1, 1]}, "heights has 25 numbers, the limit is 20"),
        ({"type": "heightmap", "heights": [[1, 2]] * 2}, "lengths is missing"),
        ({"type": "heightmap", "heights": [[1, 2]] * 2, "lengths": [1, -1]}, "lengths must be above 0, not -1"),
        ({"type": "heightmap", "heights": [[1, 2]] * 2, "lengths": [1, 1], "colors": [[1, 1, 1]]}, "colors has 1 rows"),
        ({"type": "text"}, "text is missing"),
        ({"type": "text", "text": 5}, "text must be a string, not 5"),
        ({"type": "text", "text": "x" * 11}, "text has 11 characters, the limit is 10"),
        ({"type": "text", "text": "x", "size": 0}, "size must be above 0, not 0"),
        ({"type": "text", "text": "x", "background": "red"}, 'background must be a list of 4 numbers, not "red"'),
        ({"type": "camera_frustum", "width": 4, "height": 3}, "fx is missing"),
        ({"type": "camera_frustum", "width": 4, "height": 3, "fx": -1}, "fx must be above 0, not -1"),
        ({**CLOUD, "point_size": 0.5}, "point_size must be from 1 to 256 pixels, not 0.5"),
        ({"type": "line", "points": [[0, 0, 0], [1, 0, 0]], "line_width": 300}, "line_width must be from 1 to 256"),
    ],
)
def test_names_what_is_wrong(geometry: dict[str, Any], reason: str) -> None:
    viewer = Viewer(Limits(image_bytes=3000, image_pixels=80, text_chars=10, heights=20))
    answer = viewer.publish(geometry)
    assert answer["status"] == -3
    assert f"geometry.{reason.split()[0]}" in answer["error"] or reason in answer["error"]
    assert reason in answer["error"], answer["error"]


@pytest.mark.parametrize(
    ("pixels", "reason"),
    [
        (np.zeros((2, 3), np.float32), "image has shape (2, 3) and type float32, not (H, W), (H, W, 3 or 4) and uint8"),
        (np.zeros((2, 3, 2), np.uint8), "image has shape (2, 3, 2) and type uint8"),
        (np.zeros((0, 3), np.uint8), "image has no pixels"),
        (np.zeros((9, 9), np.uint8), "image has 9x9 pixels, the limit is 80"),
    ],
)
def test_names_what_is_wrong_with_an_array(pixels: NDArray[Any], reason: str) -> None:
    packed = pack(pixels)
    request = {"setgeometry": [{"path": ["it"], "geometry": {"type": "image", "image": packed, "width": 1}}]}
    assert reason in tell(Viewer(Limits(image_pixels=80)), request)["error"]


def test_a_heightmap_counts_as_meshgrid(viewer: Viewer) -> None:
    heights = [[0, 1, 2], [3, 4, 5]]
    colors = [[c / 10, 0, 0] for c in range(6)]
    assert viewer.publish({"type": "heightmap", "heights": heights, "lengths": [4, 2], "colors": colors})["status"] == 0
    surface = only_part(viewer).shape.mesh
    np.testing.assert_allclose(
        surface.positions, [[-2, -1, 0], [0, -1, 1], [2, -1, 2], [-2, 1, 3], [0, 1, 4], [2, 1, 5]]
    )
    assert len(surface.elements) == 4
    assert (surface.normals[:, 2] > 0).all()
    corners = surface.positions[surface.elements]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (facing[:, 2] > 0).all()
    np.testing.assert_allclose(surface.colors[5], [linear_from_srgb(0.5), 0, 0, 1], atol=1e-6)
    np.testing.assert_array_equal(surface.uv0[[0, 5]], [[0, 0], [1, 1]])


def test_heights_that_are_not_finite_are_holes_and_steep_ones_have_unit_normals(viewer: Viewer) -> None:
    nan = float("nan")
    viewer.publish({"type": "heightmap", "heights": [[0, 1e15], [1, 2]], "lengths": [1e-300, 1]})
    np.testing.assert_allclose(np.linalg.norm(only_part(viewer).shape.mesh.normals, axis=1), 1.0, rtol=1e-5)
    answer = viewer.publish({"type": "heightmap", "heights": [[nan, 1, 2], [3, 4, 5]], "lengths": [4, 2]})
    assert "1 heights are not finite; the surface has holes there" in answer["warnings"][0]
    assert len(only_part(viewer).shape.mesh.elements) == 2
    viewer.publish({"type": "heightmap", "heights": [[nan, nan], [3, 4]], "lengths": [4, 2]})
    assert viewer.parts() == ()


def test_large_heightmaps_in_both_formats(viewer: Viewer) -> None:
    heights = np.random.default_rng(0).random((200, 300)).round(4)
    geometry = {"type": "heightmap", "lengths": [1, 1]}
    assert viewer.publish({**geometry, "heights": heights.tolist()})["status"] == 0
    first = only_part(viewer).shape.mesh
    packed = pack(heights)
    request = {"setgeometry": [{"path": ["it"], "geometry": {**geometry, "heights": packed}}]}
    assert tell(viewer, request)["status"] == 0
    np.testing.assert_array_equal(only_part(viewer).shape.mesh.positions, first.positions)


def test_text_is_as_high_as_its_lines(viewer: Viewer) -> None:
    viewer.publish({"type": "text", "text": "one", "size": 0.2})
    one = only_part(viewer)
    viewer.publish({"type": "text", "text": "one\ntwo", "size": 0.2})
    two = only_part(viewer)
    heights = [bounds(part)[1][1] - bounds(part)[0][1] for part in (one, two)]
    assert heights[1] - heights[0] == pytest.approx(0.2, abs=1e-4)
    assert two.material.unlit
    assert two.material.alpha_mode is AlphaMode.BLEND
    alpha = pixels_of(two)[:, :, 3]
    assert alpha.max() == 255
    assert (alpha == 0).mean() > 0.5


def test_text_has_the_colours_of_the_command(viewer: Viewer) -> None:
    viewer.publish({"type": "text", "text": "M", "color": [1, 0, 0, 1], "background": [0, 0, 1, 1]})
    part = only_part(viewer)
    assert part.material.alpha_mode is AlphaMode.OPAQUE
    pixels = pixels_of(part)
    assert pixels[0, 0].tolist() == [0, 0, 255, 255]
    assert (pixels == [255, 0, 0, 255]).all(axis=2).any()


def test_warns_of_characters_without_a_letter(viewer: Viewer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.scene.draw.fonts._find_machine_font", lambda char: "")
    answer = viewer.publish({"type": "text", "text": "20 mm 𓀀"})
    assert answer["status"] == 0
    assert 'no font has the characters "𓀀"; boxes stand for them' in answer["warnings"][0]
    answer = viewer.publish({"type": "text", "text": " \n\t"})
    assert "text is empty, so nothing is drawn" in answer["warnings"][0]
    assert viewer.parts() == ()


def test_a_frustum_has_edges_and_an_image(viewer: Viewer) -> None:
    camera = {"type": "camera_frustum", "width": 640, "height": 480, "fx": 320, "cy": 0, "depth": 2}
    assert viewer.publish({**camera, "line_width": 3, "image": text(file())})["status"] == 0
    parts: Any = viewer.parts()
    edges, plane = parts
    assert edges.shape.mesh.topology is Topology.LINES
    assert edges.material.line_width == 3
    assert edges.shape.mesh.positions[:5].tolist() == [[0, 0, 0], [-2, 0, 2], [2, 0, 2], [2, 3, 2], [-2, 3, 2]]
    corners = plane.shape.mesh.positions @ plane.X_node_part[:3, :3].T + plane.X_node_part[:3, 3]
    top_left = corners[(plane.shape.mesh.uv0 == 0).all(axis=1)]
    np.testing.assert_allclose(top_left, [[-2, 0, 2]])
    bottom_right = corners[(plane.shape.mesh.uv0 == 1).all(axis=1)]
    np.testing.assert_allclose(bottom_right, [[2, 3, 2]])


@pytest.mark.parametrize(
    "geometry",
    [
        image(width=1e15, image=text(file(np.zeros((40, 2), np.uint8)))),
        image(width=float("nan")),
        {"type": "text", "text": "wide", "size": 9e14},
        {"type": "camera_frustum", "width": 4, "height": 3, "fx": 1e-300},
        {"type": "camera_frustum", "width": 4, "height": 3, "fx": 1, "cx": 1e15, "depth": 2},
    ],
)
def test_what_is_too_large_is_not_drawn(viewer: Viewer, geometry: dict[str, Any]) -> None:
    answer = viewer.publish(geometry)
    assert answer["status"] == 0
    assert "so nothing is drawn" in answer["warnings"][0]
    assert viewer.parts() == ()


def test_sizes_of_points_and_lines(viewer: Viewer) -> None:
    line = {"type": "line", "points": [[0, 0, 0], [1, 0, 0]]}
    viewer.publish(
        {**CLOUD, "point_size": 5}, CLOUD, {**line, "line_width": 4}, line, {**line, "radius": 0.1, "line_width": 4}
    )
    parts = viewer.parts()
    assert [part.material.point_size for part in parts[:2]] == [5, 2]
    assert [part.material.line_width for part in parts[2:4]] == [4, 1]
    assert isinstance(parts[0].shape, PointCloud)
    assert [shape.radius for part in parts[2:] if isinstance(shape := part.shape, Line)] == [0, 0.01, 0.1]


def test_images_count_towards_the_bytes_of_the_tree() -> None:
    viewer = Viewer(Limits(geometry_bytes=2_000_000))
    pixels = np.zeros((600, 600), np.uint8)
    assert viewer.publish(image(image=text(file(pixels))))["status"] == 0
    assert viewer.protocol.quota.array_bytes > 4 * 600 * 600
    pixels[0, 0] = 1
    answer = viewer.publish(image(image=text(file(pixels))), path=["other"])
    assert "the limit is 2000000" in answer["error"]
    assert viewer.publish(image(), BOX, path=["other"])["status"] == 0
    viewer.tell({"delete": [{"path": ["it"]}]})
    assert viewer.publish(image(image=text(file(pixels))))["status"] == 0
