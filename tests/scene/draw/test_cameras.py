import contextlib
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.scene.draw.bounds import corners_of
from gateway.scene.draw.cameras import (
    MAX_CAMERA_CHARACTERS,
    CameraError,
    FitCamera,
    LookAtCamera,
    NodeCamera,
    StereoCamera,
    parse_camera,
)
from gateway.scene.draw.flatten import flatten
from gateway.scene.draw.viewpoints import resolve_camera
from gateway.scene.tree import transforms as tf
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.nodes import Node, TreeEdit
from renderers.camera import Camera
from renderers.drawlist import DrawList, Instance, Material, Mesh
from renderers.interface import Output
from renderers.primitives import box
from renderers.raster import CpuRenderer
from scenegate.messages.geometry import Box
from tests.support.bounds import scene_bounds


def project(camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (N, 2) and depths (N,) of world points, by the camera's definition."""
    local = points @ camera.X_camera_world[:3, :3].T + camera.X_camera_world[:3, 3]
    depth = local[:, 2]
    pixels = local[:, :2] / depth[:, None] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    return pixels, depth


def tree(*boxes: tuple[tuple[float, float, float], tuple[float, float, float]]) -> Node:
    edit = TreeEdit(Node())
    for index, (lengths, centre) in enumerate(boxes):
        edit.set_parts(("box", index), (Part(Box(lengths), Material()),))
        edit.set_matrix(("box", index), tf.translation(*centre))
    return edit.commit()


def camera_at(X: np.ndarray) -> Camera:
    edit = TreeEdit(Node())
    edit.set_matrix(("node",), X)
    return resolve_camera(NodeCamera(("node",)), edit.commit(), 64, 48)


@pytest.mark.parametrize(
    ("text", "spec"),
    [
        ("stereo", StereoCamera()),
        (" fit ", FitCamera()),
        ('path:["robot","head"]', NodeCamera(("robot", "head"))),
        ('path: ["a/b", 1, "1"]', NodeCamera(("a/b", 1, "1"))),
        ("path:[]", NodeCamera(())),
        ("eye=1,2,3;target=0,0,0", LookAtCamera((1, 2, 3), (0, 0, 0))),
        ("target=0, 0, 0; eye=1,2,-3e1 ;", LookAtCamera((1, 2, -30), (0, 0, 0))),
        ("eye=1,2,3;target=0,0,0;up=0,1,0;fovy=30", LookAtCamera((1, 2, 3), (0, 0, 0), (0, 1, 0), 30.0)),
        ("eye=1,2,3;target=0,0,0;xmag=2.5", LookAtCamera((1, 2, 3), (0, 0, 0), xmag=2.5)),
    ],
)
def test_the_grammar(text: Any, spec: Any) -> None:
    assert parse_camera(text) == spec


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "camera ''"),
        ("left", "camera 'left' is not one of"),
        ("path:robot", "camera path 'robot' is not a JSON list"),
        ('path:{"a":1}', "is not a JSON list"),
        ("path:" + "[" * 3000, "is not a JSON list"),
        ('path:["a",1.5]', "camera path element '1.5'"),
        ('path:["a",true]', "camera path element 'true'"),
        ('path:["a",["b"]]', "camera path element"),
        ("eye=1,2,3", "has no target=x,y,z"),
        ("target=1,2,3", "has no eye=x,y,z"),
        ("eye=1,2;target=0,0,0", "'eye=1,2' needs three numbers"),
        ("eye=1,2,x;target=0,0,0", "eye: 'x' is not a number"),
        ("eye=1,2,3;target=1,2,3", "'target=1,2,3' is the same point as eye"),
        ("eye=1,2,3;target=0,0,0;up=0,0,0", "'up=0,0,0' has no direction"),
        ("eye=1,2,3;target=0,0,0;fovy=180", "'fovy=180' must be at least 0.001 and less than 180"),
        ("eye=1,2,3;target=0,0,0;xmag=0", "'xmag=0' must be at least 1e-09 metres, without fovy="),
        ("eye=1,2,3;target=0,0,0;xmag=1;fovy=30", "'xmag=1' must be at least 1e-09 metres, without fovy="),
        ("eye=1,2,3;eye=0,0,0;target=0,0,0", "'eye=0,0,0' repeats eye="),
        ("eye=1,2,3;target=0,0,0;roll=3", "'roll=3' is not one of eye="),
        ("eye=1,2,3;target=0,0,0;up", "'up' is not one of eye="),
    ],
)
def test_errors_name_the_part_of_the_text(text: Any, message: Any) -> None:
    with pytest.raises(CameraError) as caught:
        parse_camera(text)
    assert message in str(caught.value)
    assert len(str(caught.value)) < 300


