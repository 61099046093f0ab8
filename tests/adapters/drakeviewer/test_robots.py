"""Load and draw messages: names, poses, families, reloads, stale messages."""

import base64
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway.adapters.drakeviewer.channels import Channel, Kind
from gateway.adapters.drakeviewer.config import DrakeViewerConfig, Limits
from gateway.adapters.drakeviewer.wire import MessageError
from gateway.files.assets.mesh_files import MeshFiles
from gateway.scene.draw.flatten import flatten
from gateway.scene.tree.geometry import Surface
from gateway.scene.tree.transforms import from_pose
from renderers.color import linear_from_srgb
from scenegate.messages.geometry import Box, Capsule, Cylinder, Ellipsoid, Sphere
from tests.adapters.drakeviewer.conftest import Viewer
from tests.adapters.drakeviewer.encoding import (
    BOX,
    CAPSULE,
    CYLINDER,
    ELLIPSOID,
    IDENTITY,
    MESH,
    SPHERE,
    TETRAHEDRON,
    cloud,
    contacts,
    deformables,
    draw,
    geometry,
    link,
    load,
    point_contact,
)  # fmt: skip

LOAD, DRAW = "DRAKE_VIEWER_LOAD_ROBOT", "DRAKE_VIEWER_DRAW"
BALL = geometry(SPHERE, [0.5])
POSE = (1.0, 2.0, 3.0, 0.5, 0.5, 0.5, 0.5)
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
WITH_MATERIAL, RED = f"mtllib t.mtl\nusemtl red\n{OBJ}", "newmtl red\nKd 1 0 0\n"


def test_all_links_appear_in_one_revision_with_their_poses(viewer: Viewer) -> None:
    names = [f"arm::link {number}" for number in range(3000)]
    links: list[int] = []
    viewer.live.listen(
        lambda: links.append(sum(node.pose is not None for _, node in viewer.live.snapshot.root.walk() if node.parts))
    )
    for _ in range(2):
        viewer.handle(LOAD, load(*(link(name, 1, BALL) for name in names)))
        viewer.handle(DRAW, draw({(1, name): POSE for name in names}))
        names.append("arm::tool")
    assert links == [3000, 0, 3001]


def test_shapes_colors_and_their_poses(viewer: Viewer) -> None:
    sizes: dict[int, Any] = {
        SPHERE: [0.5],
        CYLINDER: [0.5, 2],
        CAPSULE: [0.25, 1],
        ELLIPSOID: [1, 2, 4],
        MESH: TETRAHEDRON,
    }
    box = geometry(BOX, [1, 2, 3], (0.5, 0.25, 1.5, 0.5), POSE)
    parts = viewer.show(box, *(geometry(kind, numbers) for kind, numbers in sizes.items()))
    solids = [Box((1, 2, 3)), Sphere(0.5), Cylinder(0.5, 2), Capsule(0.25, 1), Ellipsoid((1, 2, 4))]
    assert [part.shape for part in parts[:5]] == solids
    assert isinstance(parts[5].shape, Surface)
    assert len(parts[5].shape.mesh.elements) == 4
    assert parts[0].material.base_color == pytest.approx((linear_from_srgb(0.5), linear_from_srgb(0.25), 1.0, 0.5))
    np.testing.assert_allclose(parts[0].X_node_part, from_pose(POSE[:3], POSE[3:]), atol=1e-7)


@pytest.mark.parametrize(
    ("shape", "reason"),
    [
        (geometry(9, []), "geometry type 9 is unknown"),
        (geometry(BOX, [1, 2]), "a box has 2 numbers instead of 3"),
        (geometry(BOX, [1, float("nan"), 1]), "a box has the sizes [1.0, nan, 1.0]"),
        (geometry(SPHERE, [-1]), "a sphere has the sizes [-1.0]"),
        (geometry(SPHERE, [1], pose=(float("inf"), 0, 0, 1, 0, 0, 0)), "the pose of a geometry is not finite"),
        (geometry(MESH, [4.5, 1]), "which is not a number of vertices"),
        (geometry(MESH, [1, 1, 0, 0, 0, 0, 0, 5]), "has the vertices 0 to 5 of 1"),
        (geometry(MESH, [3, 1, 0]), "3 vertices and 1 triangles has 3 numbers"),
        (geometry(MESH, [1, 1, 1], string="/etc/passwd"), "no folder is open"),
        (geometry(MESH, [1, float("nan"), 1], string="t.obj"), "the scale of a mesh file is not finite"),
        (geometry(MESH, [2, 3], string="t.obj"), "a mesh file has 2 scale numbers instead of 0, 1 or 3"),
        (geometry(MESH, [1] * 4, string="t.obj"), "a mesh file has 4 scale numbers instead of 0, 1 or 3"),
        (geometry(MESH, [1, 1, 1], string="{}"), "mesh in memory cannot be read"),
        (geometry(MESH, [1, 1, 1], string="{[["), "mesh in memory cannot be read"),
    ],
)
def test_what_cannot_be_shown_is_left_out(viewer: Viewer, shape: bytes, reason: str) -> None:
    assert reason in viewer.problem(LOAD, load(link("world", 0, shape, BALL)))
    viewer.handle(DRAW, draw({}))
    assert len(viewer.node("illustration", "world").parts or ()) == 1


