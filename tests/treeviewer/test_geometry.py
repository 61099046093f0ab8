"""All geometry types of the protocol with their fields, defaults and oddities."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from gateway.scene.geometry import Box, Capsule, Cylinder, Ellipsoid, Line, Part, PointCloud, Sphere, Surface, Triad
from gateway.scene.transforms import IDENTITY, from_pose, scaling
from gateway.treeviewer.config import Limits
from gateway.treeviewer.geometry import material
from gateway.treeviewer.normals import CREASE_COSINE, smooth_mesh, smoothed
from renderers.drawlist import AlphaMode, Material, Mesh
from tests.treeviewer.conversation import BOX, Viewer

NAN, INF = float("nan"), float("inf")
TRIANGLE = {"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]]}
CLOUD = {"type": "pointcloud", "points": [[0, 0, 0], [1, 0, 0], [0, 1, 0]]}


@pytest.fixture
def viewer() -> Viewer:
    return Viewer()


@pytest.mark.parametrize("color", [None, [1, 1, 1, 1], [2, 0, 0, 0.5]], ids=["default", "typed", "lenient"])
@pytest.mark.parametrize(
    ("geometry", "shape"),
    [
        ({"type": "box", "lengths": [1, 2, 3]}, Box((1, 2, 3))),
        ({"type": "sphere", "radius": 0.5}, Sphere(0.5)),
        ({"type": "ellipsoid", "radii": [1, 2, 3]}, Ellipsoid((1, 2, 3))),
        ({"type": "cylinder", "radius": 1, "length": 2}, Cylinder(1, 2)),
        ({"type": "capsule", "radius": 1, "length": 2}, Capsule(1, 2)),
        ({"type": "triad"}, Triad(1.0, False)),
        ({"type": "triad", "scale": 2, "tube": True}, Triad(2, True)),
        ({"type": "triad", "scale": None, "tube": None}, Triad(1.0, False)),
        ({"type": "box", "lengths": 2}, Box((2, 2, 2))),
        ({"type": "box", "lengths": [2]}, Box((2, 2, 2))),
        ({"type": "box", "lengths": [-1, 2, 3]}, Box((0, 2, 3))),
        ({"type": "sphere", "radius": True}, Sphere(1)),
        ({"type": "sphere", "radius": -1}, Sphere(0)),
    ],
)
def test_solids(viewer: Viewer, geometry: dict[str, Any], shape: Any, color: Any) -> None:
    answer = viewer.set(geometry if color is None else {**geometry, "color": color})
    assert answer["status"] == 0, answer
    assert "warnings" not in answer
    (part,) = viewer.parts()
    assert part.shape == shape
    assert part.kind == geometry["type"]
    assert part.X_node_part is IDENTITY
    assert part.material is material((1.0, 0.0, 0.0, 0.5) if color == [2, 0, 0, 0.5] else (1.0, 1.0, 1.0, 1.0))


@pytest.mark.parametrize(
    "geometry",
    [
        {"type": "box", "lengths": [1, NAN, 3]},
        {"type": "sphere", "radius": INF},
        {"type": "sphere", "radius": 1e300},
        {"type": "cylinder", "radius": 1, "length": NAN},
        {"type": "triad", "scale": NAN},
        {"type": "triad", "scale": 0},
        {"type": "line", "points": [[0, 0, 0], [1, 0, 0]], "radius": NAN},
        {**BOX, "transform": {"translation": [NAN, 0, 0]}},
    ],
)
def test_what_cannot_be_drawn_is_present_and_warned_about(viewer: Viewer, geometry: dict[str, Any]) -> None:
    answer = viewer.set(geometry, BOX)
    assert (answer["status"], answer["added_geometries"]) == (0, [["it"]])
    assert "nothing is drawn" in answer["warnings"][0]
    assert [part.shape for part in viewer.parts()] == [Box((1, 2, 3))]


@pytest.mark.parametrize(
    ("geometry", "reason"),
    [
        ({"type": "cone"}, 'geometry.type "cone" is not supported'),
        ({"type": ["box"]}, 'geometry.type ["box"] is not supported'),
        ({}, "geometry.type is missing"),
        ({"type": "box"}, "geometry.lengths is missing"),
        ({"type": "box", "lengths": [1, 2]}, "geometry.lengths has 2 numbers, not 3"),
        ({"type": "box", "lengths": {"x": 1}}, 'geometry.lengths must be a number, not {"x": 1}'),
        ({"type": "sphere", "radius": "1"}, 'geometry.radius must be a number, not "1"'),
        ({"type": "cylinder", "radius": 1}, "geometry.length is missing"),
        ({"type": "ellipsoid", "radii": [1, 2, "3"]}, 'geometry.radii must be a number, not "3"'),
        ({**BOX, "color": [1, 1]}, "geometry.color must be a list of 4 numbers, not [1, 1]"),
        ({**BOX, "color": [1, 1, None]}, "geometry.color must be a number, not null"),
        ({**BOX, "transform": [1]}, "geometry.transform must be an object with translation and quaternion, not [1]"),
        ({**BOX, "transform": {"quaternion": [1]}}, "geometry.transform.quaternion has 1 numbers, not 4"),
        ({"type": "mesh_data", "vertices": []}, "geometry.faces is missing"),
        ({"type": "mesh_data", **TRIANGLE, "faces": [[0, 1]]}, "geometry.faces has rows of 2, not rows of 3 numbers"),
        (
            {"type": "mesh_data", **TRIANGLE, "faces": [[0, 1, 3]]},
            "geometry.faces has 3 in row 0, but there are 3 vertices",
        ),
        (
            {"type": "mesh_data", **TRIANGLE, "faces": [[0, 1, -1]]},
            "geometry.faces has -1 in row 0, but there are 3 vertices",
        ),
        (
            {"type": "mesh_data", **TRIANGLE, "faces": [[0, 1, 0.5]]},
            "geometry.faces has 0.5 in row 0, but there are 3 vertices",
        ),
        (
            {"type": "mesh_data", **TRIANGLE, "faces": [[0, 1, NAN]]},
            "geometry.faces has nan in row 0, but there are 3 vertices",
        ),
        (
            {"type": "mesh_data", **TRIANGLE, "faces": [[0, 1, "2"]]},
            "geometry.faces has something that is not a number",
        ),
        ({"type": "mesh_data", **TRIANGLE, "faces": {}}, "geometry.faces must be a list of rows of 3 numbers"),
        ({"type": "pointcloud"}, "geometry.points is missing"),
        ({"type": "pointcloud", "points": [[0, 0]]}, "geometry.points has rows of 2, not rows of 3 numbers"),
        ({"type": "pointcloud", "points": [1, 2, 3]}, "geometry.points has numbers, not rows of 3 numbers"),
        (
            {"type": "pointcloud", "points": [[0, 0, 0], [1]]},
            "geometry.points has 1 number in row 1, rows of 3 are wanted",
        ),
        ({"type": "pointcloud", "points": [[[0]]]}, "geometry.points has rows of 1, not rows of 3 numbers"),
        ({"type": "pointcloud", "points": [[0, 0, None]]}, "geometry.points has something that is not a number"),
        ({"type": "planar_lidar", "ranges": [1], "angle_start": 0}, "geometry.angle_step is missing"),
        (
            {"type": "planar_lidar", "ranges": [[1, 2]], "angle_start": 0, "angle_step": 1},
            "geometry.ranges has rows of 2, not numbers",
        ),
        ({"type": "line"}, "geometry.points is missing"),
        (
            {"type": "line", "points": [[0, 0, 0], [1, 1, 1]], "head_radius": "x"},
            'geometry.head_radius must be a number, not "x"',
        ),
        ({"type": "mesh_file"}, "geometry.filename is missing"),
        ({"type": "mesh_file", "filename": 5}, "geometry.filename must be a string, not 5"),
        ({"type": "mesh_file", "filename": "a.obj"}, "geometry.filename: no folder of mesh files is open to clients"),
    ],
)
def test_bad_geometry_fails_alone_and_with_a_reason(viewer: Viewer, geometry: dict[str, Any], reason: str) -> None:
    viewer.set({"type": "sphere", "radius": 9}, path=["bad"])
    answer = viewer.tell(
        {
            "setgeometry": [
                {"path": ["before"], "geometry": BOX},
                {"path": ["bad"], "geometry": geometry},
                {"path": ["after"], "geometry": BOX},
            ]
        }
    )
    assert answer["status"] == -3
    assert answer["errors"] == [{"command": "setgeometry", "index": 1, "path": ["bad"], "reason": reason}]
    assert answer["error"] == f"setgeometry[1] ['bad']: {reason}"
    assert answer["added_geometries"] == [["before"], ["after"]]
    assert [part.shape for part in viewer.parts("bad")] == [Sphere(9)], "what was there stays"


def test_one_bad_geometry_of_several_refuses_the_command_and_says_which(viewer: Viewer) -> None:
    answer = viewer.set(BOX, {"type": "cone"})
    assert answer["errors"][0]["reason"] == 'geometries[1].type "cone" is not supported'
    assert not viewer.paths()


@pytest.mark.parametrize(
    ("color", "expected"),
    [
        ([0.5, 0, 1], (0.5, 0, 1, 1)),
        ([0.5, 0, 1, 0.25], (0.5, 0, 1, 0.25)),
        ([5, -1, NAN, 2], (1, 0, 0, 1)),
    ],
)
def test_colours_are_clamped_and_meant_as_displays_show_them(
    viewer: Viewer, color: list[float], expected: tuple[float, float, float, float]
) -> None:
    viewer.set({**BOX, "color": color})
    (part,) = viewer.parts()
    assert part.material is material(expected)
    r, g, b, a = part.material.base_color
    to_display = [1.055 * c ** (1 / 2.4) - 0.055 if c > 0.0031308 else c * 12.92 for c in (r, g, b)]
    assert [*to_display, a] == pytest.approx(expected)
    assert part.material.alpha_mode is (AlphaMode.BLEND if a < 1 else AlphaMode.OPAQUE)
    assert part.material.double_sided
    assert (part.material.metallic, part.material.roughness, part.material.point_size) == (0, 1, 2)


def test_each_geometry_keeps_its_own_colour_alpha_and_place(viewer: Viewer) -> None:
    viewer.set(
        {**BOX, "color": [1, 0, 0, 0.5]},
        {"type": "sphere", "radius": 1, "transform": {"translation": [1, 2, 3], "quaternion": [0, 2, 0, 0]}},
        {"type": "triad", "transform": {"quaternion": [0, 0, 0, 0]}},
    )
    box, sphere, triad = viewer.parts()
    assert (box.material.base_color[3], sphere.material.base_color[3]) == (0.5, 1)
    np.testing.assert_allclose(sphere.X_node_part, from_pose((1, 2, 3), (0, 1, 0, 0)))
    np.testing.assert_array_equal(triad.X_node_part, np.eye(4))


# --- lines


def test_a_line_has_the_documents_defaults(viewer: Viewer) -> None:
    viewer.set({"type": "line", "points": [[0, 0, 0], [1, 2, 3]]})
    line = viewer.parts()[0].shape
    assert isinstance(line, Line)
    assert (line.radius, line.closed, line.start_head, line.end_head) == (0.01, False, False, False)
    assert (line.head_radius, line.head_length) == (0.05, 0.05)
    np.testing.assert_array_equal(line.points, np.array([[0, 0, 0], [1, 2, 3]], np.float32))


def test_a_line_takes_all_fields(viewer: Viewer) -> None:
    fields = {"radius": False, "closed": 1, "start_head": True, "end_head": True, "head_radius": 0.2}
    viewer.set({"type": "line", "points": [[0, 0, 0], [1, 2, 3], [4, 4, 4]], **fields})
    line = viewer.parts()[0].shape
    assert isinstance(line, Line)
    assert (line.radius, line.closed, line.start_head, line.end_head) == (0.0, True, True, True)
    assert (line.head_radius, line.head_length) == (0.2, 0.2), "head_length defaults to head_radius"


@pytest.mark.parametrize("points", [[], [[0, 0, 0]], [[0, 0, 0], [NAN, 0, 0]]])
def test_a_line_without_a_segment_draws_nothing(viewer: Viewer, points: list[Any]) -> None:
    assert viewer.set({"type": "line", "points": points})["status"] == 0
    assert viewer.parts() == ()


# --- points


def cloud_of(viewer: Viewer) -> PointCloud:
    shape = viewer.parts()[0].shape
    assert isinstance(shape, PointCloud)
    return shape


def test_a_cloud_keeps_all_channels(viewer: Viewer) -> None:
    channels = {
        "rgb": [[1, 0, 0], [0, 9, 0], [NAN, 0, -1]],
        "intensity": [0, 0.5, 2],
        "range": [7, 8, 9],
        "uv": [[1, 2]] * 3,
    }
    answer = viewer.set({**CLOUD, "channels": channels, "color": [0.2, 0.2, 0.2, 0.7]})
    assert "warnings" not in answer
    cloud = cloud_of(viewer)
    np.testing.assert_array_equal(cloud.channels["rgb"], np.array([[1, 0, 0], [0, 1, 0], [0, 0, 0]], np.float32))
    np.testing.assert_array_equal(cloud.channels["intensity"], np.array([0, 0.5, 1], np.float32))
    np.testing.assert_array_equal(cloud.channels["range"], np.array([7, 8, 9], np.float32))
    assert cloud.channels["uv"].shape == (3, 2)
    assert viewer.parts()[0].material is material((1.0, 1.0, 1.0, 0.7)), "channels give the colour, color the alpha"


@pytest.mark.parametrize("channels", [None, [], {}, {"rgb": []}, {"rgb": None, "intensity": {}}])
def test_empty_channels_are_none(viewer: Viewer, channels: Any) -> None:
    answer = viewer.set({**CLOUD, "channels": channels, "color": [0.2, 0.2, 0.2]})
    assert (answer["status"], answer.get("warnings")) == (0, None)
    assert dict(cloud_of(viewer).channels) == {}
    assert viewer.parts()[0].material is material((0.2, 0.2, 0.2, 1.0))


@pytest.mark.parametrize(
    ("channels", "warning"),
    [
        ({"rgb": [[1, 0, 0]]}, 'channel "rgb" has 1 values for 3 points; it is ignored'),
        ({"rgb": [1, 2, 3]}, 'channel "rgb" has numbers, not rows of 3 or 4 numbers; it is ignored'),
        ({"intensity": ["a"] * 3}, 'channel "intensity" has something that is not a number; it is ignored'),
        ({"x": "y"}, 'channel "x" must be a list of'),
        ("red", 'channels is not an object but "red"; it is ignored'),
    ],
)
def test_channels_that_do_not_fit_are_warned_about(viewer: Viewer, channels: Any, warning: str) -> None:
    answer = viewer.set({**CLOUD, "channels": channels})
    assert answer["status"] == 0
    assert warning in answer["warnings"][0]
    assert dict(cloud_of(viewer).channels) == {}


def test_points_that_are_nowhere_are_left_out_with_their_channels(viewer: Viewer) -> None:
    viewer.set(
        {
            "type": "pointcloud",
            "points": [[0, 0, 0], [NAN, 0, 0], [1, 1, 1], [INF, 0, 0], [1e300, 0, 0]],
            "channels": {"intensity": [0.1, 0.2, 0.3, 0.4, 0.5]},
        }
    )
    cloud = cloud_of(viewer)
    np.testing.assert_array_equal(cloud.points, np.array([[0, 0, 0], [1, 1, 1]], np.float32))
    np.testing.assert_array_equal(cloud.channels["intensity"], np.array([0.1, 0.3], np.float32))


def test_a_lidar_has_one_angle_for_each_range(viewer: Viewer) -> None:
    viewer.set({"type": "planar_lidar", "ranges": [1, 2, 1, INF], "angle_start": 0.1, "angle_step": 0.1})
    angles = 0.1 + 0.1 * np.arange(3)
    expected = np.array([1, 2, 1])[:, None] * np.stack((np.cos(angles), np.sin(angles), 0 * angles), axis=1)
    np.testing.assert_allclose(cloud_of(viewer).points, expected, atol=1e-6)
    assert viewer.parts()[0].kind == "planar_lidar"


# --- meshes


def mesh_of(viewer: Viewer) -> Mesh:
    shape = viewer.parts()[0].shape
    assert isinstance(shape, Surface)
    return shape.mesh


@pytest.mark.parametrize("faces", [[[0, 1, 2]], [[0.0, 1.0, 2.0]]])
def test_mesh_data(viewer: Viewer, faces: list[Any]) -> None:
    viewer.set({"type": "mesh_data", **TRIANGLE, "faces": faces})
    mesh = mesh_of(viewer)
    np.testing.assert_array_equal(mesh.positions[mesh.elements[0]], np.array(TRIANGLE["vertices"], np.float32))
    assert mesh.normals is not None
    np.testing.assert_allclose(mesh.normals, np.tile((0, 0, 1), (3, 1)))


@pytest.mark.parametrize("mesh", [{"vertices": [], "faces": []}, {**TRIANGLE, "faces": []}])
def test_a_mesh_without_faces_draws_nothing(viewer: Viewer, mesh: dict[str, Any]) -> None:
    assert viewer.set({"type": "mesh_data", **mesh})["status"] == 0
    assert viewer.parts() == ()


def test_faces_with_vertices_that_are_nowhere_are_left_out(viewer: Viewer) -> None:
    vertices = [*TRIANGLE["vertices"], [NAN, 0, 0]]
    answer = viewer.set({"type": "mesh_data", "vertices": vertices, "faces": [[0, 1, 2], [0, 1, 3]]})
    assert "1 vertices are not finite" in answer["warnings"][0]
    assert len(mesh_of(viewer).elements) == 1
    assert np.isfinite(mesh_of(viewer).positions).all()


def test_normals_are_smooth_up_to_creases_of_45_degrees() -> None:
    def roof(angle: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        c, s = np.cos(angle), np.sin(angle)
        positions = np.array([[0, 0, 0], [0, 1, 0], [-1, 0, 0], [c, 0, -s], [9, 9, 9]], np.float32)
        return smooth_mesh(positions, np.array([[0, 1, 2], [0, 3, 1]], np.uint32))

    gentle, elements, normals = roof(np.radians(44))
    assert len(gentle) == 4, "the vertices of the ridge are shared, the unused one is left out"
    ridge = normals[elements[0, 0]]
    np.testing.assert_allclose(ridge, (np.sin(np.radians(22)), 0, np.cos(np.radians(22))), atol=1e-6)
    sharp, elements, normals = roof(np.radians(46))
    assert len(sharp) == 6
    np.testing.assert_allclose(normals[elements[0]], np.tile((0, 0, 1), (3, 1)), atol=1e-6)


def test_normals_of_many_and_of_flat_faces_are_unit_vectors() -> None:
    count = 600
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    rim = np.stack((np.cos(angle), np.sin(angle), 0.01 * np.cos(9 * angle)), axis=1)
    positions = np.concatenate((np.zeros((1, 3)), rim, np.zeros((1, 3)))).astype(np.float32)
    index = np.arange(count, dtype=np.uint32)
    fan = np.stack((np.zeros_like(index), index + 1, (index + 1) % count + 1), axis=1).astype(np.uint32)
    faces = np.concatenate((fan, np.array([[0, 0, 0], [0, count + 1, 1]], np.uint32)))
    placed, elements, normals = smooth_mesh(positions, faces)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-6)
    np.testing.assert_array_equal(placed[elements], positions[faces])


@pytest.mark.parametrize("height", [0.02, 1.0], ids=["gentle", "steep"])
def test_the_short_way_to_normals_gives_the_very_same(height: float) -> None:
    """Hills without creases take it, hills with creases do not; with vertices that no face uses neither."""
    side = 40
    y, x = np.mgrid[0:side, 0:side].astype(np.float32) / side
    z = height * np.random.default_rng(3).random((side, side), np.float32) / (1.0 if height > 0.5 else side)
    positions = np.stack((x, y, z), axis=-1).reshape(-1, 3)
    a = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    faces = np.concatenate((np.stack((a, a + 1, a + side), 1), np.stack((a + 1, a + side + 1, a + side), 1)))
    faces = faces.astype(np.uint32)
    placed, normals, elements = smoothed(positions, faces, CREASE_COSINE)
    assert (len(placed) == len(positions)) is (height < 0.5)
    for found, wanted in zip(smooth_mesh(positions, faces), (placed, elements, normals), strict=True):
        np.testing.assert_array_equal(found, wanted)
    more = np.concatenate((positions, np.ones((3, 3), np.float32)))
    for found, wanted in zip(smooth_mesh(more, faces), (placed, elements, normals), strict=True):
        np.testing.assert_array_equal(found, wanted)


# --- files


class Files:
    """Two parts, red and plain."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, tuple[float, float, float]]] = []

    def load(self, filename: str, scale: tuple[float, float, float]) -> tuple[Part, ...]:
        self.asked.append((filename, scale))
        if filename == "missing.obj":
            raise FileNotFoundError("missing.obj does not exist")
        if filename == "broken.obj":
            raise ValueError("broken.obj is \ud800 broken")
        return (Part(Sphere(1), Material(base_color=(1, 0, 0, 0.5)), scaling(*scale)), Part(Sphere(2), Material()))