@given(st.text(max_size=60) | st.text(alphabet="eyetargup=;,.0123456789-path:[]\"'\\", max_size=60))
@settings(deadline=None)
def test_any_text_is_a_camera_or_a_camera_error(text: Any) -> None:
    with contextlib.suppress(CameraError):
        camera = resolve_camera(parse_camera(text), Node(), 64, 48)
        assert camera.width == 64


@pytest.mark.parametrize(("width", "height"), [(640, 480), (100, 900), (900, 100), (1, 1)])
@pytest.mark.parametrize("fovy", [10.0, 45.0, 120.0])
def test_fit_sees_every_corner_and_fills_the_image(width: Any, height: Any, fovy: Any) -> None:
    root = tree(((1, 2, 3), (5, 5, 5)), ((0.2, 0.2, 0.2), (3, 5, 4)))
    camera = resolve_camera(FitCamera(), root, width, height, fovy=fovy)
    bounds: Any = scene_bounds(flatten(root))
    pixels, depth = project(camera, corners_of(bounds))
    assert (depth > camera.near).all()
    assert (depth < camera.far).all()
    half = np.array((width, height)) / 2
    offset = np.abs(pixels - half) / half
    assert offset.max() <= 1.0
    assert offset.max() > 0.85


@pytest.mark.parametrize("size", [1e-4, 1.0, 1e5])
def test_fit_works_for_scenes_of_any_size(size: Any) -> None:
    root = tree(((size, size, size), (0, 0, 10 * size)))
    camera = resolve_camera(FitCamera(), root, 64, 64)
    _, depth = project(camera, np.array([(0, 0, 10 * size)]))
    assert size < depth[0] < 10 * size


def test_fit_of_an_empty_scene_looks_at_the_origin() -> None:
    camera = resolve_camera(FitCamera(), Node(), 64, 64)
    pixels, depth = project(camera, np.zeros((1, 3)))
    np.testing.assert_allclose(pixels, [(32, 32)], atol=1e-9)
    assert camera.near < depth[0] < camera.far


def test_a_large_ground_is_neither_framed_nor_clipped() -> None:
    root = tree(((100, 100, 0.1), (0, 0, -0.05)), ((0.5, 0.5, 0.5), (0, 0, 0.25)))
    camera = resolve_camera(FitCamera(), root, 640, 480)
    pixels, _ = project(camera, corners_of(np.array(((-0.25, -0.25, 0), (0.25, 0.25, 0.5)))))
    assert np.ptp(pixels[:, 1]) > 300
    assert camera.near <= 0.1
    assert camera.far > 40


def test_up_is_up_and_right_is_right() -> None:
    camera = resolve_camera(LookAtCamera((0, -5, 0), (0, 0, 0)), Node(), 200, 100)
    pixels, depth = project(camera, np.array([(0.0, 0, 0), (1, 0, 0), (0, 0, 1)]))
    np.testing.assert_allclose(pixels[0], (100, 50), atol=1e-9)
    assert pixels[1, 0] > 100
    assert pixels[2, 1] < 50
    np.testing.assert_allclose(depth, 5.0)


def test_the_vertical_field_of_view_is_the_texts_before_the_callers() -> None:
    spec = LookAtCamera((0, -5, 0), (0, 0, 0), fovy=90.0)
    camera = resolve_camera(spec, Node(), 200, 100)
    assert camera.fx == camera.fy == pytest.approx(50.0)
    spec = LookAtCamera((0, -5, 0), (0, 0, 0))
    assert resolve_camera(spec, Node(), 200, 100, fovy=60.0).fy == pytest.approx(50 / math.tan(math.radians(30)))
    with pytest.raises(CameraError, match="fovy 200"):
        resolve_camera(spec, Node(), 200, 100, fovy=200.0)


