"""Updates: after any edits and any skipped revisions the page has the newest tree."""

import asyncio
import gc
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.adapters.viewer import encoder as encoder_module
from gateway.adapters.viewer.encoder import EMPTY_SNAPSHOT, Encoder, encode_stereo_rig
from gateway.adapters.viewer.geometry_messages import part_message
from gateway.adapters.viewer.messages import PlacedRig
from gateway.adapters.viewer.resources import Resources, channel_values, colors_to_uint8, encode_mesh, sample_order
from gateway.scene.tree.geometry import Part, PointCloud, Surface
from gateway.scene.tree.live import LiveTree, Snapshot
from gateway.scene.tree.nodes import Node, TreeEdit
from renderers.drawlist import AlphaMode, Image, Material, Mesh, Texture
from scenegate.messages.geometry import Box, Sphere
from tests.adapters.viewer.model import Model, body_array, browser_of, tree_of
from tests.support.view_frames import parse_frame

MATERIAL = Material()
TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
NAMES = st.sampled_from(["a", "b", 1, "1", "a/b", ""])
PATHS = st.lists(NAMES, min_size=0, max_size=3).map(tuple)
SHAPES = st.sampled_from([Box((1, 2, 3)), Sphere(1.0), Box((1, 1, 1))])
EDITS = st.one_of(
    st.tuples(st.just("parts"), PATHS, st.lists(SHAPES, max_size=2)),
    st.tuples(st.just("pose"), PATHS, st.floats(-10, 10, width=32)),
    st.tuples(st.just("matrix"), PATHS, st.floats(-10, 10, width=32)),
    st.tuples(st.just("visible"), PATHS, st.booleans()),
    st.tuples(st.just("opacity"), PATHS, st.sampled_from([0.0, 0.5, 1.0])),
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
    elif kind == "opacity":
        edit.set_opacity(path, value)
    elif kind == "delete":
        edit.delete(path)
    else:
        edit.set_subtree(path, Node(children={"grown": Node((Part(value, MATERIAL),)), 7: Node()}))


def part_json(part: Part) -> dict[str, Any]:
    """Return a part as the page receives it."""
    encoded: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(part_message(part, Resources())))
    return encoded


class Page:
    """The connection to a page, and the page's model."""

    def __init__(self, encoder: Encoder, resources: Resources) -> None:
        self.browser = browser_of(encoder, resources)
        self.resources = resources
        self.model = Model()

    def catch_up(self) -> None:
        if not self.browser.update_due:
            return
        update = asyncio.run(self.browser.next_update())
        for number in self.browser.take_missing_meshes(update):
            frame = self.resources.mesh_frame(number)
            assert frame is not None
            self.model.receive(frame)
        self.model.receive(update.frame)
        self.browser.acknowledge()


@settings(deadline=None, max_examples=150)
@given(
    st.lists(st.tuples(st.lists(EDITS, min_size=1, max_size=4), st.sets(st.integers(0, 2))), max_size=12),
    st.sampled_from([6, 1_000_000]),
)
def test_every_page_reaches_the_newest_tree(steps: Any, max_node_ids: int) -> None:
    tree, resources = LiveTree(), Resources()
    encoder = Encoder(resources, max_node_ids)
    pages = [Page(encoder, resources) for _ in range(3)]
    for edits, awake in steps:
        with tree.edit() as edit:
            for kind, path, value in edits:
                apply(edit, kind, path, value)
        encoder.advance(tree.snapshot)
        for number in awake:
            pages[number].catch_up()
    pages.append(Page(encoder, resources))
    for page in pages:
        page.catch_up()
        assert page.model.tree() == tree_of(tree.snapshot.root)
        assert not page.browser.update_due


