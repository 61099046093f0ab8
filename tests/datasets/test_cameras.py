"""Cameras of datasets: the camera file, orbits, intrinsics."""

import json
import os
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway.datasets.errors import DatasetError
from gateway.datasets.job import make_job
from gateway.datasets.scene_sources import find_sources
from gateway.datasets.scenes import load_scene
from gateway.datasets.views import CameraFile, Intrinsics, View, camera_of, read_camera_file, record_of, usable_camera
from gateway.files.gltf import PlacedCamera
from gateway.scene.draw.cameras import CameraError, OrbitCamera
from gateway.scene.tree.nodes import Node
from renderers.camera import Camera
from renderers.drawlist import DrawList
from scenegate.datasets.manifest import CameraRecord, pose_rows
from tests.datasets.conftest import SETTINGS, job_of, named

POSE = [[1, 0, 0, 0], [0, 0, 1, -3], [0, -1, 0, 1], [0, 0, 0, 1]]
"""3 m before the origin on -y, 1 m high, looking along +y."""


def written(folder: Path, content: Any) -> Path:
    path = folder / "cameras.json"
    path.write_text(json.dumps(content))
    return path


def test_camera_file(scenes: Path, tmp_path: Path) -> None:
    opengl = (np.array(POSE) @ np.diag((1, -1, -1, 1))).tolist()
    cameras = [{"camera": "fit", "width": 40}, {"name": "top", "X_world_camera": POSE, "fx": 50, "fy": 60}]
    placed = {"X_world_camera": opengl, "convention": "opengl", "fovy": 60}
    file = read_camera_file(written(tmp_path, {"cameras": cameras, "scenes": {"a.gltf": [placed]}}))
    job = job_of(scenes, tmp_path / "out", orbit=0, cameras=file)
    views = {source.name: job.views_of(source) for source in job.sources}
    assert [view.name for view in views["robot.tree.json"]] == ["camera-000", "top"]
    (own,) = views["a.gltf"]
    assert own.pose == tuple(map(tuple, np.array(POSE, float).tolist()))
    robot = load_scene(named(scenes, "robot.tree.json"))
    first, top = (camera_of(view, robot.root, robot.draw_list, None, 32, 24, 45.0) for view in views["robot.tree.json"])
    assert (first.width, first.height) == (40, 24)
    assert (top.fx, top.fy, top.cx, top.cy) == (50, 60, 16, 12)
    assert np.array_equal(top.X_world_camera, POSE)
    assert top.near < 2.7 < 3.3 < top.far


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ({}, "names no camera"),
        ({"camera": []}, "unknown field `camera`"),
        ({"cameras": [{}]}, "cameras[0]: needs either 'camera'"),
        ({"cameras": [{"camera": "fit", "X_world_camera": POSE}]}, "cameras[0]: needs either"),
        ({"cameras": [{"camera": "fitt"}]}, "cameras[0]: camera 'fitt' is not one of"),
        ({"cameras": [{"camera": "stereo"}]}, "there is no stereo camera"),
        ({"cameras": [{"camera": "fit", "name": "../x"}]}, "the view's name '../x'"),
        ({"cameras": [{"camera": "fit", "name": "x"}] * 2}, "cameras[1]: the name 'x' is taken"),
        ({"cameras": [{"camera": "fit", "width": 0}]}, "Expected `int` >= 1"),
        ({"cameras": [{"camera": "fit", "fovy": 30, "fy": 100}]}, "fovy and fy say the same"),
        ({"cameras": [{"X_world_camera": [[2, 0, 0, 0], *POSE[1:]]}]}, "scaled, sheared or mirrored"),
        ({"cameras": [{"X_world_camera": [[0, 0, 0, 0]] * 4}]}, "last of them 0, 0, 0, 1"),
        ({"scenes": {"b": [{"camera": "eye=1"}]}}, "scenes['b'][0]: "),
    ],
)
def test_bad_camera_files_are_explained(tmp_path: Path, content: Any, sentence: str) -> None:
    with pytest.raises(CameraError) as raised:
        read_camera_file(written(tmp_path, content))
    assert sentence in str(raised.value)


