"""Whatever is edited and however many revisions a browser skips: it ends with the tree that there is."""

from __future__ import annotations

import asyncio
import gc
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.scene.geometry import Box, Part, PointCloud, Sphere, Surface
from gateway.scene.live import LiveTree, Snapshot
from gateway.scene.tree import Node, TreeEdit
from gateway.viewer.encoder import EMPTY, TURN_CHANGES, Encoder, encode_rig
from gateway.viewer.flow_control import Session
from gateway.viewer.frames import parse
from gateway.viewer.payloads import Payloads
from gateway.viewer.sources import Rig
from renderers.drawlist import AlphaMode, Image, Material, Mesh, Texture
from tests.viewer.model import Model, tree_of

MATERIAL = Material()
NAMES = st.sampled_from(["a", "b", 1, "1", "a/b", ""])
PATHS = st.lists(NAMES, min_size=0, max_size=3).map(tuple)
SHAPES = st.sampled_from([Box((1, 2, 3)), Sphere(1.0), Box((1, 1, 1))])
EDITS = st.one_of(
    st.tuples(st.just("parts"), PATHS, st.lists(SHAPES, max_size=2)),
    st.tuples(st.just("pose"), PATHS, st.floats(-10, 10, width=32)),
    st.tuples(st.just("matrix"), PATHS, st.floats(-10, 10, width=32)),
    st.tuples(st.just("visible"), PATHS, st.booleans()),
    st.tuples(st.just("delete"), PATHS, st.none()),
    st.tuples(st.just("subtree"), PATHS.filter(len), SHAPES),
)