def test_update_of_transforms_contains_only_ids_and_poses() -> None:
    tree, encoder = LiveTree(), Encoder(Resources())
    with tree.edit() as edit:
        for number in range(5):
            edit.set_parts(("arm", number), (Part(Box((1, 1, 1)), MATERIAL),))
    encoder.advance(tree.snapshot)
    before = encoder.current
    for x in (1.0, 2.0):
        with tree.edit() as edit:
            edit.set_pose(("arm", 3), (x, 0, 0, 1, 0, 0, 0))
        encoder.advance(tree.snapshot)
    header, body = parse_frame(asyncio.run(encoder.update(before))[0].frame)
    assert set(header) == {"kind", "from", "revision", "timestamp", "poses"}
    assert np.frombuffer(body, "<u4", 1).tolist() == [encoder.node_id(("arm", 3))]
    assert header["poses"]["values"][1] == 7


def test_browsers_at_one_revision_share_the_update() -> None:
    tree, encoder = LiveTree(), Encoder(Resources())
    with tree.edit() as edit:
        edit.set_parts(("a",), (Part(Sphere(1), MATERIAL),))
    encoder.advance(tree.snapshot)
    assert asyncio.run(encoder.update(EMPTY_SNAPSHOT))[0] is asyncio.run(encoder.update(EMPTY_SNAPSHOT))[0]


def many_boxes(count: int) -> Node:
    edit = TreeEdit(Node())
    for i in range(count):
        edit.set_parts(("boxes", i), (Part(Box((0.1, 0.1, 0.1 + i)), Material()),))
    return edit.commit()


async def test_encoding_a_large_scene_yields_to_the_event_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(encoder_module, "MAX_BLOCKING_SECONDS", 0.0)
    encoder, turns = Encoder(Resources()), 0
    first, later = Snapshot(many_boxes(400), 1), Snapshot(many_boxes(401), 2)
    encoder.advance(first)

    async def others() -> None:
        nonlocal turns
        while not encoding.done():
            turns += 1
            if turns == 3:
                encoder.advance(later)
            await asyncio.sleep(0)

    encoding = asyncio.create_task(encoder.update(EMPTY_SNAPSHOT))
    same = asyncio.create_task(encoder.update(EMPTY_SNAPSHOT))
    await others()
    update, leads_to = await encoding
    assert turns >= 400
    assert leads_to is first
    header, _ = parse_frame(update.frame)
    assert header["revision"] == 1
    assert len(header["nodes"]) == 401
    newest, leads_to = await same
    assert leads_to is later
    assert len(parse_frame(newest.frame)[0]["nodes"]) == 402
    step, leads_to = await encoder.update(first)
    assert leads_to is later
    assert [node["name"] for node in parse_frame(step.frame)[0]["nodes"] if "name" in node] == [400]


async def test_dropping_all_ids_discards_the_update_in_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(encoder_module, "MAX_BLOCKING_SECONDS", 0.0)
    encoder = Encoder(Resources(), max_node_ids=200)
    encoder.advance(Snapshot(many_boxes(400), 1))
    browser = browser_of(encoder, Resources())
    sending = asyncio.create_task(browser.next_update())
    for _ in range(250):  # one change per turn of the event loop
        await asyncio.sleep(0)
    encoder.advance(Snapshot(many_boxes(460), 2))
    assert encoder.epoch == 1
    header, _ = parse_frame((await sending).frame)
    assert (header["from"], header["revision"], len(header["nodes"])) == (0, 2, 461)
    browser.acknowledge()
    assert not browser.update_due


def test_ids_are_dropped_beyond_their_limit_only() -> None:
    encoder = Encoder(Resources(), max_node_ids=401)
    encoder.advance(Snapshot(many_boxes(399), 1))  # 401 paths with the root and the boxes' parent
    asyncio.run(encoder.update(EMPTY_SNAPSHOT))
    encoder.advance(Snapshot(many_boxes(398), 2))
    assert encoder.epoch == 0
    encoder.node_id(("one more",))
    encoder.advance(Snapshot(many_boxes(398), 3))
    assert encoder.epoch == 1


