"""All geometry types of the protocol with their fields, defaults, limits and oddities."""

from typing import Any

import numpy as np
import pytest

from gateway.scene.tree.geometry import Line, PointCloud, Surface
from gateway.scene.tree.materials import material
from gateway.scene.tree.transforms import IDENTITY, from_pose
from renderers.drawlist import AlphaMode
from scenegate.messages.geometry import Box, Capsule, Cylinder, Ellipsoid, Sphere, Triad
from tests.adapters.treeviewer.conversation import BOX, CLOUD, TRIANGLE, Viewer

NAN, INF = float("nan"), float("inf")
MESH = {"type": "mesh_data", **TRIANGLE}
LIDAR = {"type": "planar_lidar", "ranges": [1], "angle_start": 0}
LINE = {"type": "line", "points": [[0, 0, 0], [1, 1, 1]]}


@pytest.mark.parametrize("others", [[], [{"type": "sphere", "radius": "1"}]], ids=["all typed", "mixed"])
def test_unknown_fields_and_colours_above_one_are_warned_of(viewer: Viewer, others: list[Any]) -> None:
    box = {"type": "box", "lengths": [1, 2, 3], "radius": 4, "colour": "red", "color": [255, 128, 0, 1]}
    commands = [{"path": ["a"], "geometry": box}, *({"path": ["b"], "geometry": other} for other in others)]
    unknown, color = viewer.tell({"setgeometry": commands})["warnings"]
    assert all(name in unknown for name in ('"radius"', '"colour"'))
    assert "255" in color
    assert viewer.parts("a")[0].shape == Box((1, 2, 3))


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
        ({"type": "sphere", "radius": True}, Sphere(1)),
    ],
)
def test_solids(viewer: Viewer, geometry: dict[str, Any], shape: Any, color: Any) -> None:
    answer = viewer.publish(geometry if color is None else {**geometry, "color": color})
    assert answer["status"] == 0, answer
    assert ("warnings" in answer) == (color == [2, 0, 0, 0.5])
    (part,) = viewer.parts()
    assert part.shape == shape
    assert part.kind == geometry["type"]
    assert part.X_node_part is IDENTITY
    assert part.material is material((1.0, 0.0, 0.0, 0.5) if color == [2, 0, 0, 0.5] else (1.0, 1.0, 1.0, 1.0))