def test_a_nodes_frame_is_the_optical_frame_without_scale_or_mirror() -> None:
    edit = TreeEdit(Node())
    edit.set_pose(("robot",), (1, 2, 3, 0.5, 0.5, -0.5, 0.5))
    edit.set_matrix(("robot", "head"), tf.scaling(2, -3, 4))
    camera = resolve_camera(NodeCamera(("robot", "head")), edit.commit(), 64, 48)
    rotation = camera.X_world_camera[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    expected = tf.from_pose((1, 2, 3), (0.5, 0.5, -0.5, 0.5))
    np.testing.assert_allclose(camera.X_world_camera[:3, 2:], expected[:3, 2:], atol=1e-12)
    np.testing.assert_allclose(rotation[:, 0], expected[:3, 0], atol=1e-12)


@pytest.mark.parametrize(
    "matrix", [np.full((4, 4), np.nan), tf.scaling(0, 1, 1), tf.scaling(1, 1, 0), tf.translation(1e200, 0, 0)]
)
def test_rejects_nodes_without_axes_as_cameras(matrix: Any) -> None:
    with pytest.raises(CameraError, match="no usable axes"):
        camera_at(matrix)


def test_a_missing_node_is_named() -> None:
    with pytest.raises(CameraError, match=r'camera path .*"nobody".*no such node'):
        resolve_camera(NodeCamera(("nobody",)), Node(), 64, 48)


def test_the_stereo_camera_keeps_its_field_of_view_at_another_size() -> None:
    stereo = Camera(1280, 960, 1080, 1090, 641, 479, 0.1, 10, tf.look_at((1, 0, 1), (0, 0, 0), (0, 0, 1)))
    camera = resolve_camera(StereoCamera(), Node(), 640, 480, stereo=stereo)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (540, 545, 320.5, 239.5)
    assert (camera.near, camera.far) == (0.1, 10)
    np.testing.assert_array_equal(camera.X_world_camera, stereo.X_world_camera)
    wide = resolve_camera(StereoCamera(), Node(), 1280, 480, stereo=stereo, near=0.5, far=5.0)
    assert (wide.fx, wide.cx, wide.cy, wide.near, wide.far) == (1080, 641, 239, 0.5, 5.0)
    with pytest.raises(CameraError, match="runs no stereo camera"):
        resolve_camera(StereoCamera(), Node(), 64, 48)


def test_a_camera_inside_the_scene_sees_near_things() -> None:
    root = tree(((100, 100, 0.1), (0, 0, -0.05)))
    camera = resolve_camera(LookAtCamera((0, 0, 1), (1, 0, 0.9)), root, 64, 48)
    assert camera.near <= 0.01
    assert camera.far > 49


def test_planes_of_the_caller_are_kept_and_checked() -> None:
    spec = LookAtCamera((0, -5, 0), (0, 0, 0))
    camera = resolve_camera(spec, tree(((1, 1, 1), (0, 0, 0))), 64, 48, near=0.5, far=7.0)
    assert (camera.near, camera.far) == (0.5, 7.0)
    with pytest.raises(CameraError, match="near=9"):
        resolve_camera(spec, Node(), 64, 48, near=9.0, far=7.0)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("name", ["eye", "target"])
def test_the_largest_coordinates_are_accepted_and_larger_ones_are_not(axis: int, name: str) -> None:
    def text(value: str) -> str:
        numbers = ["1", "2", "3"]
        numbers[axis] = value
        return ";".join(f"{key}={','.join(numbers) if key == name else '0,0,0'}" for key in ("eye", "target"))

    for value in ("1e12", "-1e12"):
        camera: Any = parse_camera(text(value))
        assert getattr(camera, name)[axis] == float(value)
    for value in ("1.01e12", "-1e13", "-inf", "nan", "-nan"):
        with pytest.raises(CameraError, match=f"{name}: '{value}' is not a number between"):
            parse_camera(text(value))


@pytest.mark.parametrize(("fovy", "accepted"), [(0.001, True), (0.000999, False), (179.999, True), (180.0, False)])
def test_limits_of_the_field_of_view(fovy: float, accepted: bool) -> None:
    spec = LookAtCamera((0, -5, 0), (0, 0, 0))
    for make in (
        lambda: parse_camera(f"eye=1,2,3;target=0,0,0;fovy={fovy}"),
        lambda: resolve_camera(spec, Node(), 200, 100, fovy=fovy),
    ):
        if accepted:
            make()
        else:
            with pytest.raises(CameraError, match=r"at least 0.001 and less than 180"):
                make()


def test_the_longest_text_is_accepted() -> None:
    assert parse_camera("fit" + " " * (MAX_CAMERA_CHARACTERS - 3)) == FitCamera()
    with pytest.raises(CameraError, match=f"{MAX_CAMERA_CHARACTERS + 1} characters"):
        parse_camera("fit" + " " * (MAX_CAMERA_CHARACTERS - 2))


@pytest.mark.parametrize("at", [(0, 1), (1, 0), (0, 2), (2, 0), (1, 2), (2, 1)])
def test_a_sheared_node_keeps_its_forward_axis(at: tuple[int, int]) -> None:
    sheared = np.eye(4)
    sheared[at] = 0.75
    X = tf.from_pose((1, -2, 3), (0.5, 0.5, -0.5, 0.5)) @ sheared
    pose = camera_at(X).X_world_camera
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
    np.testing.assert_allclose(pose[:3, 2], X[:3, 2] / np.linalg.norm(X[:3, 2]), atol=1e-12)
    assert pose[:3, 0] @ X[:3, 0] > 0.0
    np.testing.assert_array_equal(pose[:3, 3], X[:3, 3])


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(("value", "accepted"), [(1e12, True), (-1e12, True), (-1e13, False), (1e13, False)])
def test_nodes_too_far_from_the_origin_are_no_cameras(axis: int, value: float, accepted: bool) -> None:
    X = np.eye(4)
    X[axis, 3] = value
    if accepted:
        assert camera_at(X).X_world_camera[axis, 3] == value
    else:
        with pytest.raises(CameraError, match="no usable axes"):
            camera_at(X)


def test_a_far_plane_of_the_caller_moves_the_near_plane() -> None:
    spec, root = LookAtCamera((0, -500, 0), (0, 0, 0)), tree(((1, 1, 1), (0, 0, 0)))
    assert resolve_camera(spec, root, 64, 48, far=100.0).near == 50.0
    assert resolve_camera(spec, root, 64, 48, near=1000.0).far == 2000.0


def test_an_orthographic_camera_shows_lengths_at_any_distance_alike_and_depth_linearly() -> None:
    """Two rods of 1 m, 1 m and 5 m before the eye, and a slope between."""
    width = 200
    rods = [box(), box()]
    poses = [tf.translation(0.0, -0.6, 1.5), tf.translation(0.0, 0.6, 5.5)]
    slope = Mesh(
        np.array(((-1, -0.05, 1), (1, -0.05, 5), (1, 0.05, 5), (-1, 0.05, 1)), np.float32),
        np.array(((0, 1, 2), (0, 2, 3)), np.uint32),
    )
    scene = DrawList(
        (
            *(Instance(rod, Material(), X, k) for k, (rod, X) in enumerate(zip(rods, poses, strict=True))),
            Instance(slope, Material(), np.eye(4), 2),
        )
    )
    camera = resolve_camera(
        parse_camera("eye=0,0,0;target=0,0,1;up=0,-1,0;xmag=1"), Node(), width, width, draw_list=scene
    )
    renderer = CpuRenderer(1)
    frame = renderer.render(scene, camera, Output.DEPTH | Output.LABEL)
    for label, row, depth in ((0, 40, 1.0), (1, 160, 5.0)):
        columns = np.flatnonzero(frame.label[row] == label)
        assert abs(len(columns) - width / 2) <= 1
        assert abs(columns.mean() + 0.5 - width / 2) <= 0.5
        np.testing.assert_allclose(frame.depth[row, columns], depth, atol=1e-3)
    x = (np.arange(width) + 0.5) / (width / 2) - 1.0
    np.testing.assert_allclose(frame.depth[width // 2], 3.0 + 2.0 * x, atol=5e-3)
    renderer.close()
