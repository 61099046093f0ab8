"""Triads of frames, and deformable bodies."""

import numpy as np
import pytest

from gateway.adapters.drakeviewer.channels import channel_of
from gateway.adapters.drakeviewer.config import DrakeViewerConfig
from gateway.adapters.drakeviewer.wire import MessageError
from gateway.scene.draw.bounds import instance_bounds
from gateway.scene.draw.flatten import flatten
from gateway.scene.tree.geometry import Surface
from tests.adapters.drakeviewer.conftest import Viewer
from tests.adapters.drakeviewer.encoding import IDENTITY, MESH, TETRAHEDRON, deformables, draw, geometry, link, load

FRAMES, DEFORMABLE = "DRAKE_DRAW_FRAMES", "DRAKE_VIEWER_DEFORMABLE"
JELLY = geometry(MESH, TETRAHEDRON, string="model::jelly")


def test_frames_are_triads(viewer: Viewer) -> None:
    viewer.handle(FRAMES, draw({(0, "goal::a"): (1, 2, 3, 1, 0, 0, 0)}))
    assert viewer.paths() == [("drake", "frames", "default", "goal", "a")]
    draws = flatten(viewer.live.snapshot.root)
    boxes = instance_bounds(draws.instances)
    for axis, (instance, box) in enumerate(zip(draws.instances, boxes, strict=True)):
        assert box is not None
        expected = np.full((2, 3), 0.01) * [[-1], [1]]
        expected[0, axis], expected[1, axis] = 0.0, 0.25
        np.testing.assert_allclose(box, expected + np.array((1, 2, 3)), atol=2e-4)
        assert instance.material.base_color == (*np.eye(3)[axis], 1.0)


def test_frames_move_and_are_replaced(viewer: Viewer) -> None:
    viewer.handle(f"{FRAMES}_B", draw({(0, "a"): IDENTITY, (0, "b"): IDENTITY}))
    viewer.handle(f"{FRAMES}_B", draw({(0, "a"): IDENTITY, (0, "b"): (1, 0, 0, 1, 0, 0, 0)}))
    assert viewer.node("frames", "B", "b").pose == (1, 0, 0, 1, 0, 0, 0)
    viewer.handle(f"{FRAMES}_B", draw({(0, "c"): IDENTITY}))
    assert viewer.paths() == [("drake", "frames", "B", "c")]


def test_frames_that_a_client_deleted_come_back(viewer: Viewer) -> None:
    for _ in range(2):
        viewer.handle(FRAMES, draw({(0, "a"): IDENTITY}))
        assert len(viewer.node("frames", "default", "a").parts or ()) == 3
        with viewer.live.edit() as edit:
            edit.delete(())


def test_refused_frames_take_no_memory() -> None:
    viewer = Viewer(config=DrakeViewerConfig(nodes=4))
    with pytest.raises(MessageError, match=r"nodes .*6.* 4$"):
        viewer.handle(FRAMES, draw({(0, name): IDENTITY for name in "abc"}))
    assert not viewer.state.frames


def test_frames_that_are_read_while_they_are_cleared_are_counted(viewer: Viewer) -> None:
    channel, message = channel_of(FRAMES), draw({(0, "a"): IDENTITY})
    assert channel is not None
    viewer.apply(viewer.read(channel, message))
    show = viewer.read(channel, message)
    viewer.handle("DRAKE_VIEWER_LOAD_ROBOT", load(link("world", 0)))
    viewer.apply(show)
    assert viewer.state.node_counts[FRAMES] == len((*channel.node, "a"))
    assert viewer.node("frames", "default", "a").parts


def test_deformable_bodies_follow_their_vertices(viewer: Viewer) -> None:
    path = ("illustration", "deformable_geometries", "model", "jelly")
    viewer.handle(DEFORMABLE, deformables(JELLY))
    moved = np.array(TETRAHEDRON, float)
    moved[2:14] += 5.0
    viewer.handle(DEFORMABLE, deformables(geometry(MESH, moved.tolist(), (0, 0, 1, 0.5), string="model::jelly")))
    (part,) = viewer.node(*path).parts or ()
    assert isinstance(part.shape, Surface)
    vertices: set[tuple[float, ...]] = {tuple(row) for row in part.shape.mesh.positions.tolist()}
    assert vertices == {(5.0, 5.0, 5.0), (6.0, 5.0, 5.0), (5.0, 6.0, 5.0), (5.0, 5.0, 6.0)}
    assert part.material.base_color == (0.0, 0.0, 1.0, 0.5)
    viewer.handle(DEFORMABLE, deformables())
    assert viewer.paths() == []


def test_deformable_bodies_of_the_hidden_family(viewer: Viewer) -> None:
    viewer.handle(f"{DEFORMABLE}_PROXIMITY", deformables(JELLY))
    assert not viewer.node("proximity").visible
    assert flatten(viewer.live.snapshot.root).instances == ()


def test_a_load_removes_deformable_bodies_until_their_next_message(viewer: Viewer) -> None:
    viewer.handle(DEFORMABLE, deformables(JELLY))
    viewer.handle("DRAKE_VIEWER_LOAD_ROBOT", load(link("world", 0)))
    assert viewer.paths() == []
    viewer.handle(DEFORMABLE, deformables(JELLY))
    assert len(viewer.paths()) == 1


def test_poses_that_are_not_finite(viewer: Viewer) -> None:
    message = draw({(0, "a"): (float("nan"),) * 7, (0, "b"): IDENTITY})
    assert viewer.problem(FRAMES, message) == "1 of 2 poses are not finite"


NAN = float("nan")


@pytest.mark.parametrize(
    ("body", "problem"),
    [
        (geometry(MESH, [9, 9, 9], string="a"), "a mesh of 9 vertices"),
        (geometry(MESH, [*TETRAHEDRON[:2], *[NAN] * 12, *TETRAHEDRON[14:]], string="a"), "4 vertices are not finite"),
        (geometry(MESH, TETRAHEDRON, pose=(*IDENTITY[:6], NAN), string="a"), "the pose of a geometry is not finite"),
    ],
    ids=["numbers", "vertices", "pose"],
)
def test_a_body_that_cannot_be_shown_leaves_the_others(viewer: Viewer, body: bytes, problem: str) -> None:
    assert problem in viewer.problem(DEFORMABLE, deformables(body, geometry(MESH, TETRAHEDRON, string="b")))
    assert [path[-1] for path, node in viewer.live.snapshot.root.walk() if node.parts] == ["b"]
