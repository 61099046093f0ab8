"""Contact forces and surfaces, as Drake's own viewer draws them (pydrake.multibody.meshcat of Drake 1.51)."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.adapters.drakeviewer.config import DrakeViewerConfig
from gateway.adapters.drakeviewer.contacts import MAX_LENGTH, flame_colors
from gateway.adapters.drakeviewer.wire import MessageError
from gateway.scene.draw.bounds import instance_bounds
from gateway.scene.draw.flatten import flatten
from gateway.scene.tree.geometry import Part, Surface
from renderers.color import linear_from_srgb
from tests.adapters.drakeviewer.conftest import Viewer
from tests.adapters.drakeviewer.encoding import contacts, point_contact, surface_contact

CHANNEL = "CONTACT_RESULTS"


def ends(parts: tuple[Part, ...]) -> list[NDArray[np.float64]]:
    """Return the tips of an arrow's heads: the origins of its cones. The first part is the shaft."""
    return [part.X_node_part[:3, 3] for part in parts[1:]]


def shaft_size(part: Part) -> list[float]:
    """Return the radius and the length of a shaft, metres. Its mesh has a radius and a length of 1."""
    return [float(size) for size in np.linalg.norm(part.X_node_part[:3, 1:3], axis=0)]


def test_point_contact_is_a_green_arrow_with_two_heads(viewer: Viewer) -> None:
    viewer.handle(CHANNEL, contacts([point_contact("a", "b", (1, 2, 3), (0, 10, 0))]))
    parts = viewer.node("contacts", "point", "a+b").parts or ()
    assert len(parts) == 3
    assert shaft_size(parts[0]) == pytest.approx([0.002, 1.0])
    np.testing.assert_allclose(parts[0].X_node_part[:3, 2], (0, 1, 0), atol=1e-12)
    np.testing.assert_allclose(parts[0].X_node_part[:3, 3], (1, 2, 3), atol=1e-12)
    np.testing.assert_allclose(ends(parts), [(1, 2.504, 3), (1, 1.496, 3)], atol=1e-12)
    assert {part.material.base_color for part in parts} == {(0.0, 1.0, 0.0, 1.0)}


def test_heads_point_outwards(viewer: Viewer) -> None:
    viewer.handle(CHANNEL, contacts([point_contact("a", "b", (0, 0, 0), (0, 0, -20))]))
    boxes = [box for box in instance_bounds(flatten(viewer.live.snapshot.root).instances) if box is not None]
    low, high = np.min([box[0] for box in boxes], axis=0), np.max([box[1] for box in boxes], axis=0)
    np.testing.assert_allclose((low[2], high[2]), (-1.004, 1.004), atol=1e-6)
    np.testing.assert_allclose((low[0], high[0]), (-0.004, 0.004), atol=1e-4)


def test_contacts_that_end_disappear(viewer: Viewer) -> None:
    points = [point_contact("a", "b", (x, 0, 0), (0, 0, 1)) for x in (0, 1)]
    viewer.handle(CHANNEL, contacts(points, [surface_contact()]))
    assert len(viewer.paths()) == 2
    assert len(viewer.node("contacts", "point", "a+b").parts or ()) == 6
    viewer.handle(CHANNEL, contacts([point_contact("a", "c", (0, 0, 0), (0, 0, 1))]))
    assert viewer.paths() == [("drake", "contacts", "point", "a+c")]
    viewer.handle(CHANNEL, contacts())
    assert viewer.paths() == []
    before = viewer.live.snapshot
    viewer.handle(CHANNEL, contacts())
    assert viewer.live.snapshot is before


def test_small_forces_are_not_shown(viewer: Viewer) -> None:
    viewer.handle(CHANNEL, contacts([point_contact("a", "b", (0, 0, 0), (0, 0, 0.009))]))
    assert viewer.paths() == []


@pytest.mark.parametrize("x", [np.nan, np.inf])
def test_contacts_that_are_not_finite(viewer: Viewer, x: float) -> None:
    points = [
        point_contact("a", "b", point, force) for point, force in (((0, 0, 0), (x, 0, 0)), ((x, 0, 0), (1, 0, 0)))
    ]
    points.append(point_contact("a", "c", (0, 0, 0), (1, 0, 0)))
    problem = viewer.problem(CHANNEL, contacts(points))
    assert problem.startswith("2 of 3 point contacts")
    assert viewer.paths() == [("drake", "contacts", "point", "a+c")]
    problem = viewer.problem(CHANNEL, contacts(surfaces=[surface_contact(force=(x, 0, 0), moment=(0, 1, 0))]))
    assert problem.startswith("1 of 2 forces and moments")
    parts = viewer.node("contacts", "hydroelastic", "body1+body2").parts or ()
    assert [part.kind for part in parts] == ["arrow", "arrow", "contact_surface"]


