"""Recorded requests of real clients without a transport: responses and scenes must equal Director's."""

import json
from typing import Any

import msgspec
import numpy as np
import pytest

from gateway.adapters.treeviewer.protocol import TreeViewerProtocol
from gateway.scene.draw.meshing import meshes_of
from gateway.scene.tree.geometry import Line
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.nodes import Node, Path
from scenegate.messages import wire
from tests.adapters.treeviewer import recordings
from tests.adapters.treeviewer.differences import DIFFERENCES, Difference
from tests.adapters.treeviewer.director_model import DirectorModel
from tests.adapters.treeviewer.recorded_meshes import RecordedMeshes

pytestmark = pytest.mark.corpus
LISTS = ("deleted_paths", "added_geometries", "set_transforms", "missing_paths")


def protocol() -> tuple[TreeViewerProtocol, LiveTree]:
    live = LiveTree()
    return TreeViewerProtocol(live, meshes=RecordedMeshes(recordings.folder() / "assets")), live


def answer_of(viewer: TreeViewerProtocol, data: bytes) -> dict[str, Any]:
    answer: dict[str, Any] = json.loads(msgspec.json.encode(viewer.handle(data)))
    return answer


def unordered(answer: dict[str, Any] | None) -> dict[str, Any]:
    """Return a response with lists of paths as sets, and without the format that Director lacks."""
    assert answer is not None
    result = dict(answer)
    if "supported_formats" in result:
        formats = result["supported_formats"]
        result["supported_formats"] = {name: formats[name] for name in formats if name != wire.BINARY}
    for name in LISTS:
        if name in answer:
            result[name] = {json.dumps(path) for path in answer[name]}
            assert len(result[name]) == len(answer[name])
    return result


def check_difference(answer: dict[str, Any], expected: Difference) -> None:
    assert answer["status"] == expected.status
    told = answer.get("error", "") + " ".join(answer.get("warnings", []))
    assert expected.says in told
    assert bool(told) == bool(expected.says)
    changed = answer["added_geometries"] or answer["set_transforms"]
    assert changed == (expected.paths or [])


@pytest.mark.parametrize("name", [n for n in recordings.names() if n != "fuzz"] or [pytest.param("", id="no corpus")])
def test_responses_equal_directors(name: str) -> None:
    viewer, _ = protocol()
    differences = dict(DIFFERENCES.get(name, {}))
    for exchange in recordings.exchanges(name or "deep"):
        expected = differences.pop(exchange.number, None)
        if expected is None:
            assert unordered(answer_of(viewer, exchange.data)) == unordered(exchange.response), exchange
        elif expected.status is None:
            with pytest.raises(wire.WireError, match=expected.says):
                viewer.handle(exchange.data)
        else:
            check_difference(answer_of(viewer, exchange.data), expected)
    assert not differences, "listed, but not in the recording"


def test_missing_paths_follow_the_document() -> None:
    viewer, _ = protocol()
    model = DirectorModel()
    differ = 0
    for exchange in recordings.exchanges("fuzz"):
        request = json.loads(wire.decode(exchange.data).data.tobytes())
        by_director, by_document = model.apply(request)
        ours, theirs = answer_of(viewer, exchange.data), exchange.response
        assert theirs is not None
        assert {tuple(path) for path in theirs["missing_paths"]} == by_director
        assert {tuple(path) for path in ours["missing_paths"]} == by_document
        assert ours["status"] == (1 if by_document else 0)
        differ += by_director != by_document
        for name in LISTS[:3]:
            assert unordered(ours)[name] == unordered(theirs)[name]
    assert differ, "the recording is meant to tell the rules apart"


