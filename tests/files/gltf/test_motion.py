"""Scenes with motion as glTF: read back by our reader at times, by trimesh, and what the file does not have."""

from __future__ import annotations

import io
import json
import struct
from typing import Any

import numpy as np
import pytest

from gateway.files.gltf import AnimationTime, GltfScene, read_gltf
from gateway.files.gltf.export import MotionWriter
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.live import Snapshot
from gateway.scene.tree.nodes import Node, Path, TreeEdit
from gateway.scene.tree.sampling import FileTooLargeError
from gateway.scene.tree.transforms import Y_UP_TO_Z_UP, Matrix
from renderers.drawlist import Material
from scenegate.messages.geometry import Box, Sphere

BOX, BALL = Part(Box((1, 1, 1)), Material()), Part(Sphere(0.5), Material())


def states(*edits: Any) -> list[Node]:
    """Return the trees after each edit of the one before."""
    roots = [Node()]
    for change in edits:
        edit = TreeEdit(roots[-1])
        change(edit)
        roots.append(edit.commit())
    return roots[1:]


def exported(roots: list[Node], step: float = 1.0) -> tuple[bytes, list[str]]:
    writer = MotionWriter()
    for number, root in enumerate(roots):
        writer.add(round(number * step * 1e9), Snapshot(root, number))
    data = writer.finish(0)
    return data, warnings_of(data)


def warnings_of(data: bytes) -> list[str]:
    (size,) = struct.unpack_from("<I", data, 12)
    extras = json.loads(data[20 : 20 + size])["asset"].get("extras", {})
    return list(extras.get("warnings", []))


def world_of(scene: GltfScene, *names: str) -> Matrix:
    """Return X_world_node of a node of a file, which is Y up, in the world, which is Z up."""
    found = [path for path, _ in scene.root.walk() if tuple(name for name in path if name in names) == names]
    matrix = scene.root.world_matrix(min(found, key=len))
    assert matrix is not None
    return Y_UP_TO_Z_UP @ matrix