def test_large_coordinates_are_exact() -> None:
    tree, encoder = LiveTree(), Encoder(Resources())
    with tree.edit() as edit:
        edit.set_pose(("pose",), (500_000.001, -5_400_000.002, 1e300, 1, 0, 0, 0))
        edit.set_matrix(("matrix",), np.diag([1e300, 1, 1, 1]))
    encoder.advance(tree.snapshot)
    model = Model()
    model.receive(asyncio.run(encoder.update(EMPTY_SNAPSHOT))[0].frame)
    tree_now = model.tree()
    assert tree_now["pose",][2][12:15] == (500_000.001, -5_400_000.002, 1e300)
    assert tree_now["matrix",][2][0] == 1e300


def test_materials_and_channels_are_encoded() -> None:
    tree, resources = LiveTree(), Resources()
    encoder = Encoder(resources)
    points = np.array([[0, 0, 0], [np.nan, 0, 0], [1, 1, 1]], np.float32)
    channels = {
        "intensity": np.array([0, 5, 1], np.float32),
        "rgb": np.ones((3, 3), np.float32),
        "empty": np.zeros(0, np.float32),
        "longer": np.zeros(4, np.float32),
    }
    glass = Material((1.0, 0.0, 0.0, 0.5), alpha_mode=AlphaMode.BLEND, point_size=3.0)
    with tree.edit() as edit:
        edit.set_parts(("cloud",), (Part(PointCloud(points, channels), glass, source="scan.ply"),))
    encoder.advance(tree.snapshot)
    header, _ = parse_frame(asyncio.run(encoder.update(EMPTY_SNAPSHOT))[0].frame)
    (part,) = next(entry for entry in header["nodes"] if entry["name"] == "cloud")["parts"]
    assert part["channels"] == {"intensity": 1, "rgb": 3}
    assert (part["points"], part["source"]) == (3, "scan.ply")
    (draw,) = part["draws"]
    color = draw["material"].pop("color")
    assert draw["material"] == {"alpha": "blend", "metallic": 1.0, "pointSize": 3.0}
    assert color == pytest.approx([1.0, 1.0, 1.0, 0.5]), "colours come from channel rgb"
    cloud = resources.clouds.get(draw["mesh"])
    assert cloud is not None
    values = channel_values(cloud, "intensity")
    assert values is not None
    assert sorted(values.ravel().tolist()) == [0.0, 1.0]
    assert channel_values(cloud, "empty") is None
    assert channel_values(cloud, "longer") is None
    assert 999 not in resources.clouds


def test_points_and_channels_have_the_same_order_and_every_part_is_a_sample() -> None:
    count = 5000
    x = np.arange(count, dtype=np.float32)
    points = np.stack((x, 2 * x, -x), axis=1)
    cloud = PointCloud(points, {"x": x})
    tree, resources = LiveTree(), Resources()
    encoder = Encoder(resources)
    with tree.edit() as edit:
        edit.set_parts(("cloud",), (Part(cloud, MATERIAL),))
    encoder.advance(tree.snapshot)
    (mesh_id,) = asyncio.run(encoder.update(EMPTY_SNAPSHOT))[0].meshes
    frame = resources.mesh_frame(mesh_id)
    assert frame is not None
    header, body = parse_frame(frame)
    sent = np.frombuffer(body, np.float32, 3 * count, header["position"][0]).reshape(-1, 3)
    assert header["box"] == [[0.0, 0.0, 1.0 - count], [count - 1.0, 2.0 * count - 2.0, 0.0]]
    values = channel_values(cloud, "x")
    assert values is not None
    np.testing.assert_array_equal(values[:, 0], sent[:, 0])
    np.testing.assert_array_equal(np.sort(sent[:, 0]), x)
    for start in range(0, count, 500):
        in_tenths = np.histogram(sent[start : start + 500, 0], bins=10, range=(0, count))[0]
        assert in_tenths.min() >= 45, "each part has a tenth of the points in every tenth of the cloud"


@pytest.mark.parametrize("count", [0, 1, 2, 3, 7, 100, 65_537])
def test_sample_order_is_a_permutation(count: int) -> None:
    assert np.array_equal(np.sort(sample_order(count)), np.arange(count))