@pytest.mark.parametrize(
    ("scale", "asked"), [(None, (1, 1, 1)), (2, (2, 2, 2)), ([2], (2, 2, 2)), ([1, 2, 3], (1, 2, 3)), (True, (1, 1, 1))]
)
def test_a_mesh_file_may_be_scaled_by_one_number_or_three(scale: Any, asked: tuple[float, ...]) -> None:
    files = Files()
    viewer = Viewer(meshes=files)
    assert viewer.set({"type": "mesh_file", "filename": "a.obj", "scale": scale})["status"] == 0
    assert files.asked == [("a.obj", asked)]
    assert [part.kind for part in viewer.parts()] == ["mesh_file"] * 2
    assert [part.source for part in viewer.parts()] == ["a.obj"] * 2


@pytest.mark.parametrize("scale", [[1, 2], "x", [None]])
def test_a_bad_scale_is_refused(scale: Any) -> None:
    answer = Viewer(meshes=Files()).set({"type": "mesh_file", "filename": "a.obj", "scale": scale})
    assert answer["status"] == -3
    assert answer["errors"][0]["reason"] == f"geometry.scale must be a number or three, not {json.dumps(scale)}"


def test_a_files_parts_are_tinted_and_placed() -> None:
    viewer = Viewer(meshes=Files())
    viewer.set(
        {
            "type": "mesh_file",
            "filename": "a.obj",
            "scale": 2,
            "color": [1, 1, 0, 0.5],
            "transform": {"translation": [1, 2, 3]},
        }
    )
    red, plain = viewer.parts()
    assert red.material.base_color == (1, 0, 0, 0.25)
    assert plain.material.base_color == (1, 1, 0, 0.5)
    assert plain.material.alpha_mode is AlphaMode.BLEND
    np.testing.assert_array_equal(red.X_node_part, from_pose((1, 2, 3), (1, 0, 0, 0)) @ scaling(2, 2, 2))
    viewer.set({"type": "mesh_file", "filename": "a.obj", "color": [1, 1, 1, 1]})
    assert viewer.parts()[0].material.base_color == (1, 0, 0, 0.5), "white leaves the file's colours"