@pytest.mark.parametrize(
    ("geometry", "shape", "warning"),
    [
        ({"type": "box", "lengths": [-1, 2, 3]}, Box((1, 2, 3)), "lengths has a negative number, its absolute value"),
        ({"type": "box", "lengths": -2}, Box((2, 2, 2)), "lengths has a negative number, its absolute value is drawn"),
        ({"type": "ellipsoid", "radii": [1, 2, -3]}, Ellipsoid((1, 2, 3)), "radii has a negative number"),
        ({"type": "cylinder", "radius": 1, "length": -2}, Cylinder(1, 2), "length is -2, its absolute value is drawn"),
        ({"type": "capsule", "radius": 1, "length": -2}, Capsule(1, 2), "length is -2, its absolute value is drawn"),
        ({"type": "sphere", "radius": -1}, Sphere(0), "radius is -1, it counts as 0"),
        ({"type": "cylinder", "radius": -1, "length": 2}, Cylinder(0, 2), "radius is -1, it counts as 0"),
        ({**BOX, "color": [1, 0, 0, 0.5, 9]}, Box((1, 2, 3)), "color has 5 numbers, the first 4 are used"),
    ],
)
def test_odd_numbers_are_tolerated_with_a_warning(
    viewer: Viewer, geometry: dict[str, Any], shape: Any, warning: str
) -> None:
    answer = viewer.publish(geometry)
    assert (answer["status"], answer["added_geometries"]) == (0, [["it"]])
    assert answer["warnings"][0].startswith(f'setgeometry[0] ["it"]: {warning}')
    (part,) = viewer.parts()
    assert part.shape == shape
    assert part.material is material((1.0, 0.0, 0.0, 0.5) if "color" in geometry else (1.0, 1.0, 1.0, 1.0))


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
def test_warns_about_undrawable_geometry(viewer: Viewer, geometry: dict[str, Any]) -> None:
    answer = viewer.publish(geometry, BOX)
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
        ({**BOX, "color": [1, 1, 1, "0", 1]}, 'geometry.color must be a number, not "0"'),
        ({**BOX, "color": [1, 1, None]}, "geometry.color must be a number, not null"),
        ({**BOX, "transform": [1]}, "geometry.transform must be an object with translation and quaternion, not [1]"),
        ({**BOX, "transform": {"quaternion": [1]}}, "geometry.transform.quaternion has 1 numbers, not 4"),
        ({"type": "mesh_data", "vertices": []}, "geometry.faces is missing"),
        ({**MESH, "faces": [[0, 1]]}, "geometry.faces has rows of 2, not rows of 3 numbers"),
        ({**MESH, "faces": [[0, 1, 3]]}, "geometry.faces has 3 in row 0"),
        ({**MESH, "faces": [[0, 1, -1]]}, "geometry.faces has -1 in row 0"),
        ({**MESH, "faces": [[0, 1, 0.5]]}, "geometry.faces has 0.5 in row 0"),
        ({**MESH, "faces": [[0, 1, NAN]]}, "geometry.faces has nan in row 0"),
        ({**MESH, "faces": [[0, 1, None]]}, "geometry.faces has nan in row 0"),
        ({**MESH, "faces": [[0, 1, "2"]]}, "geometry.faces has something that is not a number"),
        ({**MESH, "faces": {}}, "geometry.faces must be a list of rows of 3 numbers"),
        ({"type": "pointcloud"}, "geometry.points is missing"),
        ({"type": "pointcloud", "points": [[0, 0]]}, "geometry.points has rows of 2, not rows of 3 numbers"),
        ({"type": "pointcloud", "points": [1, 2, 3]}, "geometry.points has numbers, not rows of 3 numbers"),
        ({"type": "pointcloud", "points": [[0, 0, 0], [1]]}, "geometry.points has 1 number in row 1"),
        ({"type": "pointcloud", "points": [[[0]]]}, "geometry.points has 3 dimensions, not rows of 3 numbers"),
        ({"type": "pointcloud", "points": [[0, 0, "1"]]}, "geometry.points has something that is not a number"),
        (LIDAR, "geometry.angle_step is missing"),
        ({**LIDAR, "ranges": [[1, 2]], "angle_step": 1}, "geometry.ranges has rows of 2, not numbers"),
        ({"type": "line"}, "geometry.points is missing"),
        ({**LINE, "head_radius": "x"}, 'geometry.head_radius must be a number, not "x"'),
        ({"type": "mesh_file"}, "geometry.filename is missing"),
        ({"type": "mesh_file", "filename": 5}, "geometry.filename must be a string, not 5"),
        ({"type": "mesh_file", "filename": "a.obj"}, "geometry.filename: no folder of mesh files is open to clients"),
    ],
)
def test_rejects_invalid_geometry(viewer: Viewer, geometry: dict[str, Any], reason: str) -> None:
    viewer.publish({"type": "sphere", "radius": 9}, path=["bad"])
    shapes = {"before": BOX, "bad": geometry, "after": BOX}
    answer = viewer.tell({"setgeometry": [{"path": [name], "geometry": shape} for name, shape in shapes.items()]})
    assert answer["status"] == -3
    (error,) = answer["errors"]
    assert (error["command"], error["index"], error["path"]) == ("setgeometry", 1, ["bad"])
    assert error["reason"].startswith(reason)
    assert answer["error"] == f'setgeometry[1] ["bad"]: {error["reason"]}'
    assert answer["added_geometries"] == [["before"], ["after"]]
    assert [part.shape for part in viewer.parts("bad")] == [Sphere(9)], "what was there stays"


def test_one_invalid_geometry_fails_the_command(viewer: Viewer) -> None:
    answer = viewer.publish(BOX, {"type": "cone"})
    assert answer["errors"][0]["reason"] == 'geometries[1].type "cone" is not supported'
    assert not viewer.paths()


@pytest.mark.parametrize(
    ("color", "expected"),
    [([0.5, 0, 1], (0.5, 0, 1, 1)), ([0.5, 0, 1, 0.25], (0.5, 0, 1, 0.25)), ([5, -1, NAN, 2], (1, 0, 0, 1))],
)
def test_clamps_srgb_colours(viewer: Viewer, color: list[float], expected: tuple[float, float, float, float]) -> None:
    viewer.publish({**BOX, "color": color})
    (part,) = viewer.parts()
    assert part.material is material(expected)
    r, g, b, a = part.material.base_color
    to_display = [1.055 * c ** (1 / 2.4) - 0.055 if c > 0.0031308 else c * 12.92 for c in (r, g, b)]
    assert [*to_display, a] == pytest.approx(expected)
    assert part.material.alpha_mode is (AlphaMode.BLEND if a < 1 else AlphaMode.OPAQUE)
    assert part.material.double_sided
    assert (part.material.metallic, part.material.roughness, part.material.point_size) == (0, 1, 2)