def material_json(**fields: Any) -> dict[str, Any]:
    """Return a material as the page receives it."""
    mesh = Mesh(TRIANGLE, np.array([[0, 1, 2]], np.uint32), uv0=TRIANGLE[:, :2].copy(), uv1=TRIANGLE[:, 1:].copy())
    (draw,) = part_json(Part(Surface(mesh), Material(**fields)))["draws"]
    material: dict[str, Any] = draw["material"]
    return material


def test_materials_are_encoded_without_defaults() -> None:
    blend, mask = AlphaMode.BLEND, AlphaMode.MASK
    assert set(material_json(metallic=0.0)) == {"color"}
    changed = material_json(roughness=0.5, emissive=(0.0, 0.5, 1.0), double_sided=True, alpha_mode=blend)
    assert set(changed) == {"color", "metallic", "roughness", "emissive", "doubleSided", "alpha"}
    assert changed["emissive"] == pytest.approx([0.0, 0.735357, 1.0], abs=1e-5), "encoded as the colour is"
    for cutoff, encoded in ((0.5, None), (0.25, 0.25), (1.5, 1.5), (0.0, 0.0)):
        masked = material_json(alpha_mode=mask, alpha_cutoff=cutoff)
        assert (masked["alpha"], masked.get("cutoff")) == ("mask", encoded)
    assert part_json(Part(Box((1, 1, 1)), Material(), kind="text"))["facesCamera"] is True
    assert "facesCamera" not in part_json(Part(Box((1, 1, 1)), Material()))


def test_maps_of_a_material_are_encoded() -> None:
    texture = Texture(
        Image(b"key", lambda: np.zeros((1, 1, 4), np.uint8)), uv_set=1, uv_transform=(2.0, 0.0, 0.5, 0.0, 3.0, 0.25)
    )
    maps = ("metallic_roughness_texture", "normal_texture", "occlusion_texture", "emissive_texture")
    sent = material_json(
        **dict.fromkeys(maps, texture), normal_scale=0.5, occlusion_strength=0.25, emissive_strength=3.0
    )
    names = ("metallicRoughnessTexture", "normalTexture", "occlusionTexture", "emissiveTexture")
    expected = {
        "image": 1,
        "wrap": [10497, 10497],
        "linear": True,
        "set": 1,
        "transform": [2.0, 0.0, 0.5, 0.0, 3.0, 0.25],
    }
    assert [sent[name] for name in names] == [expected] * 4
    assert (sent["normalScale"], sent["occlusionStrength"], sent["emissiveStrength"]) == (0.5, 0.25, 3.0)
    assert "texture" not in sent
    assert material_json(base_color_texture=texture)["texture"]["set"] == 1


def test_both_sets_of_texture_coordinates_are_encoded() -> None:
    mesh = Mesh(TRIANGLE, np.array([[0, 1, 2]], np.uint32), uv0=TRIANGLE[:, :2].copy(), uv1=TRIANGLE[:, 1:].copy())
    header, body = parse_frame(encode_mesh(1, mesh))
    for name, values in (("uv", TRIANGLE[:, :2]), ("uv1", TRIANGLE[:, 1:])):
        assert body_array(body, header[name], "<f4").tolist() == values.ravel().tolist()


def test_stereo_rig_pose_is_column_major_or_null() -> None:
    pose = np.eye(4)
    pose[:3, 3] = 1, 2, 3

    def encoded() -> dict[str, Any]:
        rig = PlacedRig(
            pose=pose.T.ravel().tolist(), width=640, height=480, fx=500.0, fy=500.0, cx=320.0, cy=240.0, baseline=0.16
        )
        return parse_frame(encode_stereo_rig(rig))[0]

    header = encoded()
    assert header["pose"][12:15] == [1.0, 2.0, 3.0]
    assert header["baseline"] == pytest.approx(0.16)
    pose[0, 0] = np.nan
    assert encoded()["pose"] is None
    assert parse_frame(encode_stereo_rig(None))[0]["pose"] is None