def test_families_are_apart_and_two_are_hidden(viewer: Viewer) -> None:
    inertia = "inertia_visualizer::InertiaVisualizer::arm::hand"
    viewer.handle(LOAD, load(link("plant::arm::hand", 2, BALL), link(inertia, 0, BALL)))
    viewer.handle(DRAW, draw({(2, "plant::arm::hand"): POSE, (0, inertia): POSE}))
    viewer.handle(f"{LOAD}_PROXIMITY", load(link("plant::arm::hand", 2, BALL)))
    viewer.handle(f"{DRAW}_PROXIMITY", draw({(2, "plant::arm::hand"): POSE}))
    assert viewer.paths() == [
        ("drake", "illustration", "plant", "arm", "hand"),
        ("drake", "inertia", "arm", "hand"),
        ("drake", "proximity", "plant", "arm", "hand"),
    ]
    visible = {name: viewer.node(name).visible for name in ("illustration", "inertia", "proximity")}
    assert visible == {"illustration": True, "inertia": False, "proximity": False}
    assert len(flatten(viewer.live.snapshot.root).instances) == 1, "images show the illustration only"


def test_a_family_keeps_its_visibility_when_loaded_again(viewer: Viewer) -> None:
    for name in ("a", "b"):
        viewer.handle(f"{LOAD}_PROXIMITY", load(link(name, 1, BALL)))
        viewer.handle(f"{DRAW}_PROXIMITY", draw({(1, name): POSE}))
        with viewer.live.edit() as edit:
            edit.set_visible(("drake", "proximity"), True)
    assert viewer.node("proximity").visible
    assert viewer.paths() == [("drake", "proximity", "b")]


def test_a_new_load_replaces_and_stale_draws_are_counted(viewer: Viewer) -> None:
    """``_ILLUSTRATION`` is the same family as no suffix."""
    two = draw({(1, "a"): POSE, (1, "b"): POSE})
    viewer.handle(f"{LOAD}_ILLUSTRATION", load(link("a", 1, BALL), link("b", 1, BALL)))
    viewer.handle(f"{DRAW}_ILLUSTRATION", two)
    assert len(viewer.paths()) == 2
    viewer.handle(LOAD, load(link("a", 1, BALL)))
    assert viewer.paths() == [], "the earlier links are gone at once"
    assert viewer.problem(DRAW, two) == "its 2 links are not the 1 that are loaded"
    assert viewer.families()["illustration"]["stale"] == 1
    assert viewer.problem(DRAW, draw({(1, "a"): POSE})) == ""
    assert viewer.paths() == [("drake", "illustration", "a")]


def test_a_first_draw_must_have_all_links(viewer: Viewer) -> None:
    assert "no load message was received" in viewer.problem(DRAW, draw({(1, "a"): POSE}))
    assert viewer.families()["illustration"]["unloaded"] == 1
    viewer.handle(LOAD, load(link("a", 1, BALL), link("b", 1, BALL)))
    assert "stale" in viewer.families()["illustration"]
    assert viewer.problem(DRAW, draw({(1, "a"): POSE})) == "its 1 links are not the 2 that are loaded"
    viewer.handle(DRAW, draw({(1, "a"): POSE, (1, "b"): POSE}))
    assert viewer.problem(DRAW, draw({(1, "a"): IDENTITY})) == "", "later ones may move some"
    assert viewer.node("illustration", "b").pose == POSE