@pytest.mark.parametrize("name", recordings.names() or [pytest.param("", id="no corpus")])
def test_final_scenes_equal_directors(name: str) -> None:
    viewer, live = protocol()
    name = name or "deep"
    for exchange in recordings.exchanges(name):
        try:
            viewer.handle(exchange.data)
        except wire.WireError:
            continue
    nodes = {path: (node, world) for path, node, world in worlds(live.snapshot.root)}
    ours = {path for path, (node, _) in nodes.items() if node.parts is not None}
    expected = recordings.scene(name)
    changed = CHANGED_SCENES.get(name, {})
    theirs = {path for path, value in expected.items() if value is not None}
    assert ours ^ theirs == set(changed)
    for path in theirs - set(changed):
        value, (node, world) = expected[path], nodes[path]
        assert value is not None
        if (name, path) not in MOVED:
            np.testing.assert_allclose(world, np.array(value["matrix"]), atol=1e-9)
        assert bounds_agree(node, value["local_bounds"]), (path, bounds(node), value["local_bounds"])
    for path in set(expected) - theirs - set(changed) - prefixes(changed):
        if path not in nodes:
            assert not any(other[: len(path)] == path for other in theirs), "only folders that hold nothing may lack"
    assert not (set(nodes) - set(expected) - set(changed) - prefixes(changed)), "folders that Director does not have"


CHANGED_SCENES: dict[str, dict[Path, str]] = {
    "bad": {
        ("bad", "38"): "three colour components",
        ("bad", "39"): "colour null",
        ("bad", "41"): "transform null",
        ("bad", "48"): "points of two numbers are refused",
        ("bad", "49"): "empty channel",
        ("bad", "50"): "channel of the wrong length",
        ("bad", "53"): "lidar that Director's rounding breaks",
        ("bad", "54"): "angle step 0",
        ("bad", "62"): "file outside the open folders",
        ("bad", "64"): "scale as a number",
        ("bad", "65"): "missing package",
        ("p3",): "the commands after a bad one",
        ("a", "b"): "string path",
        ("a", "/", "b"): "string path",
        ("a",): "path given as an object",
    },
    "geoms": {("all", "missing"): "file outside the open folders"},
    "cpp_wrapper": {("cpp", "cloud_no_colour"): "empty channel"},
    "paths": {("", ""): "Director takes a child of its parent's name for the parent's geometry"},
}
"""Paths with geometry in only one of the two viewers, because of the listed differences."""


MOVED = {("bad", ("p1",)): "its transform stands behind the bad command of the message"}


def prefixes(paths: dict[Path, str]) -> set[Path]:
    return {path[:n] for path in paths for n in range(len(path))}


def worlds(root: Node) -> list[tuple[Path, Node, np.ndarray]]:
    result: list[tuple[Path, Node, np.ndarray]] = []
    stack: list[tuple[Path, Node, np.ndarray]] = [((), root, np.eye(4))]
    while stack:
        path, node, parent = stack.pop()
        world = parent @ node.matrix
        result.append((path, node, world))
        stack.extend(((*path, element), child, world) for element, child in node.children.items())
    return result


def bounds(node: Node) -> np.ndarray | None:
    """Return the bounds, (2, 3) in metres, of a node's geometry in its frame."""
    points = []
    for part in node.parts or ():
        for mesh, _, X_part_mesh in meshes_of(part.shape, part.material):
            X = part.X_node_part @ X_part_mesh
            used = mesh.positions[np.unique(mesh.elements)]
            points.append(used @ X[:3, :3].T + X[:3, 3])
    if not points:
        return None
    every = np.concatenate(points)
    return np.stack((every.min(axis=0), every.max(axis=0)))


def bounds_agree(node: Node, expected: list[float] | None) -> bool:
    ours = bounds(node)
    theirs = None if expected is None else np.array(expected).reshape(3, 2).T
    if theirs is None or not np.isfinite(theirs).all() or (theirs[0] > theirs[1]).any():
        return theirs is not None or ours is None
    if ours is None:
        return False
    # Director's round solids have half as many sides as ours, and its tubes are cut where ours are mitred
    tubes = max((part.shape.radius for part in node.parts or () if isinstance(part.shape, Line)), default=0.0)
    tolerance = 0.01 * (theirs[1] - theirs[0]).max() + 0.5 * max(tubes, 0.0) + 1e-6
    return bool((np.abs(ours - theirs) <= tolerance).all())