@pytest.mark.parametrize(
    ("corners", "elements", "written"),
    [(3, [0, 1, 2], False), (3, [0, 2, 1], True), (4, [0, 1, 2], True), (3, [0, 1, 2, 0, 1, 2], True)],
)
def test_indices_are_left_out_where_they_count_the_vertices(corners: int, elements: list[int], written: bool) -> None:
    positions = np.arange(3 * corners, dtype=np.float32).reshape(corners, 3)
    mesh = Mesh(positions, np.array(elements, np.uint32).reshape(-1, 3))
    header, body = parse_frame(encode_mesh(5, mesh))
    assert header["id"] == 5
    assert ("index" in header) == written
    assert body_array(body, header["position"], "<f4").tolist() == positions.ravel().tolist()
    if written:
        assert body_array(body, header["index"], "<u4").tolist() == elements


def test_colours_are_rounded_and_clamped() -> None:
    colors = np.array([-1.0, -0.001, 0.0, 0.499 / 255, 0.5 / 255, 1.0, 1.5, np.nan, np.inf, -np.inf], np.float32)
    assert colors_to_uint8(colors).tolist() == [0, 0, 0, 0, 1, 255, 255, 0, 255, 0]


def test_nodes_are_written_with_what_they_have() -> None:
    tree, encoder = LiveTree(), Encoder(Resources())
    with tree.edit() as edit:
        edit.set_parts(("a", "b"), (Part(Box((1, 1, 1)), MATERIAL),))
        edit.set_parts(("empty",), ())
        edit.set_visible(("hidden",), False)
    encoder.advance(tree.snapshot)
    header, _ = parse_frame(asyncio.run(encoder.update(EMPTY_SNAPSHOT))[0].frame)
    nodes = {node["name"]: set(node) - {"id", "name", "parent"} for node in header["nodes"]}
    assert nodes == {"a": set(), "b": {"parts"}, "empty": {"parts"}, "hidden": {"visible"}}
    before = tree.snapshot
    with tree.edit() as edit:
        edit.set_visible(("a",), False)
        edit.set_parts(("empty",), (Part(Box((1, 1, 1)), MATERIAL),))
    encoder.advance(tree.snapshot)
    header, _ = parse_frame(asyncio.run(encoder.update(before))[0].frame)
    assert sorted(sorted(set(node) - {"id"}) for node in header["nodes"]) == [["parts"], ["visible"]]


@pytest.mark.parametrize("indices", [[[0, 1, 2]], [[0], [1], [2]]])
def test_vertex_colours_are_encoded_as_srgb(indices: Any) -> None:
    colors = np.full((3, 4), 0.5, np.float32)
    mesh = Mesh(np.zeros((3, 3), np.float32), np.array(indices, np.uint32), colors=colors)
    header, body = parse_frame(encode_mesh(1, mesh))
    assert body_array(body, header["color"], "u1").tolist() == [188, 188, 188, 128] * 3


async def test_trees_of_the_same_revision_that_were_decoded_apart() -> None:
    """The page's meshes are those of its own trees, also if an update between equal ones was encoded before."""

    def snapshots() -> tuple[Snapshot, Snapshot]:
        surface = Surface(Mesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.uint32)))
        edit = TreeEdit(Node())
        edit.set_parts(("a",), (Part(surface, MATERIAL),))
        first = edit.commit()
        edit = TreeEdit(first)
        edit.set_pose(("a",), (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
        return Snapshot(first, 1), Snapshot(edit.commit(), 2)

    resources = Resources()
    encoder = Encoder(resources)
    for _ in range(2):
        old, new = snapshots()
        update, _ = await encoder.update(EMPTY_SNAPSHOT, old)
        assert all(resources.mesh_frame(mesh_id) for mesh_id in update.meshes)
        assert len(update.meshes) == 1
        moved, _ = await encoder.update(old, new)
        assert not moved.meshes
        again, _ = await encoder.update(old, new)
        assert again is moved
        (other, _), (_, last) = snapshots(), (old, new)
        changed, _ = await encoder.update(other, last)
        assert changed.meshes == update.meshes
        del old, new, other, last
        gc.collect()
