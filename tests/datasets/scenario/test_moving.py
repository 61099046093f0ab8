"""Moving scenes: tracks of joints and poses, animations of glTF files, and cameras on paths."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.datasets.rendering import flow_between, instance_motions
from gateway.datasets.scenario.tables import ScenarioError
from gateway.datasets.scenario.tracks import read_track
from gateway.datasets.scene_sources import find_sources
from gateway.datasets.scenes import LoadedScene, load_scene
from gateway.datasets.views import SceneCamera, View, camera_of, scene_views
from gateway.files.robots.reader import read_robot
from renderers.interface import Look, Output
from renderers.raster import CpuRenderer
from tests.datasets.scenario.conftest import Write
from tests.files.gltf.builder import TRIANGLE, Builder

FRAMES = "frames = {count = 5, rate = 2}\nsurfaces = [{}]\n"


def at(scene: LoadedScene, frame: int, camera: int = 0) -> tuple[LoadedScene, View]:
    return scene.at_frame_of(View("v", SceneCamera(camera, frame)))


def load(path: Path) -> LoadedScene:
    return load_scene(find_sources([path])[0])


def world(scene: LoadedScene, *path: str) -> NDArray[np.float64]:
    (name,) = scene.root.children["models"].children
    matrix = scene.root.world_matrix(("models", name, *path))
    assert matrix is not None
    return matrix


def test_a_track_of_poses(write: Write) -> None:
    path = write(FRAMES + "models = [{path = 'models/can.urdf', pose_track = 'poses.csv', scale = 2}]")
    (path.parent / "poses.csv").write_text("time,x,y,z,qw,qx,qy,qz\n0,0,0,1,1,0,0,0\n1,2,0,1,0,0,0,1\n")
    scene = load(path)
    quarter, half = [(0, -1), (1, 0)], -np.eye(2)
    for frame, x, turn in ((0, 0.0, np.eye(2)), (1, 1.0, quarter), (2, 2.0, half), (4, 2.0, half)):
        X = world(at(scene, frame)[0])
        np.testing.assert_allclose(X[:3, 3], (x, 0.0, 1.0), atol=1e-12)
        np.testing.assert_allclose(X[:2, :2], 2.0 * np.array(turn), atol=1e-12)
    assert at(scene, 0)[0] is scene


def test_a_track_of_joints(write: Write) -> None:
    path = write(FRAMES + "models = [{path = 'models/arm.urdf', joint_track = 'arm.csv', position = [0, 0, 0]}]")
    (path.parent / "arm.csv").write_text("time, elbow\n0,0.0\n2, 1.0\n")
    scene = load(path)
    robot = read_robot(path.parent / "models" / "arm.urdf")
    for frame, value in ((0, 0.0), (1, 0.25), (4, 1.0)):
        posed = at(scene, frame)[0]
        base, hand = world(posed, "model", "arm", "base"), world(posed, "model", "arm", "hand")
        expected = robot.link_poses({"elbow": value})[robot.links.index("hand")]
        np.testing.assert_allclose(np.linalg.inv(base) @ hand, expected, atol=1e-12)
    assert {each.model for each in scene.objects} == {"arm/base", "arm/upper", "arm/lower", "arm/hand"}


def animated(path: Path, interpolation: str = "LINEAR") -> None:
    """Write a triangle that moves along x by 4 m in 2 s, and one that turns about z by 90 degrees."""
    builder = Builder()
    position = builder.accessor(TRIANGLE)
    mesh = builder.mesh({"attributes": {"POSITION": position}})
    builder.json["nodes"] = [{"name": "slider", "mesh": mesh}, {"name": "wheel", "mesh": mesh}]
    builder.json["scenes"], builder.json["scene"] = [{"nodes": [0, 1]}], 0
    times = builder.accessor([0.0, 2.0])
    half = math.sqrt(0.5)
    slide = [(0, 0, 0), (4, 0, 0)]
    turn = [(0, 0, 0, 1), (0, 0, half, half)]
    if interpolation == "CUBICSPLINE":
        slide = [value for each in slide for value in ((8, 0, 0), each, (4, 0, 0))]  # in-tangent, value, out-tangent
        turn = [value for each in turn for value in ((0, 0, 0, 0), each, (0, 0, 0, 0))]
    outputs = [builder.accessor(slide), builder.accessor(turn)]
    samplers = [{"input": times, "output": each, "interpolation": interpolation} for each in outputs]
    channels = [
        {"sampler": k, "target": {"node": k, "path": path}} for k, path in enumerate(("translation", "rotation"))
    ]
    builder.json["animations"] = [{"name": "go", "samplers": samplers, "channels": channels}]
    path.write_text(json.dumps(builder.json))


@pytest.mark.parametrize(
    ("interpolation", "x", "degrees"),
    [("LINEAR", 1.0, 22.5), ("STEP", 0.0, 0.0), ("CUBICSPLINE", 2 * 4 * 9 / 64 + 4 * 10 / 64 - 2 * 8 * 3 / 64, None)],
)
def test_an_animation_of_a_gltf_file(write: Write, interpolation: str, x: float, degrees: float | None) -> None:
    path = write(
        FRAMES + "models = [{path = 'a.gltf', animation = 'go', position = [0, 0, 0], rotation = [0, 0, 0], up = 'z'}]"
    )
    animated(path.parent / "a.gltf", interpolation)
    scene = load(path)
    posed = at(scene, 1)[0]  # 0.5 s of 2 s
    np.testing.assert_allclose(world(posed, "model", "slider")[:3, 3], (x, 0.0, 0.0), atol=1e-6)
    if degrees is not None:
        cosine = math.cos(math.radians(degrees))
        np.testing.assert_allclose(world(posed, "model", "wheel")[0, 0], cosine, atol=1e-6)
    np.testing.assert_allclose(world(at(scene, 4)[0], "model", "slider")[:3, 3], (4.0, 0.0, 0.0), atol=1e-6)


def test_an_animation_that_does_not_exist(write: Write) -> None:
    path = write(FRAMES + "models = [{path = 'a.gltf', animation = 'run', position = [0, 0, 0]}]")
    animated(path.parent / "a.gltf")
    with pytest.raises(ValueError, match=r"a\.gltf: .*'run'.* go"):
        load(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,time\n1,2", "line 1: it must be time and the names of other columns"),
        ("time,elbow,elbow\n", "line 1: it must be time and the names of other columns"),
        ("time,elbow\n", "it has no row"),
        ("time,elbow\n0,1\n1,x", "line 3: it must be 2 finite numbers"),
        ("time,elbow\n0,1\n1", "line 3: it must be 2 finite numbers"),
        ("time,elbow\n0,nan", "line 2: it must be 2 finite numbers"),
        pytest.param("time,elbow\n0,1\n1," + 131_073 * "1", "line 3: field larger than field limit", id="long"),
        ("time,elbow\n1,0\n0,0", "line 3: it must be 2 finite numbers, the time not before the last"),
    ],
)
def test_errors_of_tracks_name_the_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "track.csv"
    path.write_text(text)
    with pytest.raises(ScenarioError, match=message):
        read_track(path, poses=False)


def test_errors_of_tracks_of_poses(tmp_path: Path) -> None:
    path = tmp_path / "track.csv"
    path.write_text("time,x,y,z\n0,0,0,0\n")
    with pytest.raises(ScenarioError, match=r"line 1: .*time,x,y,z,qw,qx,qy,qz"):
        read_track(path, poses=True)
    for values, message in (
        ("0,0,0,0,0,0,0", "the length of a quaternion must be from 0.001 to 1000, not 0"),
        ("0,0,0,1e-300,0,0,0", "the length of a quaternion must be from 0.001 to 1000, not 1e-300"),
        ("0,0,0,0,1e308,0,0", "the length of a quaternion must be from 0.001 to 1000, not 1e\\+308"),
        ("0,1e30,0,1,0,0,0", r"a coordinate must be from -1000 to 1000 m, not \[0.0, 1e\+30, 0.0\]"),
    ):
        path.write_text(f"time,x,y,z,qw,qx,qy,qz\n0,0,0,0,1,0,0,0\n\n1,{values}\n")
        with pytest.raises(ScenarioError, match=f"track.csv: line 4: {message}"):
            read_track(path, poses=True)
    with pytest.raises(ScenarioError, match="No such file"):
        read_track(tmp_path / "none.csv", poses=True)


def test_a_handheld_camera_moves_smoothly_and_sees_the_objects(write: Write) -> None:
    path = write(
        "frames = {count = 40, rate = 20}\nmodels = [{path = 'models/can.urdf', count = 3}]\n"
        "surfaces = [{area = [0.5, 0.5]}]\ncameras = [{kind = 'handheld'}, "
        "{kind = 'fixed', eye = [2, 0, 1], target = [0, 0, 0]}]"
    )
    scene = load(path)
    poses = []
    for frame in range(40):
        posed, view = at(scene, frame)
        poses.append(camera_of(view, posed.root, posed.draw_list, None, 64, 48, 45.0).X_world_camera)
    centres = np.array([X[:3, 3] for X in poses])
    steps = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    assert 0.0 < steps.max() < 0.2 * np.ptp(centres, axis=0).max()
    assert np.linalg.norm(np.diff(centres, 2, axis=0), axis=1).max() < 0.5 * steps.max()
    assert at(scene, 0, 1)[1].pose == at(scene, 39, 1)[1].pose
    assert [view.name for view in scene_views(2, 40)][39:41] == ["camera-000-frame-0039", "camera-001-frame-0000"]


def test_flow_follows_objects_that_move(write: Write) -> None:
    """The flow of a can that moves by 0.1 m along x, seen from above by a camera at rest, is that many pixels."""
    path = write(
        "frames = {count = 2, rate = 1}\nmodels = [{path = 'models/can.urdf', pose_track = 'p.csv'}]\n"
        "cameras = [{kind = 'fixed', eye = [0, 0, 2], target = [0, 0, 0], up = [0, 1, 0]}]"
    )
    (path.parent / "p.csv").write_text("time,x,y,z,qw,qx,qy,qz\n0,0,0,0,1,0,0,0\n1,0.1,0,0,1,0,0,0\n")
    scene = load(path)
    (now, view), (then, _) = at(scene, 0), at(scene, 1)
    camera = camera_of(view, now.root, now.draw_list, None, 160, 120, 45.0)
    frame = CpuRenderer(1).render(now.draw_list, camera, Output.DEPTH | Output.INSTANCE, Look("studio"))
    assert frame.depth is not None
    assert frame.instance is not None
    X = instance_motions(now.draw_list, camera, then.draw_list, camera)[frame.instance]
    flow = flow_between(frame.depth, camera, camera, X)
    expected = 0.1 * camera.fx / frame.depth[60, 80]
    np.testing.assert_allclose(flow[60, 80], (expected, 0.0), atol=1e-3)
    np.testing.assert_allclose(flow[5, 5], (0.0, 0.0), atol=1e-3)