def test_a_repeated_load_changes_nothing(viewer: Viewer) -> None:
    message = load(link("a", 1, BALL))
    viewer.handle(LOAD, message)
    viewer.handle(DRAW, draw({(1, "a"): POSE}))
    before = viewer.live.snapshot
    viewer.handle(LOAD, message)
    assert viewer.live.snapshot is before
    viewer.handle(LOAD, load(link("b", 1, BALL)))
    viewer.handle(LOAD, message)
    viewer.handle(DRAW, draw({(1, "a"): POSE}))
    assert viewer.paths() == [("drake", "illustration", "a")]


OF_A_SIMULATION = {
    "CONTACT_RESULTS": contacts([point_contact("a", "b", (0, 0, 0), (0, 0, 1))]),
    "DRAKE_DRAW_FRAMES": draw({(0, "frame"): POSE}),
    "DRAKE_POINT_CLOUD_CAMERA": cloud(
        np.zeros((2, 3), "<f4").tobytes(), 2, [("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1)], 12
    ),
}
"""Messages by channel, whose content belongs to the simulation that sent them."""


def test_what_arrives_while_a_load_is_read_belongs_to_the_new_simulation(viewer: Viewer) -> None:
    frame = draw({(0, "f"): IDENTITY})
    viewer.handle("DRAKE_DRAW_FRAMES_OLD", frame)
    loading = viewer.read(Channel(LOAD, Kind.LOAD, "illustration"), load(link("a", 1, BALL)))
    viewer.handle("DRAKE_DRAW_FRAMES_NEW", frame)
    viewer.apply(loading)
    assert viewer.paths() == [("drake", "frames", "NEW", "f")]
    viewer.handle(LOAD, load(link("b", 1, BALL)))
    assert viewer.paths() == []


def test_a_new_load_clears_what_the_last_simulation_left(viewer: Viewer) -> None:
    def start(name: str, milliseconds: int) -> None:
        viewer.handle(LOAD, load(link(name, 1, BALL)))
        viewer.handle(DRAW, draw({(1, name): POSE}, milliseconds))

    def send() -> None:
        for channel, message in OF_A_SIMULATION.items():
            viewer.handle(channel, message)

    start("a", 5000)
    send()
    everything = viewer.paths()
    assert len(everything) == 4
    viewer.handle(DRAW, draw({(1, "a"): POSE}, 4990))  # UDP swaps messages
    assert viewer.paths() == everything
    viewer.handle(LOAD, load(link("a", 1, BALL)))  # a repeated load message changes nothing by itself
    assert viewer.paths() == everything
    start("a", 0)  # the same simulation again
    assert viewer.paths() == [("drake", "illustration", "a")]
    send()
    assert sorted(map(str, viewer.paths())) == sorted(map(str, everything))
    start("b", 5000)
    assert viewer.paths() == [("drake", "illustration", "b")]
    send()
    assert len(viewer.paths()) == 4


@pytest.mark.parametrize(
    "deleted",
    [(), ("drake",), ("drake", "illustration", "plant"), ("drake", "illustration", "plant", "a")],
    ids=lambda path: "/".join(path) or "root",
)
def test_links_that_a_client_deleted_come_back_with_the_next_draw(viewer: Viewer, deleted: tuple[str, ...]) -> None:
    message = load(link("plant::a", 1, BALL), link("plant::b", 1, BALL), link("scene::::InertiaVisualizer::a", 2, BALL))
    poses = dict.fromkeys(((1, "plant::a"), (1, "plant::b"), (2, "scene::::InertiaVisualizer::a")), POSE)
    viewer.handle(LOAD, message)
    viewer.handle(DRAW, draw(poses))
    before = viewer.paths()
    with viewer.live.edit() as edit:
        assert edit.delete(deleted)
    viewer.handle(LOAD, message)  # a repeated load message changes nothing by itself
    assert viewer.problem(DRAW, draw(poses)) == ""
    assert viewer.paths() == before
    assert viewer.node("illustration", "plant", "a").pose == POSE
    assert viewer.node("illustration").visible
    assert not viewer.node("inertia").visible


def test_only_moved_links_are_edited(viewer: Viewer) -> None:
    viewer.handle(LOAD, load(link("a", 1, BALL), link("b", 1, BALL)))
    viewer.handle(DRAW, draw({(1, "a"): POSE, (1, "b"): POSE}))
    resting = viewer.node("illustration", "b")
    viewer.handle(DRAW, draw({(1, "a"): IDENTITY, (1, "b"): POSE}))
    assert viewer.node("illustration", "b") is resting
    assert viewer.node("illustration", "a").pose == IDENTITY


def test_links_with_equal_or_nested_names_have_their_own_nodes(viewer: Viewer) -> None:
    names = [(1, "arm"), (2, "arm::hand"), (3, "twin"), (4, "twin"), (5, "")]
    viewer.handle(LOAD, load(*(link(name, robot, BALL) for robot, name in names)))
    assert viewer.paths() == [], "shown with the first poses"
    viewer.handle(DRAW, draw({key: (float(key[0]), 0, 0, 1, 0, 0, 0) for key in names}))
    root = viewer.live.snapshot.root
    worlds = {path[2:]: root.world_matrix(path) for path in viewer.paths()}
    paths = ("arm", "body"), ("arm", "hand"), ("twin(3)",), ("twin(4)",), ("",)
    assert {path: X[0, 3] for path, X in worlds.items() if X is not None} == dict(zip(paths, range(1, 6), strict=True))


def test_unusual_poses(viewer: Viewer) -> None:
    viewer.handle(LOAD, load(link("a", 1, BALL)))
    viewer.handle(DRAW, draw({(1, "a"): (np.nan, 0, 0, 1, 0, 0, 0)}))
    assert flatten(viewer.live.snapshot.root).instances == ()
    viewer.handle(DRAW, draw({(1, "a"): (0, 0, 0, 0, 0, 0, 0)}))
    assert len(flatten(viewer.live.snapshot.root).instances) == 1
    viewer.handle(DRAW, draw({(1, "a"): IDENTITY})[:-4] + bytes.fromhex("7fa00000"))  # a signalling NaN
    assert flatten(viewer.live.snapshot.root).instances == ()


def in_memory(obj: str, supporting: object = None, scale: tuple[float, float, float] = (1, 1, 1)) -> bytes:
    files = {"mesh_file": coded(obj, "t.obj"), "supporting_files": {} if supporting is None else {"t.mtl": supporting}}
    return geometry(MESH, scale, string=json.dumps({"in_memory_mesh": files}))


def coded(content: str, name: str) -> dict[str, str]:
    code = base64.b64encode(content.encode()).decode()
    return {"contents": code, "extension": Path(name).suffix, "filename_hint": name}


def test_mesh_in_memory(viewer: Viewer) -> None:
    (part,) = viewer.show(in_memory(OBJ, scale=(2, 3, 4)))
    assert part.source == "t.obj"
    assert part.material.base_color == pytest.approx((1.0, linear_from_srgb(0.5), 0.0, 1.0))
    np.testing.assert_allclose(np.diag(part.X_node_part), [2, 3, 4, 1])
    (part,) = viewer.show(in_memory(WITH_MATERIAL, coded(RED, "t.mtl")))
    assert part.material.base_color == pytest.approx((1.0, 0.0, 0.0, 1.0)), "its own, not the geometry's"


def test_supporting_files_of_a_mesh_in_memory(tmp_path: Path) -> None:
    inside, outside = tmp_path / "open", tmp_path / "secret"
    for folder in (inside, outside):
        folder.mkdir()
        (folder / "t.mtl").write_text(RED)
    viewer = Viewer(MeshFiles((inside,)))
    colors = []
    for folder in (inside, outside):
        viewer.handle(LOAD, load(link("world", 0, in_memory(WITH_MATERIAL, {"path": str(folder / "t.mtl")}))))
        viewer.handle(DRAW, draw({}))
        (part,) = viewer.node("illustration", "world").parts or ()
        colors.append(part.material.base_color)
    assert colors[0] == pytest.approx((1.0, 0.0, 0.0, 1.0))
    assert colors[1] != colors[0], "a file outside of the open folders is not read"


def test_files_below_the_mesh_root(tmp_path: Path) -> None:
    path, viewer = tmp_path / "t.obj", Viewer(MeshFiles((tmp_path,)))
    mesh = geometry(MESH, [1, 1, 2], string=str(path))
    path.write_text(OBJ)
    (part,) = viewer.show(mesh)
    assert (part.kind, part.X_node_part[2, 2]) == ("mesh_file", 2.0)
    path.write_text(OBJ.replace("v 0 0 1", "v 0 0 5"))
    (part,) = viewer.show(mesh)
    assert isinstance(part.shape, Surface)
    assert part.shape.mesh.positions.max() == 5.0, "a changed file is loaded again"
    outside = load(link("world", 0, geometry(MESH, [1, 1, 1], string="/etc/passwd")))
    assert "lies outside" in viewer.problem(LOAD, outside)


@pytest.mark.parametrize(("numbers", "scale"), [([], (1, 1, 1)), ([2], (2, 2, 2)), ([2, 3, 4], (2, 3, 4))])
def test_a_mesh_file_has_the_messages_scale_and_without_a_material_its_color(
    numbers: list[float], scale: tuple[float, ...], tmp_path: Path
) -> None:
    (tmp_path / "t.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n")
    shape = geometry(MESH, numbers, string=str(tmp_path / "t.obj"), color=(0.2, 0.4, 0.6, 1.0))
    (part,) = Viewer(MeshFiles((tmp_path,))).show(shape)
    assert part.X_node_part.diagonal().tolist() == [*scale, 1]
    assert part.material.base_color == pytest.approx((*map(linear_from_srgb, (0.2, 0.4, 0.6)), 1.0), abs=1e-6)
    assert part.material.base_color_texture is None


def test_names_have_few_elements(viewer: Viewer) -> None:
    name = "::".join("a" * 33)
    for channel, message in (
        (LOAD, load(link(name, 0, BALL))),
        ("DRAKE_DRAW_FRAMES", draw({(0, name): IDENTITY})),
        ("DRAKE_VIEWER_DEFORMABLE", deformables(geometry(MESH, TETRAHEDRON, string=name))),
    ):
        with pytest.raises(MessageError, match=r"'a::a.* has 33 elements, the limit is 32"):
            viewer.handle(channel, message)
    assert viewer.live.snapshot.revision == 0


def test_nodes_of_all_channels_are_limited() -> None:
    viewer = Viewer(config=DrakeViewerConfig(nodes=12))
    three = load(*(link(f"plant::{name}", 0, BALL) for name in "abc"))
    viewer.handle(LOAD, three)  # drake, illustration, plant, a, b, c
    viewer.handle(DRAW, draw({(0, f"plant::{name}"): IDENTITY for name in "abc"}))
    frames = draw({(0, name): IDENTITY for name in "abc"})  # drake, frames, default, a, b, c
    viewer.handle("DRAKE_DRAW_FRAMES", frames)
    before = viewer.live.snapshot.root
    with pytest.raises(MessageError, match="would be 18, the limit is 12"):
        viewer.handle("DRAKE_DRAW_FRAMES_2", frames)
    with pytest.raises(MessageError, match="would be 13, the limit is 12"):
        viewer.handle(LOAD, load(*(link(f"plant::{name}", 0, BALL) for name in "abcd")))
    assert viewer.live.snapshot.root is before
    viewer.handle("DRAKE_DRAW_FRAMES", draw({(0, "a"): IDENTITY}))
    viewer.handle("DRAKE_VIEWER_LOAD_ROBOT_ILLUSTRATION", three)


def test_names_of_meshes_in_memory_are_limited(viewer: Viewer) -> None:
    for name, reason in ((4096, "is not base64"), (4097, "length <= 4096 .*filename_hint")):
        text = json.dumps({"in_memory_mesh": {"mesh_file": {"contents": "é", "filename_hint": "x" * name}}})
        problem = viewer.problem(LOAD, load(link("a", 0, geometry(MESH, [1, 1, 1], string=text))))
        assert re.search(reason, problem)
        assert len(problem) < 300


def test_names_of_deformable_bodies_are_limited() -> None:
    body = deformables(geometry(MESH, TETRAHEDRON, string="é" * 11), name="bodies")
    with pytest.raises(MessageError, match="has 22 bytes, the limit is 20"):
        Viewer(config=DrakeViewerConfig(limits=Limits(name_bytes=20))).handle("DRAKE_VIEWER_DEFORMABLE", body)


def test_time_of_the_simulation(viewer: Viewer) -> None:
    viewer.handle(LOAD, load(link("a", 0, BALL)))
    times = [viewer.state.simulation_seconds]
    for name, milliseconds in (("a", 2345), ("stale", 9999), ("a", 0)):  # at 0, the simulation starts again
        viewer.handle(DRAW, draw({(0, name): IDENTITY}, milliseconds=milliseconds))
        times.append(viewer.state.simulation_seconds)
    assert times == [None, 2.345, 2.345, 0.0]
