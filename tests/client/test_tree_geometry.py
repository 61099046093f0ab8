"""Typed geometry as objects of the protocol, and invalid geometry."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.adapters.treeviewer.number_arrays import unpack
from gateway.scene.tree.materials import material
from gateway.scene.tree.transforms import from_pose
from scenegate import (
    Box,
    CameraFrustum,
    Geometry,
    Heightmap,
    ImagePlane,
    Line,
    MeshFile,
    MeshGeometry,
    PlanarLidar,
    PointCloud,
    Sphere,
    Text,
    Transform,
)
from scenegate.messages import wire
from scenegate.messages.geometry import fields_of
from scenegate.messages.request_encoding import decode_response, empty_with_header, encode_request, pack
from tests.adapters.treeviewer.conversation import Viewer
from tests.support.solids import TYPES, example

POINTS = np.arange(12, dtype=np.float64).reshape(4, 3)
PIXELS = np.random.default_rng(0).integers(0, 256, (5, 7, 3), np.uint8)
ALL = [
    *map(example, TYPES),
    Box((1, 2, 3), color=(1, 0, 0)),
    Sphere(1, transform=(1, 2, 3)),
    Line(POINTS, end_head=True, head_length=0.1),
    MeshGeometry(POINTS, [[0, 1, 2]]),
    PointCloud(POINTS, colors=np.full((4, 3), 255, np.uint8), channels={"label": [1, 2, 3, 4], "uv": POINTS[:, :2]}),
    PointCloud(POINTS, intensity=[0, 0.5, 1, 1]),
    PlanarLidar([1, 2, 3], 0.0, 0.1, colors=np.ones((3, 4)), point_size=4),
    Line(POINTS, line_width=4),
    MeshGeometry(POINTS, [[0, 1, 2]], colors=np.full((4, 3), 255, np.uint8)),
    MeshGeometry(POINTS, [[0, 1, 2]], uv=POINTS[:, :2], image=PIXELS),
    ImagePlane(PIXELS, width=1),
    ImagePlane(PIXELS[:, :, 0] / 255.0, height=1),
    ImagePlane(PIL.Image.fromarray(PIXELS), width=1, height=1),
    Heightmap(POINTS, (1, 2), colors=np.full((4, 3, 3), 0.5)),
    Heightmap(POINTS, (1, 2), image=PIXELS),
    Text("hello", size=0.3, background="navy"),
    CameraFrustum(640, 480, 500, depth=0.5, line_width=2),
    CameraFrustum.from_fov(1.0, 1.5, color="green"),
]
WORD: Any = "abc"
NOTHING: Any = None
RAGGED: Any = [(0, 0, 0), (1, 1)]


def encoded(body: dict[str, Any], utime: int, name: str) -> bytes:
    return bytes(encode_request(body, utime, name))


@pytest.mark.parametrize("name", [wire.JSON, wire.BINARY])
@pytest.mark.parametrize("geometry", ALL, ids=lambda geometry: geometry.kind)
def test_the_viewer_understands_every_geometry(geometry: Geometry, name: str) -> None:
    viewer = Viewer()
    body = {"setgeometry": [{"path": ("a", 1), "geometries": [geometry.body()]}]}
    answer: Any = viewer.protocol.handle(encoded(body, 5, name))
    assert (answer.status, answer.error, answer.warnings) == (0, "", [])
    (part,) = viewer.parts("a", 1)
    assert part.kind == geometry.body()["type"]


@pytest.mark.parametrize("name", [wire.JSON, wire.BINARY])
def test_sends_uint8_colours_as_0_to_1(name: str) -> None:
    viewer = Viewer()
    cloud = PointCloud(POINTS, colors=np.array([[0, 51, 255]] * 4, np.uint8))
    viewer.protocol.handle(encoded({"setgeometry": [{"path": ["a"], "geometries": [cloud.body()]}]}, 5, name))
    shape: Any = viewer.parts("a")[0].shape
    np.testing.assert_allclose(shape.channels["rgb"], [[0, 0.2, 1]] * 4, rtol=1e-6)
    np.testing.assert_array_equal(shape.points, POINTS)


@pytest.mark.parametrize("name", [wire.JSON, wire.BINARY])
def test_images_keep_their_pixels(name: str, tmp_path: Path) -> None:
    viewer = Viewer()
    file = tmp_path / "image.png"
    PIL.Image.fromarray(PIXELS).save(file)
    images: list[Any] = [PIXELS, PIXELS / 255.0, file, str(file), file.read_bytes(), PIL.Image.open(file)]
    geometries = [ImagePlane(image, width=1).body() for image in images]
    viewer.protocol.handle(encoded({"setgeometry": [{"path": ["a"], "geometries": geometries}]}, 5, name))
    parts = viewer.parts("a")
    assert len(parts) == len(images)
    for part in parts:
        texture = part.material.base_color_texture
        assert texture is not None
        np.testing.assert_array_equal(texture.image.decode()[:, :, :3], PIXELS)


@pytest.mark.parametrize("name", [wire.JSON, wire.BINARY])
def test_colours_of_vertices_are_those_of_other_geometry(name: str) -> None:
    viewer = Viewer()
    colors = ["#336699", "orange", "white", "black"]
    rgb = np.array([[0x33, 0x66, 0x99], [255, 165, 0], [255, 255, 255], [0, 0, 0]], np.uint8)
    corners, faces = POINTS[:, [0, 2, 1]] ** 2, [[0, 1, 2], [0, 2, 3]]
    meshes: list[Geometry] = [MeshGeometry(corners, faces, colors=c) for c in (rgb, rgb / 255.0)]
    meshes += [Sphere(1, color=color) for color in colors]
    body = {"setgeometry": [{"path": ["a"], "geometries": [mesh.body() for mesh in meshes]}]}
    assert viewer.protocol.handle(encoded(body, 5, name)).status == 0
    parts: list[Any] = list(viewer.parts("a"))
    first, second, *spheres = parts
    expected = sorted(sphere.material.base_color for sphere in spheres)
    for part in (first, second):
        found = sorted(set(map(tuple, part.shape.mesh.colors.round(6).tolist())))
        np.testing.assert_allclose(found, expected, atol=2e-6)


def test_only_what_other_viewers_know_has_their_names() -> None:
    assert MeshGeometry(POINTS, [[0, 1, 2]]).body().keys() == {"type", "color", "vertices", "faces"}
    assert MeshGeometry(POINTS, [[0, 1, 2]]).body()["type"] == "mesh_data"
    assert MeshGeometry(POINTS, [[0, 1, 2]], uv=POINTS[:, :2]).body()["type"] == "mesh_data"
    assert MeshGeometry(POINTS, [[0, 1, 2]], colors=POINTS / 11).body()["type"] == "mesh"
    assert "point_size" not in PointCloud(POINTS).body()
    assert Line(POINTS).body()["radius"] == 0.01
    assert "line_width" not in Line(POINTS).body()
    assert Line(POINTS, line_width=2).body()["radius"] == 0


def test_a_frustum_from_the_field_of_view() -> None:
    frustum = CameraFrustum.from_fov(np.pi / 2, 1.5)
    assert frustum.width / frustum.height == 1.5
    assert frustum.fx / frustum.height == pytest.approx(0.5)
    with pytest.raises(ValueError, match=r"fovy .*pi.* 60"):
        CameraFrustum.from_fov(60)


@pytest.mark.parametrize(
    ("color", "expected"),
    [
        ((1, 0.5, 0), [1, 0.5, 0]),
        ([0, 1, 0.25, 0.5], [0, 1, 0.25, 0.5]),
        (np.array([0.1, 0.2, 0.3]), [0.1, 0.2, 0.3]),
        (np.array([255, 51, 0], np.uint8), [1, 0.2, 0]),
        (np.array([0, 1, 1, 51], np.uint8), [0, 1 / 255, 1 / 255, 0.2]),
        (tuple(np.array([255, 51, 0], np.uint8)), [1, 0.2, 0]),
        ((255, 51, 0), [1, 0.2, 0]),
        ([255, 51, 0, 51], [1, 0.2, 0, 0.2]),
        (np.array([0, 2, 0]), [0, 2 / 255, 0]),
        ((1, 1, 1), [1, 1, 1]),
        (0xFF3300, [1, 0.2, 0]),
        (0, [0, 0, 0]),
        (np.nextafter(np.array([1, 1, 0], np.float32), np.float32(2)), [1, 1, 0]),
        ("red", [1, 0, 0]),
        ("RebeccaPurple", [0.4, 0.2, 0.6]),
        ("#f30", [1, 0.2, 0]),
        ("#f303", [1, 0.2, 0, 0.2]),
        ("#ff3300", [1, 0.2, 0]),
        ("#FF330033", [1, 0.2, 0, 0.2]),
    ],
)
def test_colours_as_users_write_them(color: Any, expected: list[float]) -> None:
    assert Sphere(1, color=color).body()["color"] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("name", [wire.JSON, wire.BINARY])
@pytest.mark.parametrize("color", ["#336699", np.array([51, 102, 153], np.uint8)], ids=["hex", "bytes"])
def test_the_viewer_gets_colours_from_0_to_1(name: str, color: Any) -> None:
    viewer = Viewer()
    body = {"setgeometry": [{"path": ["a"], "geometries": [Sphere(1, color=color).body()]}]}
    answer: Any = viewer.protocol.handle(encoded(body, 5, name))
    assert (answer.status, answer.warnings) == (0, [])
    assert viewer.parts("a")[0].material is material((0.2, 0.4, 0.6, 1.0))


def test_mesh_files_are_scaled_by_one_or_three() -> None:
    assert MeshFile("a.obj", 2).body()["scale"] == [2, 2, 2]
    assert MeshFile("a.obj", (1, 2, 3)).body()["scale"] == [1, 2, 3]


@pytest.mark.parametrize(
    ("construct", "reason"),
    [
        # Values of other types than the annotations name are refused at run time, too.
        (lambda: Box((1, 2)), r"lengths must have 3 numbers, not an array of shape \(2,\)"),
        (lambda: Box(("a", "b", "c")), r"lengths must have 3 numbers, not \('a', 'b', 'c'\)"),  # type: ignore[arg-type]
        (lambda: Text(5), "text must be a string, not 5"),  # type: ignore[arg-type]
        (lambda: Text(NOTHING), "text must be a string, not None"),
        (lambda: PointCloud(NOTHING), "points must have rows of 3, not None"),
        (lambda: PointCloud({"x": 1}), r"points must have rows of 3, not \{'x': 1\}"),  # type: ignore[arg-type]
        (lambda: PointCloud(POINTS, channels=[POINTS]), "channels must be a mapping such as"),  # type: ignore[arg-type]
        (lambda: Box(WORD), "lengths must have 3 numbers, not 'abc'"),
        (lambda: Box(NOTHING), "lengths must have 3 numbers, not None"),
        (lambda: Sphere(WORD), "radius must be a number, not 'abc'"),
        (lambda: Box((1, 2, 3), color=(1, 1)), r"color must be 3 or 4 numbers, .* not an array of shape \(2,\)"),
        (lambda: Sphere(1, color=(255.0, 0, 0)), "color must be from 0 to 1, or a uint8 array from 0 to 255, not 255"),
        (lambda: Sphere(1, color=(256, 0, 0)), "color must be from 0 to 1, or a uint8 array from 0 to 255, not 256"),
        (lambda: Sphere(1, color=(255, -1, 0)), "color must be from 0 to 1, .* not 255"),
        (lambda: Sphere(1, color=0x1000000), "color must be 3 or 4 numbers, 0xrrggbb, a CSS name or"),
        (lambda: Sphere(1, color=-1), "color must be 3 or 4 numbers, .* not -1"),
        (lambda: Sphere(1, color=NOTHING), "color must be 3 or 4 numbers, .* not None"),
        (lambda: Sphere(1, color=(1.5, 0, 0)), "color must be from 0 to 1, .* not 1.5"),
        (lambda: Sphere(1, color=(0.5, -0.5, 0)), "color must be from 0 to 1, .* not -0.5"),
        (lambda: Sphere(1, color=(0.5, float("nan"), 0)), "color must have numbers, not nan"),
        (lambda: Sphere(1, color="grau"), "color 'grau' is neither a CSS name nor #rgb, #rgba, #rrggbb or #rrggbbaa"),
        (lambda: Sphere(1, color="#12"), "color '#12' is neither"),
        (lambda: Sphere(1, color="rgb(300, 0, 0)"), "is neither a CSS name nor"),
        (lambda: PointCloud(POINTS, colors=np.full((4, 3), 255.0)), "colors must be from 0 to 1, .* not 255"),
        (lambda: PointCloud(POINTS, colors=np.full((4, 3), 1.01)), "colors must be from 0 to 1, .* not 1.01"),
        (lambda: PointCloud(POINTS, colors=[[float("nan"), -1, 0]] * 4), "colors must be from 0 to 1, .* not -1"),
        (lambda: PointCloud(POINTS, intensity=[0, 1, 2, 40]), "intensity must be from 0 to 1, .* not 40"),
        (lambda: MeshFile("/a.obj", up="z"), "up, default_color and default_texture need data"),
        (lambda: PointCloud(POINTS.T), r"points must have rows of 3, not an array of shape \(3, 4\)"),
        (lambda: PointCloud(POINTS, colors=0 * POINTS[:2]), "colors has 2 values for 4 points"),
        (lambda: PointCloud(POINTS, colors=POINTS[:, :2]), "colors must have rows of 3 or 4"),
        (lambda: PointCloud(np.full((4, 3), "x")), "points must have numbers, not <U1"),
        (lambda: MeshGeometry(POINTS, [[0, 1, 4]]), "faces refer to vertex 0 to 4, there are 4"),
        (lambda: MeshGeometry(POINTS, [[0, 1, 1.5]]), "faces must have integers"),
        (lambda: MeshGeometry(POINTS, [[0, 1, 2]], colors=[(1, 0, 0)]), "colors must have 3 or 4 numbers"),
        (lambda: MeshGeometry(POINTS, [[0, 1, 2]], colors=np.full((4, 3), 256)), "colors must be from 0 .* not 256"),
        (lambda: MeshGeometry(POINTS, [[0, 1, 2]], image=PIXELS), "a mesh with an image needs uv"),
        (lambda: MeshGeometry(POINTS, [[0, 1, 2]], image=PIXELS, uv=POINTS[:2, :2]), "uv has 2 rows for 4 vertices"),
        (lambda: ImagePlane(PIXELS), "an image plane needs width or height"),
        (lambda: ImagePlane(PIXELS[0, 0], width=1), r"image must have shape \(H, W\), .* not \(3,\)"),
        (lambda: ImagePlane(PIXELS.astype(int), width=1), "image must be uint8, or floats from 0 to 1, not int64"),
        (lambda: ImagePlane(PIXELS * 1.0, width=1), "image must be from 0 to 1"),
        (lambda: Heightmap([1, 2], (1, 1)), r"heights must have at least 2 rows of 2 .*\(2,\)"),
        (lambda: Heightmap(POINTS, (1, 1), colors=PIXELS), r"colors .*\(5, 7, 3\) .*\(4, 3\)"),
        (lambda: Sphere(1, transform=np.eye(3)), "a transform is .* not an array of"),
        (lambda: Sphere(1, transform=WORD), "a transform is a Transform, 3 or 7 numbers or a 4x4 matrix, not 'abc'"),
        (lambda: Sphere(1, transform=Transform((0, 0, 0), (0, 0, 0, 0))), "quaternion has only zeros"),
        (lambda: Sphere(1, transform=2 * np.eye(4)), "without scale, shear or mirroring"),
        (lambda: Sphere(1, transform=np.diag((-1.0, 1, 1, 1))), "without scale, shear or mirroring"),
        (lambda: Sphere(1, transform=from_pose((1, 2, 3), (1, 0, 0, 0)).T), r"last row .* transposed\?"),
        (lambda: Sphere(10**400), r"radius must be a number, not 1000000"),
        (lambda: Box((1, 1, 10**400)), r"lengths must have 3 numbers, not \(1, 1, 1000"),
        (lambda: Sphere(1, color={"r": 1}), r"color must be 3 or 4 numbers, .* not \{'r': 1\}"),  # type: ignore[arg-type]
        (lambda: Sphere(1, color=[(1, 0), (1,)]), r"color must be 3 or 4 numbers, .* not \[\(1, 0\), \(1,\)\]"),
        (lambda: PointCloud(RAGGED), r"points must have rows of 3, not \[\(0, 0, 0\), \(1, 1\)\]"),
        (lambda: PointCloud(POINTS, colors="red"), "colors must have rows of 3 or 4 numbers, not 'red'"),
        (lambda: PointCloud(POINTS, colors=RAGGED), r"colors must have rows of 3 or 4 numbers, not \[\(0, 0"),
        (lambda: PointCloud(POINTS, intensity=RAGGED), r"intensity must have numbers, not \["),
        (lambda: PointCloud(POINTS, channels={"h": RAGGED}), r"channels\['h'\] must have numbers, not \["),
        (lambda: PointCloud(POINTS, channels={"h": [1, 2]}), r"channels\['h'\] has 2 values for 4 points"),
        (lambda: PointCloud(POINTS, channels={"h": 3}), r"channels\['h'\] must have rows of 1 to 16, not 3"),
        (lambda: MeshGeometry(POINTS, RAGGED), r"faces must have rows of 3, not \[\(0, 0, 0\), \(1, 1\)\]"),
        (lambda: MeshGeometry(POINTS, [[0, 1, 2]], colors=RAGGED), "colors must have rows of 3 or 4 numbers"),
        (lambda: Heightmap(RAGGED, (1, 1)), r"heights must have at least 2 rows of 2 numbers, not \["),
        (lambda: ImagePlane(RAGGED, 1), r"image must have shape \(H, W\), .* not \[\(0, 0, 0\), \(1, 1\)\]"),
        (lambda: ImagePlane(NOTHING, 1), r"image must have shape \(H, W\), .* not None"),
        (lambda: Text("a", background="grau"), "background 'grau' is neither a CSS name nor"),
        (lambda: MeshFile(NOTHING), "filename must be a path, not None"),
        (lambda: CameraFrustum.from_fov(WORD), "fovy must be a number, not 'abc'"),
    ],
)
def test_rejects_invalid_fields_where_they_are_written(construct: Callable[[], Geometry], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        construct()


@settings(deadline=None, max_examples=200)
@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.01))
def test_matrix_to_quaternion(q: list[float]) -> None:
    X = from_pose((1.0, -2.0, 3.0), (q[0], q[1], q[2], q[3]))
    made = Transform.of(np.linalg.pinv(np.linalg.pinv(X))).body()  # whose last row has rounding errors
    t, r = made["translation"], made["quaternion"]
    np.testing.assert_allclose(from_pose((t[0], t[1], t[2]), (r[0], r[1], r[2], r[3])), X, atol=1e-9)


def test_a_transform_from_seven_numbers() -> None:
    pose = np.array([1.0, 2.0, 3.0, 0.5, 0.5, 0.5, 0.5])
    assert Transform.of(pose) == Transform((1.0, 2.0, 3.0), (0.5, 0.5, 0.5, 0.5))
    with pytest.raises(ValueError, match="zeros"):
        Transform.of(np.zeros(7)).body()


@pytest.mark.parametrize("geometry", [Box, MeshGeometry, PlanarLidar, ImagePlane, MeshFile])
def test_docstrings_have_own_and_inherited_fields(geometry: type[Geometry]) -> None:
    _, _, attributes = (geometry.__doc__ or "").partition("\n\nAttributes:\n")
    described = [line.partition(":")[0].strip() for line in attributes.splitlines() if line[4:5].strip()]
    assert {field.name for field in fields_of(geometry) if field.required} <= set(described)
    assert described[-2:] == ["color", "transform"]
    assert len(set(described)) == len(described)


def test_copies_arrays() -> None:
    points = POINTS.copy()
    body = PointCloud(points).body()
    points[:] = 7
    np.testing.assert_array_equal(body["points"], POINTS)


def test_client_and_server_encode_alike() -> None:
    assert encoded({}, 9, wire.JSON) == wire.encode(b"{}", 9)
    assert decode_response(b"") is None
    assert decode_response(encoded({"timestamp": "x", "status": 0}, 1, wire.JSON)) is None
    assert decode_response(b"x" * 60) is None
    nested = wire.header(100_000, 1, wire.JSON) + b"[" * 100_000
    assert decode_response(nested) is None


def test_json_encoding_does_not_change_colours() -> None:
    rgb = np.array([[255, 0, 51]], np.uint8)
    cloud = PointCloud([[0, 0, 0]], colors=rgb).body()
    assert b"0.2" in encoded({"setgeometry": [{"path": ["a"], "geometries": [cloud]}]}, 1, wire.JSON)
    assert cloud["channels"]["rgb"].dtype == np.uint8


@settings(deadline=None)
@given(
    st.lists(st.integers(0, 5), min_size=1, max_size=2),
    st.sampled_from(["<f4", ">f4", "<f8", "u1", "<i8"]),
    st.booleans(),
)
def test_packs_arrays_with_and_without_reserved_header_alike(shape: list[int], kind: str, reserved: bool) -> None:
    values = np.arange(np.prod(shape), dtype=kind).reshape(shape)
    array: Any = values
    if reserved:
        array = empty_with_header(tuple(shape), kind)
        array[...] = values
    reversed_ = array[::-1]  # not contiguous
    for given_, wanted in ((array, values), (reversed_, values[::-1])):
        values_found = unpack(memoryview(pack(given_).data)).values
        assert values_found is not None
        assert values_found.tolist() == wanted.tolist()
    assert array.tolist() == values.tolist()


@pytest.mark.parametrize("mode", ["P", "1", "LA", "CMYK"])
def test_images_of_pillow_with_other_modes_are_refused(mode: str) -> None:
    image = pytest.importorskip("PIL.Image").new(mode, (4, 4))
    with pytest.raises(ValueError, match=f"an image of mode {mode} is not supported; use image.convert"):
        ImagePlane(image, width=1.0)


def test_integers_are_colours_from_0_to_255() -> None:
    red_and_grey = [(255, 0, 0), (128, 128, 128)]
    cloud = PointCloud([(0, 0, 0)] * 2, colors=red_and_grey).body()["channels"]["rgb"]
    assert (cloud.dtype, cloud.tolist()) == (np.uint8, [list(row) for row in red_and_grey])
    mesh = MeshGeometry([(0, 0, 0)] * 2, [(0, 1, 1)], colors=red_and_grey).body()["colors"]
    assert (mesh.dtype, mesh.tolist()) == (np.uint8, [list(row) for row in red_and_grey])
    ones = PointCloud([(0, 0, 0)], colors=[(1, 0, 1)]).body()["channels"]["rgb"]
    assert (ones.dtype, ones.tolist()) == (np.uint8, [[255, 0, 255]])
    floats = PointCloud([(0, 0, 0)], colors=[(0.5, np.nan, 1.000001)]).body()["channels"]["rgb"]
    assert (floats.dtype, floats.tolist()) == (np.uint8, [[128, 0, 255]])


def test_colors_of_a_heightmap_may_be_rows() -> None:
    for shape in ((3, 4, 3), (12, 4)):
        assert Heightmap(np.zeros((3, 4)), (1.0, 1.0), colors=np.zeros(shape)).body()["colors"].shape == (12, shape[-1])


SURVEYED = np.array(
    [(512345.678, 5412345.678, 312.5), (512347.678, 5412345.678, 312.5), (512345.678, 5412346.178, 312.5)]
)
"""Points in UTM coordinates, whose steps in float32 are 0.5 m."""


@pytest.mark.parametrize("transform", [None, (1, 2, 3, 0.6, 0, 0, 0.8)])
@pytest.mark.parametrize(
    ("geometry", "name"),
    [(PointCloud, "points"), (Line, "points"), (partial(MeshGeometry, faces=[(0, 1, 2)]), "vertices")],
)
def test_surveyed_coordinates_are_exact(geometry: Callable[..., Geometry], name: str, transform: Any) -> None:
    body = geometry(SURVEYED, transform=transform).body()
    assert body[name].dtype == np.float32
    sent = from_pose(**body["transform"])
    X = np.eye(4) if transform is None else from_pose(transform[:3], transform[3:])
    expected = SURVEYED @ X[:3, :3].T + X[:3, 3]
    np.testing.assert_allclose(body[name] @ sent[:3, :3].T + sent[:3, 3], expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    "points", [SURVEYED[:1], [*SURVEYED, (np.inf, np.nan, 0)], SURVEYED.tolist(), SURVEYED.astype(np.int64)]
)
def test_surveyed_points_of_any_kind_are_exact(points: Any) -> None:
    """A single one, one beside missing points, lists and integers."""
    body = PointCloud(points).body()
    expected = np.array(points, np.float64)
    is_there = np.isfinite(expected).all(axis=1)
    np.testing.assert_allclose(
        (body["points"] + np.array(body["transform"]["translation"]))[is_there], expected[is_there], rtol=0, atol=1e-6
    )


@pytest.mark.parametrize("points", [999 * np.eye(3), SURVEYED.astype(np.float32), [], np.empty((5, 0)), [(1e20, 0, 0)]])
def test_points_that_are_not_far_away_need_no_transform(points: Any) -> None:
    assert "transform" not in PointCloud(points).body()