def test_views_and_scenes_that_cannot_be_meant(scenes: Path, tmp_path: Path) -> None:
    sources = find_sources([scenes])
    file = read_camera_file(written(tmp_path, {"scenes": {"z.gltf": [{"camera": "fit"}]}}))
    with pytest.raises(DatasetError, match=r"scenes that are not there: z.gltf"):
        make_job(sources, (), file, SETTINGS, tmp_path / "out")
    with pytest.raises(DatasetError, match="two views are called 'x'"):
        make_job(sources, (View("x", "fit"), View("x", "fit")), CameraFile(), SETTINGS, tmp_path)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "a.gltf").write_text("{}")
    with pytest.raises(DatasetError, match=r"would both be called a.gltf"):
        find_sources([scenes, tmp_path / "other"])
    with pytest.raises(DatasetError, match="is not a scene"):
        find_sources([scenes / "notes.txt"])


def test_every_camera_of_an_orbit_sees_everything_from_the_same_distance(scenes: Path) -> None:
    scene = load_scene(named(scenes, "robot.tree.json"))
    centre = np.array((0.0, 0.0, 0.4))  # of a cylinder from -0.1 to 0.1 and a box up to 0.9
    distances: list[float] = []
    azimuths: list[float] = []
    for index in range(6):
        camera = camera_of(View("v", OrbitCamera(index, 6, 20.0)), scene.root, scene.draw_list, None, 64, 48, 45.0)
        corners = np.array([(x, y, z, 1) for x in (-0.3, 0.3) for y in (-0.3, 0.3) for z in (-0.1, 0.9)])
        x, y, z, _ = camera.X_camera_world @ corners.T
        assert (z > camera.near).all()
        assert (np.abs(camera.fx * x / z) <= 32).all()
        assert (np.abs(camera.fy * y / z) <= 24).all()
        offset = camera.X_world_camera[:3, 3] - centre
        distances.append(float(np.linalg.norm(offset)))
        azimuths.append(float(np.degrees(np.arctan2(offset[1], offset[0])) % 360.0))
        assert offset[2] / distances[-1] == pytest.approx(np.sin(np.radians(20.0)))
    assert distances == pytest.approx([distances[0]] * 6)
    assert azimuths == pytest.approx([0, 60, 120, 180, 240, 300])


def test_intrinsics_replace_those_of_the_pose(scenes: Path) -> None:
    scene = load_scene(named(scenes, "robot.tree.json"))

    def resolved(intrinsics: Intrinsics) -> Camera:
        return camera_of(View("v", "fit", intrinsics), scene.root, scene.draw_list, None, 64, 48, 90.0)

    default = resolved(Intrinsics())
    assert (default.width, default.height, default.cx, default.cy) == (64, 48, 32.0, 24.0)
    assert default.fx == default.fy == pytest.approx(24.0)
    assert resolved(Intrinsics(fovy=60.0)).fy == pytest.approx(24.0 / np.tan(np.radians(30.0)))
    assert resolved(Intrinsics(fx=50.0)).fx == 50.0
    assert resolved(Intrinsics(fx=50.0)).fy == pytest.approx(24.0)
    assert (resolved(Intrinsics(fy=50.0)).fx, resolved(Intrinsics(fy=50.0)).fy) == (50.0, 50.0)
    shifted = resolved(Intrinsics(width=100, height=80, cx=0.0, cy=1.5, near=0.25, far=9.0))
    assert (shifted.width, shifted.height, shifted.cx, shifted.cy) == (100, 80, 0.0, 1.5)
    assert (shifted.near, shifted.far) == (0.25, 9.0)
    with pytest.raises(CameraError, match="camera: clipping planes"):
        resolved(Intrinsics(near=9.0, far=9.0))


def test_without_a_pose_the_camera_of_the_file_is_used(scenes: Path) -> None:
    root, drawn = Node(), DrawList()
    own = PlacedCamera(0, "main", np.eye(4), yfov=np.pi / 2, znear=0.5, zfar=None)
    camera = camera_of(View("v", None, Intrinsics(cx=1.0)), root, drawn, own, 64, 48, 45.0)
    assert camera.fx == camera.fy == pytest.approx(24.0)
    assert (camera.cx, camera.cy) == (1.0, 24.0)
    assert (camera.near, camera.far) == (0.5, np.inf)
    assert camera_of(View("v", None), root, drawn, replace(own, zfar=3.0), 64, 48, 45.0).far == 3.0
    with pytest.raises(CameraError, match="'main': it has neither yfov nor xmag"):
        camera_of(View("v", None), root, drawn, replace(own, yfov=None), 64, 48, 45.0)
    with pytest.raises(CameraError, match="the file's camera 'main': "):
        camera_of(View("v", None), root, drawn, replace(own, X_world_camera=np.zeros((4, 4))), 64, 48, 45.0)