def test_length_of_arrows_is_limited(viewer: Viewer) -> None:
    viewer.handle(CHANNEL, contacts([point_contact("a", "b", (0, 0, 0), (0, 0, 1e9))]))
    part = (viewer.node("contacts", "point", "a+b").parts or ())[0]
    assert shaft_size(part) == pytest.approx([0.002, MAX_LENGTH])


def test_hydroelastic_contact(viewer: Viewer) -> None:
    surface = surface_contact(centroid=(1, 2, 3), force=(0, 0, 20), moment=(0, 3, 0))
    viewer.handle(CHANNEL, contacts(surfaces=[surface]))
    parts = viewer.node("contacts", "hydroelastic", "body1+body2").parts or ()
    force, moment, pressure = parts[:2], parts[2:4], parts[4]
    assert shaft_size(force[0]) == pytest.approx([0.002, 2.0])
    assert shaft_size(moment[0]) == pytest.approx([0.002, 1.0])
    np.testing.assert_allclose(ends(force), [(1, 2, 5.004)], atol=1e-12)
    np.testing.assert_allclose(ends(moment), [(1, 3.004, 3)], atol=1e-12)
    assert force[0].material.base_color == (1.0, 0.0, 0.0, 1.0)
    assert moment[0].material.base_color == (0.0, 0.0, 1.0, 1.0)
    assert isinstance(pressure.shape, Surface)
    mesh = pressure.shape.mesh
    assert mesh.elements.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert mesh.colors is not None
    assert mesh.colors.tolist() == [[0, 0, 0, 1], [0, 0, 1, 1], [1, 0, 0, 1], [1, 1, 1, 1]]


def test_names_of_bodies_with_models_and_geometries(viewer: Viewer) -> None:
    bodies = ("box", "link", "left", False, 2), ("ball", "link", "right", False, 1)
    viewer.handle(CHANNEL, contacts(surfaces=[surface_contact(bodies)]))
    assert viewer.paths() == [("drake", "contacts", "hydroelastic", "left.link.box+right.link")]


def test_colors_between_those_of_the_scale() -> None:
    half = linear_from_srgb(0.5)
    found = flame_colors(np.array([0.0, 1.0, 3.0, 5.0, 7.0, 8.0]))
    expected = [(0, 0, 0), (0, 0, half), (half, 0, half), (1, half, 0), (1, 1, half), (1, 1, 1)]
    np.testing.assert_allclose(found[:, :3], expected, atol=1e-6)


@pytest.mark.parametrize("polygons", [(4, 0, 1, 2), (3, 0, 1, 9), (3, 0, 1, -1), (-2,)])
def test_a_damaged_surface_leaves_the_arrows(viewer: Viewer, polygons: tuple[int, ...]) -> None:
    message = contacts([point_contact("a", "b", (0, 0, 0), (0, 0, 1))], [surface_contact(polygons=polygons)])
    assert "a contact surface" in viewer.problem(CHANNEL, message)
    assert [part.kind for part in viewer.node("contacts", "hydroelastic", "body1+body2").parts or ()] == ["arrow"] * 2
    assert viewer.node("contacts", "point", "a+b").parts
    with pytest.raises(MessageError, match="refused: --strict"):
        Viewer(config=DrakeViewerConfig(strict=True)).handle(CHANNEL, message)


@pytest.mark.parametrize("x", [np.nan, np.inf, 1e39])
def test_vertices_that_are_not_finite_in_float32(viewer: Viewer, x: float) -> None:
    vertices = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (x, 1, 0))
    problem = viewer.problem(CHANNEL, contacts(surfaces=[surface_contact(vertices=vertices)]))
    assert problem.startswith("1 vertices are not finite")
    part: Any = (viewer.node("contacts", "hydroelastic", "body1+body2").parts or ())[-1]
    assert part.shape.mesh.elements.tolist() == [[0, 1, 2]]