def apply(edit: TreeEdit, kind: str, path: Any, value: Any) -> None:
    if kind == "parts":
        edit.set_parts(path, tuple(Part(shape, MATERIAL) for shape in value))
    elif kind == "pose":
        edit.set_pose(path, (value, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    elif kind == "matrix":
        matrix = np.eye(4)
        matrix[0, 3] = value + 0.5
        matrix[1, 1] = 2.0
        edit.set_matrix(path, matrix)
    elif kind == "visible":
        edit.set_visible(path, value)
    elif kind == "delete":
        edit.delete(path)
    else:
        edit.set_subtree(path, Node(children={"grown": Node((Part(value, MATERIAL),)), 7: Node()}))


class Browser:
    """A session and the model that it feeds."""

    def __init__(self, encoder: Encoder, payloads: Payloads) -> None:
        self.session = Session(encoder, payloads)
        self.payloads = payloads
        self.model = Model()

    def catch_up(self) -> None:
        if not self.session.behind:
            return
        update = asyncio.run(self.session.next_update())
        missing = self.session.missing(update)
        for number in missing:
            frame = self.payloads.mesh_frame(number)
            assert frame is not None
            self.model.take(frame)
        self.session.sent(missing)
        self.model.take(update.frame)


@settings(deadline=None, max_examples=150)
@given(
    st.lists(st.tuples(st.lists(EDITS, min_size=1, max_size=4), st.sets(st.integers(0, 2))), max_size=12),
    st.sampled_from([6, 1_000_000]),
)
def test_browsers_end_with_the_tree_that_there_is(steps: Any, max_paths: int) -> None:
    tree, payloads = LiveTree(), Payloads()
    encoder = Encoder(payloads, max_paths)
    browsers = [Browser(encoder, payloads) for _ in range(3)]
    for edits, awake in steps:
        with tree.edit() as edit:
            for kind, path, value in edits:
                apply(edit, kind, path, value)
        encoder.advance(tree.snapshot)
        for number in awake:
            browsers[number].catch_up()
    browsers.append(Browser(encoder, payloads))
    for browser in browsers:
        browser.catch_up()
        assert browser.model.tree() == tree_of(tree.snapshot.root)
        assert not browser.session.behind


def test_a_step_that_only_moves_names_no_path() -> None:
    tree, encoder = LiveTree(), Encoder(Payloads())
    with tree.edit() as edit:
        for number in range(5):
            edit.set_parts(("arm", number), (Part(Box((1, 1, 1)), MATERIAL),))
    encoder.advance(tree.snapshot)
    before = encoder.current
    for x in (1.0, 2.0):
        with tree.edit() as edit:
            edit.set_pose(("arm", 3), (x, 0, 0, 1, 0, 0, 0))
        encoder.advance(tree.snapshot)
    header, body = parse(asyncio.run(encoder.update(before))[0].frame)
    assert set(header) == {"kind", "from", "revision", "poses"}
    assert np.frombuffer(body, "<u4", 1).tolist() == [encoder.id_of(("arm", 3))]
    assert header["poses"]["values"][1] == 7


def test_updates_are_shared() -> None:
    tree, encoder = LiveTree(), Encoder(Payloads())
    with tree.edit() as edit:
        edit.set_parts(("a",), (Part(Sphere(1), MATERIAL),))
    encoder.advance(tree.snapshot)
    assert asyncio.run(encoder.update(EMPTY))[0] is asyncio.run(encoder.update(EMPTY))[0]


def many_boxes(count: int) -> Node:
    edit = TreeEdit(Node())
    for i in range(count):
        edit.set_parts(("boxes", i), (Part(Box((0.1, 0.1, 0.1 + i)), Material()),))
    return edit.commit()


async def test_others_have_their_turn_while_a_big_scene_is_encoded_and_it_may_change() -> None:
    encoder, turns = Encoder(Payloads()), 0
    first, later = Snapshot(many_boxes(400), 1), Snapshot(many_boxes(401), 2)
    encoder.advance(first)

    async def others() -> None:
        nonlocal turns
        while not encoding.done():
            turns += 1
            if turns == 3:
                encoder.advance(later)
            await asyncio.sleep(0)

    encoding = asyncio.create_task(encoder.update(EMPTY))
    same = asyncio.create_task(encoder.update(EMPTY))
    await others()
    update, leads_to = await encoding
    assert turns >= 400 // TURN_CHANGES
    assert leads_to is first
    header, _ = parse(update.frame)
    assert header["revision"] == 1
    assert len(header["nodes"]) == 401
    newest, leads_to = await same
    assert leads_to is later
    assert len(parse(newest.frame)[0]["nodes"]) == 402
    step, leads_to = await encoder.update(first)
    assert leads_to is later
    assert [node["name"] for node in parse(step.frame)[0]["nodes"] if "name" in node] == [400]


async def test_an_update_of_paths_that_were_numbered_anew_meanwhile_is_not_sent() -> None:
    encoder = Encoder(Payloads(), max_paths=450)
    encoder.advance(Snapshot(many_boxes(400), 1))
    session = Session(encoder, Payloads())
    sending = asyncio.create_task(session.next_update())
    await asyncio.sleep(0)
    encoder.advance(Snapshot(many_boxes(460), 2))
    assert encoder.epoch == 1
    header, _ = parse((await sending).frame)
    assert (header["from"], header["revision"], len(header["nodes"])) == (0, 2, 461)
    assert not session.behind


def test_numbers_beyond_float32_are_infinite_without_a_warning() -> None:
    tree, encoder = LiveTree(), Encoder(Payloads())
    with tree.edit() as edit:
        edit.set_pose(("pose",), (1e300, 0, 0, 1, 0, 0, 0))
        edit.set_matrix(("matrix",), np.diag([1e300, 1, 1, 1]))
    encoder.advance(tree.snapshot)
    model = Model()
    model.take(asyncio.run(encoder.update(EMPTY))[0].frame)
    tree_now = model.tree()
    assert tree_now["pose",][2][0] == np.inf
    assert tree_now["matrix",][2][0] == np.inf


def test_geometry_that_is_gone_is_let_go() -> None:
    tree, payloads = LiveTree(), Payloads()
    encoder = Encoder(payloads)
    gone: list[int] = []
    payloads.when_gone(gone.append)
    positions = np.zeros((3, 3), np.float32)
    with tree.edit() as edit:
        mesh = Mesh(positions, np.array([[0, 1, 2]], np.uint32))
        edit.set_parts(("deep", "mesh"), (Part(Surface(mesh), MATERIAL),))
    del mesh
    encoder.advance(tree.snapshot)
    browser = Browser(encoder, payloads)
    browser.catch_up()
    with tree.edit() as edit:
        edit.delete(("deep",))
    encoder.advance(tree.snapshot)
    browser.catch_up()
    del edit
    gc.collect()
    assert gone
    for frame in browser.session.forget(set(gone)):
        browser.model.take(frame)
    assert browser.model.meshes == set()


def test_materials_and_channels_are_told() -> None:
    tree, payloads = LiveTree(), Payloads()
    encoder = Encoder(payloads)
    points = np.array([[0, 0, 0], [np.nan, 0, 0], [1, 1, 1]], np.float32)
    channels = {
        "intensity": np.array([0, 5, 1], np.float32),
        "rgb": np.ones((3, 3), np.float32),
        "empty": np.zeros(0, np.float32),
    }
    glass = Material((1.0, 0.0, 0.0, 0.5), alpha_mode=AlphaMode.BLEND, point_size=3.0)
    with tree.edit() as edit:
        edit.set_parts(("cloud",), (Part(PointCloud(points, channels), glass, source="scan.ply"),))
    encoder.advance(tree.snapshot)
    header, _ = parse(asyncio.run(encoder.update(EMPTY))[0].frame)
    (part,) = next(entry for entry in header["nodes"] if entry["name"] == "cloud")["parts"]
    assert part["channels"] == {"intensity": 1, "rgb": 3}
    assert (part["points"], part["source"]) == (3, "scan.ply")
    (draw,) = part["draws"]
    color = draw["material"].pop("color")
    assert draw["material"] == {"alpha": "blend", "metallic": 1.0, "pointSize": 3.0}
    assert color == pytest.approx([1.0, 1.0, 1.0, 0.5]), "the channel rgb colours the points, only opacity is left"
    values = payloads.channel(draw["mesh"], "intensity")
    assert values is not None
    assert values.ravel().tolist() == [0.0, 1.0]
    assert payloads.channel(draw["mesh"], "empty") is None
    assert payloads.channel(999, "intensity") is None


def test_how_a_surface_is_cut_glows_and_reads_its_texture_is_told() -> None:
    tree, payloads = LiveTree(), Payloads()
    encoder = Encoder(payloads)
    image = Image(b"key", lambda: np.zeros((1, 1, 4), np.uint8))
    texture = Texture(image, uv_set=1, uv_transform=(2.0, 0.0, 0.5, 0.0, 3.0, 0.25))
    leaf = Material(base_color_texture=texture, emissive=(0.0, 0.5, 1.0), alpha_mode=AlphaMode.MASK, alpha_cutoff=0.25)
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    mesh = Mesh(corners, np.array([[0, 1, 2]], np.uint32), uv1=corners[:, :2].copy())
    with tree.edit() as edit:
        edit.set_parts(("leaf",), (Part(Surface(mesh), leaf),))
    encoder.advance(tree.snapshot)
    update = asyncio.run(encoder.update(EMPTY))[0]
    header, _ = parse(update.frame)
    (part,) = next(entry for entry in header["nodes"] if entry["name"] == "leaf")["parts"]
    material = part["draws"][0]["material"]
    assert (material["alpha"], material["cutoff"]) == ("mask", 0.25)
    assert material["emissive"] == pytest.approx([0.0, 0.735357, 1.0], abs=1e-5), "encoded as the colour is"
    assert material["texture"]["set"] == 1
    assert material["texture"]["transform"] == [2.0, 0.0, 0.5, 0.0, 3.0, 0.25]
    frame = payloads.mesh_frame(part["draws"][0]["mesh"])
    assert frame is not None
    head, body = parse(frame)
    offset, count = head["uv1"]
    assert np.frombuffer(body, np.float32, count, offset).tolist() == [0, 0, 1, 0, 0, 1]


def test_rig_is_column_major_or_nothing() -> None:
    pose = np.eye(4)
    pose[:3, 3] = 1, 2, 3
    header, _ = parse(encode_rig(Rig(pose, 640, 480, 500.0, 500.0, 320.0, 240.0, 0.16)))
    assert header["pose"][12:15] == [1.0, 2.0, 3.0]
    assert header["baseline"] == pytest.approx(0.16)
    pose[0, 0] = np.nan
    assert parse(encode_rig(Rig(pose, 1, 1, 1.0, 1.0, 0.0, 0.0, 0.1)))[0]["pose"] is None
    assert parse(encode_rig(None))[0]["pose"] is None