def test_geometries_keep_their_own_colour_and_transform(viewer: Viewer) -> None:
    viewer.publish(
        {**BOX, "color": [1, 0, 0, 0.5]},
        {"type": "sphere", "radius": 1, "transform": {"translation": [1, 2, 3], "quaternion": [0, 2, 0, 0]}},
        {"type": "triad", "transform": {"quaternion": [0, 0, 0, 0]}},
    )
    box, sphere, triad = viewer.parts()
    assert (box.material.base_color[3], sphere.material.base_color[3]) == (0.5, 1)
    np.testing.assert_allclose(sphere.X_node_part, from_pose((1, 2, 3), (0, 1, 0, 0)))
    np.testing.assert_array_equal(triad.X_node_part, np.eye(4))


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({}, (0.01, False, False, False, 0.05, 0.05)),
        (  # head_length defaults to head_radius
            {"radius": False, "closed": 1, "start_head": True, "end_head": True, "head_radius": 0.2},
            (0.0, True, True, True, 0.2, 0.2),
        ),
    ],
)
def test_a_line_has_the_documents_defaults(viewer: Viewer, fields: dict[str, Any], expected: tuple[Any, ...]) -> None:
    viewer.publish({"type": "line", "points": [[0, 0, 0], [1, 2, 3], [4, 4, 4]], **fields})
    it: Any = viewer.parts()[0].shape
    assert (it.radius, it.closed, it.start_head, it.end_head, it.head_radius, it.head_length) == expected
    np.testing.assert_array_equal(it.points, np.array([[0, 0, 0], [1, 2, 3], [4, 4, 4]], np.float32))


def test_a_line_warns_of_points_that_cannot_be_drawn(viewer: Viewer) -> None:
    answer = viewer.publish({"type": "line", "points": [[0, 0, 0], [NAN, 0, 0], [1e30, 0, 0], [1, 0, 0]]})
    assert "2 of 4 points are NaN, infinite or too far; the line joins the others" in answer["warnings"][0]
    line: Any = viewer.parts()[0].shape
    assert line.points.tolist() == [[0, 0, 0], [1, 0, 0]]


@pytest.mark.parametrize("points", [[], [[0, 0, 0]], [[0, 0, 0], [NAN, 0, 0]]])
def test_a_line_without_a_segment_draws_nothing(viewer: Viewer, points: list[Any]) -> None:
    assert viewer.publish({"type": "line", "points": points})["status"] == 0
    assert viewer.parts() == ()


SURVEYED = [[512345.678, 5412345.678, 312.5], [512347.678, 5412345.678, 312.5], [512345.678, 5412346.178, 312.5]]
"""Points in UTM coordinates, whose steps in float32 are 0.5 m."""


@pytest.mark.parametrize(
    "geometry",
    [
        {"type": "pointcloud", "points": SURVEYED},
        {"type": "line", "points": SURVEYED},
        {"type": "mesh_data", "vertices": SURVEYED, "faces": [[0, 1, 2]]},
    ],
)
def test_surveyed_coordinates_are_exact(geometry: dict[str, Any]) -> None:
    """Also beside a geometry whose points are not far away."""
    up = {"translation": [0, 0, 1], "quaternion": [1, 0, 0, 0]}
    viewer = Viewer()
    viewer.publish(CLOUD, geometry | {"transform": up}, CLOUD)
    first, part, last = viewer.parts()
    assert isinstance(part.shape, PointCloud | Line | Surface)
    points = part.shape.mesh.positions if isinstance(part.shape, Surface) else part.shape.points
    expected = np.add(SURVEYED, (0, 0, 1))
    np.testing.assert_allclose(points + part.X_node_part[:3, 3], expected, rtol=0, atol=1e-6)
    assert first.X_node_part is last.X_node_part is IDENTITY


def test_points_beyond_float32_are_left_out() -> None:
    """The difference of their coordinates is beyond float64."""
    viewer = Viewer()
    viewer.publish({"type": "pointcloud", "points": [[1.7e308, 0, 0], [-1.7e308, 0, 0], [1, 2, 3]]})
    (part,) = viewer.parts()
    assert isinstance(part.shape, PointCloud)
    np.testing.assert_array_equal(part.shape.points, [[1, 2, 3]])