def turned(angle: float, scale: float = 1.0, x: float = 0.0) -> Matrix:
    X = np.eye(4)
    X[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    X[:3, :3] *= scale
    X[0, 3] = x
    return X


def test_nodes_are_where_they_were_at_each_time() -> None:
    poses = [turned(2.5 * number, 1.0 + number, number) for number in range(8)]

    def begin(edit: TreeEdit) -> None:
        edit.set_parts(("robot", "arm"), (BOX,))
        edit.set_parts(("robot", "arm", "hand"), (BALL,))
        edit.set_matrix(("robot", "arm", "hand"), turned(0.3, x=2.0))
        edit.set_matrix(("robot",), poses[0])

    roots = states(begin, *(lambda edit, X=X: edit.set_matrix(("robot",), X) for X in poses[1:]))
    data, warnings = exported(roots, step=0.5)
    assert warnings == []
    for number, root in enumerate(roots):
        scene = read_gltf(data, animation=AnimationTime("motion", 0.5 * number))
        assert scene.warnings == ()
        for path in (("robot",), ("robot", "arm"), ("robot", "arm", "hand")):
            expected = root.world_matrix(path)
            assert expected is not None
            np.testing.assert_allclose(world_of(scene, *path), expected, atol=1e-5)
    between = read_gltf(data, animation=AnimationTime("motion", 0.25))
    np.testing.assert_allclose(world_of(between, "robot")[:3, 3], [0.5, 0, 0], atol=1e-5)


def test_a_node_rests_until_it_moves() -> None:
    def begin(edit: TreeEdit) -> None:
        edit.set_parts(("box",), (BOX,))

    def rest(edit: TreeEdit) -> None:
        edit.set_pose(("other",), (1, 0, 0, 1, 0, 0, 0))

    roots = states(begin, rest, rest, lambda edit: edit.set_pose(("box",), (8, 0, 0, 1, 0, 0, 0)))
    data, _ = exported(roots)
    xs = [
        world_of(read_gltf(data, animation=AnimationTime("motion", time)), "box")[0, 3] for time in (0, 1.9, 2, 2.5, 3)
    ]
    np.testing.assert_allclose(xs, [0, 0, 0, 4, 8], atol=1e-5)


def volume(data: bytes, time: float, path: Path) -> float:
    """Return the determinant of a node's axes in the world: 0 if it is not drawn."""
    return float(
        np.linalg.det(world_of(read_gltf(data, animation=AnimationTime("motion", time)), *map(str, path))[:3, :3])
    )


def test_hidden_and_deleted_nodes_have_no_size_meanwhile() -> None:
    def begin(edit: TreeEdit) -> None:
        edit.set_parts(("box",), (BOX,))

    def grow(edit: TreeEdit) -> None:
        edit.set_parts(("late", "ball"), (BALL,))
        edit.set_visible(("box",), False)

    def delete(edit: TreeEdit) -> None:
        edit.delete(("late",))
        edit.set_visible(("box",), True)

    roots = states(begin, grow, delete, lambda edit: edit.set_pose(("late",), (0, 0, 0, 1, 0, 0, 0)))
    data, warnings = exported(roots)
    assert warnings == []
    box = [volume(data, time, ("box",)) for time in (0, 0.9, 1, 1.9, 2, 3)]
    np.testing.assert_allclose(box, [1, 1, 0, 0, 1, 1], atol=1e-5)
    ball = [volume(data, time, ("late", "ball")) for time in (0, 0.9, 1, 1.9, 2, 3)]
    np.testing.assert_allclose(ball, [0, 0, 1, 1, 0, 0], atol=1e-5)
    at_rest = read_gltf(data)
    assert abs(np.linalg.det(world_of(at_rest, "late", "ball")[:3, :3])) == pytest.approx(1.0)


def test_what_gltf_cannot_animate_is_a_warning() -> None:
    shear = np.eye(4)
    shear[0, 1] = 0.5

    def begin(edit: TreeEdit) -> None:
        edit.set_parts(("box",), (BOX,))
        edit.set_parts(("again",), (BOX,))
        edit.set_matrix(("fixed",), shear)

    def change(edit: TreeEdit) -> None:
        edit.set_parts(("box",), (BALL,))
        edit.set_opacity(("box",), 0.5)
        edit.set_matrix(("box",), shear)
        edit.delete(("again",))

    def last(edit: TreeEdit) -> None:
        edit.set_matrix(("again",), np.full((4, 4), np.nan))
        edit.set_parts(("again",), (BALL,))
        edit.set_opacity(("again",), 0.5)

    data, warnings = exported(states(begin, change, last))
    assert warnings == [
        "glTF animates no geometry: the file has the first geometry of 2 nodes, such as box",
        "glTF animates no opacity: the file has the first opacity of 2 nodes, such as box",
        "glTF animates no shear: the file is without the shear of 1 nodes, such as box",
    ]
    scene = read_gltf(data, animation=AnimationTime("motion", 2.0))
    np.testing.assert_allclose(world_of(scene, "fixed"), shear, atol=1e-6)


def test_a_scene_at_rest_has_no_animation() -> None:
    data, warnings = exported(states(lambda edit: edit.set_parts(("box",), (BOX,))))
    assert warnings == []
    assert b'"animations"' not in data


def test_other_readers_accept_the_file() -> None:
    trimesh = pytest.importorskip("trimesh")
    roots = states(
        lambda edit: edit.set_parts(("box",), (BOX,)),
        *(lambda edit, x=x: edit.set_pose(("box",), (x, 0, 0, 1, 0, 0, 0)) for x in range(1, 5)),
    )
    data, _ = exported(roots)
    scene = trimesh.load(io.BytesIO(data), file_type="glb")
    np.testing.assert_allclose(scene.bounds, [[-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]], atol=1e-6)
    loaded = trimesh.exchange.gltf.load_glb(io.BytesIO(data))
    assert loaded["graph"] is not None


def test_the_size_of_the_motion_is_limited() -> None:
    writer = MotionWriter(max_bytes=1000)
    roots = states(*(lambda edit, x=x: edit.set_pose(("box",), (x, 0, 0, 1, 0, 0, 0)) for x in range(20)))
    for number, root in enumerate(roots[:9]):
        writer.add(number, Snapshot(root, number))
    with pytest.raises(FileTooLargeError, match=r"needs more than 1000 bytes: take a shorter time"):
        writer.add(9, Snapshot(roots[9], 9))