def test_a_missing_file_is_a_warning_and_a_broken_one_an_error() -> None:
    viewer = Viewer(meshes=Files())
    missing = viewer.set({"type": "mesh_file", "filename": "missing.obj"})
    assert (missing["status"], missing["added_geometries"]) == (0, [["it"]])
    assert "missing.obj does not exist, so nothing is drawn" in missing["warnings"][0]
    assert viewer.parts() == ()
    broken = viewer.set({"type": "mesh_file", "filename": "broken.obj"})
    assert broken["status"] == -3
    assert broken["errors"][0]["reason"] == "geometry.filename: broken.obj is ? broken"


# --- bounds


@pytest.mark.parametrize("count", [3, 200], ids=["short", "long enough to be taken out"])
@pytest.mark.parametrize(
    ("limits", "geometry", "reason"),
    [
        (Limits(points=2), {"type": "pointcloud", "points": [[0, 0, 0]]}, "points has {n} rows, the limit is 2"),
        (Limits(points=2), {"type": "line", "points": [[0, 0, 0]]}, "points has {n} rows, the limit is 2"),
        (
            Limits(points=2),
            {"type": "planar_lidar", "ranges": [1], "angle_start": 0, "angle_step": 1},
            "ranges has {n} rows",
        ),
        (Limits(vertices=2), {"type": "mesh_data", "vertices": [[0, 0, 0]], "faces": []}, "vertices has {n} rows"),
        (Limits(faces=2), {"type": "mesh_data", **TRIANGLE, "faces": [[0, 1, 2]]}, "faces has {n} rows"),
    ],
)
def test_sizes_are_bounded(limits: Limits, geometry: dict[str, Any], reason: str, count: int) -> None:
    grown = {
        k: v * count if isinstance(v, list) and k in ("points", "ranges", "faces") else v for k, v in geometry.items()
    }
    if geometry["type"] == "mesh_data" and limits.vertices == 2:
        grown["vertices"] = geometry["vertices"] * count
    if count == 200 and "ranges" in grown:
        grown["ranges"] = [1] * 300
        count = 300
    answer = Viewer(limits).set({**grown, "padding": " " * 5000})
    assert answer["status"] == -3
    assert reason.format(n=count) in answer["error"]


def test_the_number_of_channels_and_geometries_is_bounded() -> None:
    viewer = Viewer(Limits(channels=2, parts_per_path=2))
    assert (
        "channels has 3 entries, the limit is 2"
        in viewer.set({**CLOUD, "channels": {name: [] for name in "abc"}})["error"]
    )
    assert "geometries has 3 entries, the limit is 2" in viewer.set(BOX, BOX, BOX)["error"]