def test_the_orthographic_camera_of_a_file(scenes: Path) -> None:
    own = PlacedCamera(0, "main", np.eye(4), yfov=None, znear=0.5, zfar=9.0, xmag=2.0)
    for intrinsics, planes in ((Intrinsics(), (0.5, 9.0)), (Intrinsics(near=1.0, far=3.0), (1.0, 3.0))):
        camera = camera_of(View("v", None, intrinsics), Node(), DrawList(), own, 64, 48, 45.0)
        origin = camera.depth_origin
        assert (camera.near - origin, camera.far - origin) == pytest.approx(planes)
        assert camera.X_world_camera[2, 3] == -origin
        assert 32 / camera.fx * origin == pytest.approx(2.0, rel=1e-3)
        assert record_of(camera).depth_origin == origin


def test_records_of_cameras() -> None:
    values: Any = {"width": 4, "height": 3, "fx": 2.0, "fy": 2.5, "cx": 1.5, "cy": 1.0, "near": 0.1}
    X = np.diag((1.0, -1.0, -1.0, 1.0))
    for far, recorded in ((np.inf, None), (7.0, 7.0)):
        record = record_of(Camera(**values, far=far, X_world_camera=X))
        assert record == CameraRecord(**values, far=recorded, X_world_camera=pose_rows(X))


@pytest.mark.parametrize(
    ("x", "is_valid"), [(1.0, True), (1.00004, True), (1.00006, False), (float("nan"), False), (-1.0, False)]
)
def test_poses_are_rotations_up_to_five_digits(x: float, is_valid: bool) -> None:
    rows = ((x, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    with nullcontext() if is_valid else pytest.raises(CameraError, match=r"X_world_camera must be|mirrored"):
        assert View("v", rows).pose == rows


@pytest.mark.parametrize("size", [1000, 1001])
def test_unnamed_cameras_are_numbered_with_equal_width(tmp_path: Path, size: int) -> None:
    file = read_camera_file(written(tmp_path, {"cameras": [{"camera": "fit"}] * size}))
    assert file.default_views[7].name == ("camera-007" if size == 1000 else "camera-0007")
    assert len({len(view.name) for view in file.default_views}) == 1


def test_camera_files_that_cannot_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(CameraError, match=r"none\.json: No such file"):
        read_camera_file(tmp_path / "none.json")
    os.mkfifo(tmp_path / "pipe.json")
    with pytest.raises(CameraError, match=r"pipe\.json: it is not a regular file"):
        read_camera_file(tmp_path / "pipe.json")
    path = written(tmp_path, {"cameras": [{"camera": "fit"}]})
    monkeypatch.setattr("gateway.datasets.views.MAX_FILE_BYTES", path.stat().st_size)
    assert len(read_camera_file(path).default_views) == 1
    monkeypatch.setattr("gateway.datasets.views.MAX_FILE_BYTES", path.stat().st_size - 1)
    with pytest.raises(CameraError, match="more than"):
        read_camera_file(path)
    (tmp_path / "cameras.json").write_bytes(b"\xff")
    with pytest.raises(CameraError, match=r"cameras\.json"):
        read_camera_file(path)


def test_different_views_have_different_descriptions() -> None:
    rows = pose_rows(np.array(POSE, np.float64))
    moved = (rows[0], rows[1], (*rows[2][:3], 2.0), rows[3])
    poses = None, "fit", OrbitCamera(0, 2, 30.0), OrbitCamera(0, 2, 31.0), rows, moved
    views = [View("v", pose) for pose in poses]
    views += [View("v", "fit", intrinsics) for intrinsics in (Intrinsics(width=3), Intrinsics(height=3))]
    assert len({view.description for view in views}) == len(views)


@pytest.mark.parametrize(
    "flaw", [{"yfov": None}, {"yfov": 0.0}, {"yfov": 9.0}, {"znear": -1.0}, {"yfov": None, "xmag": 0.0}]
)
def test_cameras_of_a_file_that_cannot_be_used_have_a_warning(flaw: dict[str, Any]) -> None:
    good = PlacedCamera(1, "good", np.eye(4), yfov=1.0, znear=0.5, zfar=None)
    bad = replace(good, name="bad", **flaw)
    camera, (warning,) = usable_camera([bad, good], DrawList())
    assert camera is good
    assert warning.startswith("the file's camera 'bad'")
    assert usable_camera([bad], DrawList()) == (None, (warning,))
