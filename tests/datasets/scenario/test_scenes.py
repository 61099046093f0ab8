"""Scenes of scenarios: drawn by seed and number, apart from each other, at rest, and made again from their record."""

import hashlib
import itertools
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.cli.render import _parse_scene_numbers
from gateway.datasets.check import check_dataset
from gateway.datasets.errors import DatasetError
from gateway.datasets.job import Job, make_job
from gateway.datasets.rendering import render_images
from gateway.datasets.run import RunProgress, run
from gateway.datasets.scenario.choices import SceneChoices
from gateway.datasets.scenario.placement import CollisionSolid, are_apart, box_solid, rotation_of
from gateway.datasets.scene_sources import find_scenes, find_sources
from gateway.datasets.scenes import LoadedScene, SceneError, load_scene, model_names
from gateway.datasets.views import CameraFile, SceneCamera, View, camera_of
from gateway.datasets.worker import run_task
from gateway.scene.draw.flatten import flatten
from gateway.scene.draw.style import Style
from gateway.scene.tree.transforms import from_pose, translation
from renderers.light_rig import STUDIO
from renderers.raster import CpuRenderer
from scenegate.datasets import manifest
from tests.datasets.conftest import SETTINGS
from tests.datasets.scenario.conftest import TABLE, Write
from tests.files.robots.files import visual
from tests.support import forms
from tests.support.waiting import SECONDS

DROP = TABLE + "placement = {physics = 'mujoco'}\n"
ROOT = Path(__file__).parents[3]
Placed = tuple[float, float, float]
"""X, y and yaw in degrees."""


def scene(path: Path, number: int = 0, recorded: str = "") -> LoadedScene:
    return load_scene(replace(find_sources([path], range(number, number + 1))[0], recorded=recorded))


def choices(loaded: LoadedScene) -> SceneChoices:
    assert loaded.scenario is not None
    return loaded.scenario.choices


def digest_of(loaded: LoadedScene) -> bytes:
    """Return all that is drawn."""
    numbers = [
        instance.X_world_mesh.tobytes() + instance.mesh.positions.tobytes() for instance in loaded.draw_list.instances
    ]
    return b"".join(numbers) + manifest.encode(loaded.description)


def parts(loaded: LoadedScene, group: str) -> Iterator[tuple[str, list[NDArray[np.float64]]]]:
    """Yield the names of objects with the points of their parts in the world."""
    node = loaded.root.children.get(group)
    for name, child in node.children.items() if node is not None else ():
        instances = flatten(child).instances
        yield str(name), [i.mesh.positions @ i.X_world_mesh[:3, :3].T + i.X_world_mesh[:3, 3] for i in instances]


def test_lights_of_models_are_not_used(write: Write) -> None:
    path = write("models = [{path = 'lamp.gltf', count = 1}]\ncameras = [{kind = 'shell', count = 1}]\n")
    light = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    nodes = [{"mesh": 0, "extensions": {"KHR_lights_punctual": {"light": 0}}}]
    lamp = forms.gltf(generator="other", nodes=nodes, extensions=light)
    (path.parent / "lamp.gltf").write_text(json.dumps(lamp))
    loaded = scene(path)
    assert loaded.scenario is not None
    assert len(loaded.draw_list.lights) == 1
    assert loaded.scenario.scenery.rig.lights_of(loaded.draw_list) == STUDIO.lights


def test_names_and_numbers_of_scenes(write: Write) -> None:
    path = write()
    assert [source.name for source in find_sources([path])][::4] == ["desk-000000", "desk-000004", "desk-000008"]
    assert [source.number for source in find_sources([path], range(2, 4))] == [2, 3]
    with pytest.raises(DatasetError, match=r"desk.toml has the scenes 0 to 8, not 9"):
        find_sources([path], range(3, 10))


def test_scenes_are_independent_of_each_other_and_of_the_run(write: Write) -> None:
    path = write()
    first = [digest_of(scene(path, number)) for number in (0, 3, 7)]
    assert len(set(first)) == 3
    assert [digest_of(scene(path, number)) for number in (7, 3, 0)] == first[::-1]
    assert digest_of(scene(write(TABLE.replace("seed = 5", "seed = 6"), "desk"), 0)) != first[0]


def test_more_lights_move_nothing_else(write: Write) -> None:
    before, after = scene(write()), scene(write(TABLE + "lights = {lamps = [{intensity = [1, 2]}]}"))
    assert choices(before).objects == choices(after).objects
    assert choices(before).cameras == choices(after).cameras
    assert choices(before).light != choices(after).light


@pytest.mark.slow
def test_two_processes_make_the_same_scene(write: Write) -> None:
    pytest.importorskip("mujoco")
    path = write(DROP)
    code = (
        "import sys; from pathlib import Path; from tests.datasets.scenario.test_scenes import scene, digest_of\n"
        "import hashlib; print(hashlib.sha256(digest_of(scene(Path(sys.argv[1]), 4))).hexdigest())"
    )
    command = (sys.executable, "-c", code, str(path))
    ran = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=SECONDS)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.strip() == hashlib.sha256(digest_of(scene(path, 4))).hexdigest()


@pytest.mark.parametrize("text", [TABLE, DROP], ids=["placed", "dropped"])
def test_objects_are_apart_and_supported(write: Write, text: str) -> None:
    """The parts of the models are convex. A plane lies between each two of them, and each object lies on something."""
    if text is DROP:
        pytest.importorskip("mujoco")
    path = write(text)
    for number in range(4):
        loaded = scene(path, number)
        objects = list(parts(loaded, "models"))
        assert len(objects) >= 4, choices(loaded).notes
        (_, table), *_ = parts(loaded, "surfaces")
        height = table[0][:, 2].max()
        for (_, a), (_, b) in itertools.combinations(objects, 2):
            assert are_apart(CollisionSolid(tuple(a)), CollisionSolid(tuple(b)), 0.0)
        for name, bodies in objects:
            points = np.concatenate(bodies)
            assert points[:, 2].min() > height - 1e-6, name
            others = [CollisionSolid(tuple(each)) for other, each in objects if other != name]
            floats = points[:, 2].min() > height + 1e-3
            assert not floats or any(not are_apart(CollisionSolid(tuple(bodies)), other, 2e-3) for other in others), (
                name
            )
            assert (np.abs(points.mean(axis=0)[:2]) < (0.45, 0.35)).all(), name


def test_collisions_by_another_library(write: Write) -> None:
    for name in ("fcl", "scipy", "mujoco"):
        pytest.importorskip(name, reason=f"{name} is not installed")
    trimesh = pytest.importorskip("trimesh")
    loaded = scene(write(DROP), 2)
    managers = []
    for node in loaded.root.children["models"].children.values():
        manager = trimesh.collision.CollisionManager()
        for k, i in enumerate(flatten(node).instances):
            points = i.mesh.positions @ i.X_world_mesh[:3, :3].T + i.X_world_mesh[:3, 3]
            manager.add_object(str(k), trimesh.Trimesh(points, i.mesh.elements.astype(np.int64), process=False))
        managers.append(manager)
    assert not any(a.in_collision_other(b) for a, b in itertools.combinations(managers, 2))


def test_settled_objects_stay_when_they_drop_again(write: Write) -> None:
    pytest.importorskip("mujoco")
    from gateway.datasets.scenario.physics import settle
    from gateway.datasets.scenario.surfaces import solids_of

    loaded = scene(write(DROP), 1)
    inverses = [np.linalg.inv(np.array(each.X_world_object)) for each in choices(loaded).objects]
    solids = [
        CollisionSolid(tuple(points @ X[:3, :3].T + X[:3, 3] for points in bodies))
        for (_, bodies), X in zip(parts(loaded, "models"), inverses, strict=True)
    ]
    poses = [np.array(each.X_world_object) for each in choices(loaded).objects]
    obstacles = [box for surface in choices(loaded).surfaces for box in solids_of(surface)]
    again = settle(list(zip(solids, poses, strict=True)), obstacles, 1.0)
    for before, after in zip(poses, again, strict=True):
        assert after is not None
        np.testing.assert_allclose(after, before, atol=2e-3)


@pytest.mark.parametrize("points", [np.eye(3)[:2], np.eye(3)], ids=["a line", "a triangle"])
def test_flat_objects_come_to_rest(points: NDArray[np.float64]) -> None:
    pytest.importorskip("mujoco")
    from gateway.datasets.scenario.physics import MIN_THICKNESS, settle

    floor = CollisionSolid((np.array(list(itertools.product((-3.0, 3.0), (-3.0, 3.0), (-1.0, 0.0)))),))
    (pose,) = settle([(CollisionSolid((points,)), from_pose((0, 0, 0.1), (1, 0, 0, 0)))], [floor], 20.0)
    assert pose is not None
    heights = points @ pose[2, :3] + pose[2, 3]
    assert -MIN_THICKNESS < heights.min() <= heights.max() < 2 * MIN_THICKNESS


def test_a_scene_is_made_again_from_its_record_without_physics(
    write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mujoco")
    path = write(DROP)
    first = scene(path, 3)
    folder = tmp_path / "out" / "scenes" / "desk-000003"
    folder.mkdir(parents=True)
    record = manifest.encode_indented(first.description)
    (folder / "scene.json").write_bytes(record)
    monkeypatch.setattr("gateway.datasets.scenario.drawing.draw_choices", lambda *_: pytest.fail("it was drawn again"))
    again = scene(path, 3, str(tmp_path / "out"))
    assert digest_of(again) == digest_of(first)
    assert choices(again) == choices(first)
    (path.parent / "models" / "can.urdf").write_text((path.parent / "models" / "can.urdf").read_text() + "<!-- -->")
    used = any("can" in each.file for each in choices(first).objects)
    if used:
        with pytest.raises(pytest.fail.Exception, match="it was drawn again"):
            scene(path, 3, str(tmp_path / "out"))


def test_one_object_for_each_model_and_one_for_each_link_of_a_moving_robot(write: Write) -> None:
    arm = "{path = 'models/arm.urdf', position = [3, 0, 0], joints = {elbow = [0.5, 1.5]}}"
    path = write(TABLE.replace("models = [", f"distractors = [{{path = 'models/can.urdf'}}]\nmodels = [{arm}, "))
    loaded = scene(path)
    arms = [each for each in loaded.objects if each.model.startswith("arm")]
    assert [each.model for each in arms] == ["arm/base", "arm/upper", "arm/lower", "arm/hand"]
    names = {choice.name for choice in choices(loaded).objects if choice.entry == ("models", 1)}
    assert {each.path for each in loaded.objects if each not in arms} == {("models", name) for name in names}
    assert "distractors" in loaded.root.children
    assert {each.model for each in loaded.objects} <= model_names(find_sources([path])[0])
    (elbow,) = (each.joints["elbow"] for each in choices(loaded).objects if each.joints)
    assert 0.5 <= elbow[0] <= 1.5


def test_what_does_not_fit_or_cannot_be_read_is_left_out_with_a_note(write: Write) -> None:
    path = write(TABLE.replace("[!a]*", "*").replace("area = [0.6, 0.5]", "area = [0.1, 0.1]"))
    (path.parent / "models" / "broken.urdf").write_text("<robot")
    notes = [note for number in range(5) for note in scene(path, number).description.warnings]
    assert any("has no free place in 0.1 x 0.1 m after 200 tries; it is left out" in note for note in notes)
    assert any(note.startswith("models/broken.urdf: ") and note.endswith("it is left out") for note in notes)


def test_a_joint_that_the_robot_does_not_have_is_an_error(write: Write) -> None:
    path = write("[[models]]\npath = 'models/arm.urdf'\njoints = {elbows = 1}")
    with pytest.raises(SceneError, match=r"arm\.urdf: .*'elbows'"):
        scene(path)


def test_cameras_see_the_objects(write: Write) -> None:
    for number in range(5):
        loaded = scene(write(), number)
        for index in range(2):
            posed, view = loaded.at_frame_of(View(f"camera-{index:03d}", SceneCamera(index, None)))
            camera = camera_of(view, posed.root, posed.draw_list, None, 64, 48, 45.0)
            points = np.concatenate([p for _, bodies in parts(loaded, "models") for p in bodies])
            x, y, z = camera.X_camera_world[:3, :3] @ points.T + camera.X_camera_world[:3, 3:]
            assert (z > 0.0).all()
            assert (np.abs(x / z) * camera.fx <= 32.0).all()
            assert (np.abs(y / z) * camera.fy <= 24.0).all()


def test_textures_colours_and_sensor_are_drawn(write: Write) -> None:
    from PIL import Image

    path = write(
        TABLE
        + """
materials = {textures = "images", roughness = [0.2, 0.9], share = 0.5}
backgrounds = {images = "images"}
sensor = {blur = [0, 0.7], gain = [0, 20]}
lights = {lamps = [{color = [[1, 0.5, 0.5], [0.5, 0.5, 1]]}], turn = [-180, 180]}
"""
    )
    (path.parent / "images").mkdir()
    for k in range(3):
        Image.new("RGB", (8, 8), (80 * k, 100, 50)).save(path.parent / "images" / f"{k}.png")
    drawn = [choices(scene(path, number)) for number in range(6)]
    assert len({each.background.image for each in drawn}) > 1
    materials = [each.material for one in drawn for each in one.objects]
    assert 0.2 < np.mean([each is None for each in materials]) < 0.8
    assert {each.texture for each in materials if each is not None} == {f"images/{k}.png" for k in range(3)}
    assert len({each.sensor.gain for each in drawn if each.sensor is not None}) == 6
    used = {file.path for file in scene(path).description.sources}
    assert used == {each.file for each in drawn[0].objects} | {drawn[0].background.image} | {
        each.material.texture for each in drawn[0].objects if each.material is not None
    }


def test_a_dataset_of_a_scenario(write: Write, tmp_path: Path) -> None:
    """Numbers of scenes, a run that goes on, records of another dataset, and what is refused."""
    path = write()

    def make(out: str, *numbers: int, recorded: Path | None = None) -> Job:
        chosen = range(numbers[0], numbers[-1] + 1)
        sources, cameras, digest = find_scenes([path], CameraFile(), chosen, recorded, tmp_path / out, False)
        return make_job(sources, (), cameras, msgspec.structs.replace(SETTINGS, scenario_sha256=digest), tmp_path / out)

    def render(job: Job) -> RunProgress:
        return run(job, lambda tasks: map(run_task, tasks), lambda progress: None)

    first = render(make("first", 2, 3))
    assert (first.rendered, first.failures) == (4, {})
    assert check_dataset(tmp_path / "first", 1).problems == []
    assert render(make("first", 1, 3)).kept == 4
    alone = render(make("alone", 3, recorded=tmp_path / "first"))
    assert alone.rendered == 2
    for file in sorted((tmp_path / "first" / "scenes" / "desk-000003").iterdir()):
        assert (tmp_path / "alone" / "scenes" / "desk-000003" / file.name).read_bytes() == file.read_bytes()
    path.write_text(TABLE.replace("seed = 5", "seed = 6"))
    with pytest.raises(DatasetError, match=r"--recorded .*first: .*desk.toml"):
        make("other", 3, recorded=tmp_path / "first")
    with pytest.raises(DatasetError, match="other settings: the scenario"):
        render(make("first", 3))


Edit = Callable[[dict[str, Any]], object]


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda c: c.update(seed=1), "scene 3 of seed 1"),
        (lambda c: c.update(cameras=[]), "surfaces and cameras"),
        (lambda c: c["surfaces"].clear(), "surfaces and cameras"),
        (lambda c: c["objects"][0].update(entry=["models", -7]), r"models.*-7"),
        (lambda c: c["objects"][0].update(entry=["seed", 0]), "seed.*0"),
        (lambda c: c["objects"][0].update(file="/etc/passwd"), "'/etc/passwd'.* is no model of"),
        (lambda c: c["objects"][0].update(model="other"), "'other'.* is no model of"),
        (lambda c: c["objects"][0].update(scale=1e300), r"Expected `float` <= 1000.0 - at `\$.objects\[0\].scale`"),
        (lambda c: c["objects"][0]["X_world_object"][0].__setitem__(3, 1e300), r"Expected `float` <= 1000000000.0"),
        (lambda c: c["objects"][0]["X_world_object"][0].__setitem__(0, 5.0), "is not a rigid pose"),
        (lambda c: c["objects"].append(c["objects"][0]), "two objects have the same name"),
        (lambda c: c["cameras"][0].update(X_world_camera=[]), "a camera has not one pose"),
        (lambda c: c["background"].update(image="/etc/passwd"), "'/etc/passwd' is no file"),
        (lambda c: c["surfaces"][0]["material"].update(texture="a.png"), "'a.png' is no file"),
    ],
)
def test_records_that_were_edited_are_refused(write: Write, tmp_path: Path, edit: Edit, message: str) -> None:
    path = write()
    record = json.loads(manifest.encode(scene(path, 3).description))
    edit(record["scenario"])
    file = tmp_path / "out" / "scenes" / "desk-000003" / "scene.json"
    file.parent.mkdir(parents=True)
    file.write_bytes(msgspec.json.encode(record))
    with pytest.raises(SceneError, match=f"^{file}: scenario: .*{message}"):
        scene(path, 3, str(tmp_path / "out"))


@pytest.mark.parametrize(
    ("a", "b", "gap", "expected"),
    [
        ((0.0, 0.0, 0.0), (1.2, 0.0, 0.0), 0.0, True),
        ((0.0, 0.0, 0.0), (1.2, 0.0, 0.0), 0.3, False),
        ((0.0, 0.0, 0.0), (0.9, 0.0, 0.0), 0.0, False),
        ((0.0, 0.0, 45.0), (1.15, 0.0, 0.0), 0.0, False),
        ((0.0, 0.0, 45.0), (1.25, 0.0, 0.0), 0.0, True),
        ((0.0, 0.0, 45.0), (0.9, 0.9, 0.0), 0.05, True),  # although their bounds overlap
        ((0.0, 0.0, 45.0), (0.8, 0.8, 0.0), 0.0, False),
    ],
)
def test_exact_distances_of_boxes(a: Placed, b: Placed, gap: float, expected: bool) -> None:
    """A turned unit box reaches 0.707 along x."""
    first, second = (
        box_solid(translation(x, y, 0.0) @ rotation_of(0.0, 0.0, yaw), (1.0, 1.0, 1.0)) for x, y, yaw in (a, b)
    )
    assert (are_apart(first, second, gap), are_apart(second, first, gap)) == (expected, expected)


def test_objects_without_extent_are_left_out(write: Write) -> None:
    text = "models = [{path = 'point.obj'}, {path = 'models/can.urdf', scale = 1e-300}, {path = 'models/ball.urdf'}]"
    path = write(text)
    (path.parent / "point.obj").write_text("v 0 0 0\nv 0 0 1e-30\nf 1 1 2\n")
    loaded = scene(path)
    assert [each.file for each in choices(loaded).objects] == ["models/ball.urdf"]
    for name, warning in zip(
        ("point m0.0 (point.obj)", "can m1.0 (models/can.urdf)"), choices(loaded).notes, strict=True
    ):
        assert warning.startswith(f"{name} has an extent of ")
        assert warning.endswith(" m, 1e-06 m are the least; it is left out")


def test_errors_name_the_scenario_once(write: Write) -> None:
    with pytest.raises(SceneError, match=r"^models\[0\].path: 'none' names no file"):
        scene(write("models = [{path = 'none'}]"))


def test_two_scenarios_of_one_name(write: Write, tmp_path: Path) -> None:
    path = write()
    (tmp_path / path.name).write_text(path.read_text())
    with pytest.raises(DatasetError, match="would both be called desk-000000; rename one"):
        find_sources([path, tmp_path / path.name])


def test_numbers_of_scenes_of_a_command() -> None:
    assert [_parse_scene_numbers(text) for text in ("7", "2-4", "")] == [range(7, 8), range(2, 5), None]
    for text in ("1-", "-1", "3-2", "a", "-"):
        with pytest.raises(ValueError, match="must be a number, or FIRST-LAST"):
            _parse_scene_numbers(text)


def test_options_of_scenarios_without_a_scenario(write: Write, tmp_path: Path) -> None:
    model = write().parent / "models" / "can.urdf"
    with pytest.raises(DatasetError, match="--scenes and --recorded are for scenarios"):
        find_scenes([model], CameraFile(), range(1), None, tmp_path, False)


def test_an_environment_map_and_a_background_change_the_colour_only(write: Write) -> None:
    import cv2

    plain = write(TABLE, "plain")
    rich = write(TABLE + "lights = {environments = 'sky.hdr'}\nbackgrounds = {images = 'behind.png'}", "rich")
    cv2.imwrite(str(plain.parent / "sky.hdr"), np.full((16, 32, 3), (0.2, 0.2, 2.0), np.float32))
    cv2.imwrite(str(plain.parent / "behind.png"), np.full((30, 40, 3), (0, 200, 0), np.uint8))
    images = []
    for path in (plain, rich):
        loaded, view = scene(path).at_frame_of(View("v", SceneCamera(0, None)))
        camera = camera_of(view, loaded.root, loaded.draw_list, None, 64, 48, 45.0)
        images.append(render_images(CpuRenderer(1), loaded, camera, {"color": "png", "depth": "tiff"}, Style()))
    assert images[0]["depth"] == images[1]["depth"]
    colors = [np.asarray(cv2.imdecode(np.frombuffer(each["color"], np.uint8), cv2.IMREAD_COLOR)) for each in images]
    depth = cv2.imdecode(np.frombuffer(images[0]["depth"], np.uint8), cv2.IMREAD_UNCHANGED)
    assert depth is not None
    assert np.isinf(depth).any()
    inside = cv2.erode(np.isinf(depth).astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=1) > 0
    np.testing.assert_array_equal(colors[1][inside], np.broadcast_to((0, 200, 0), (int(inside.sum()), 3)))
    surface = cv2.erode(np.isfinite(depth).astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=1) > 0
    redder = colors[1][surface].mean(axis=0) - colors[0][surface].mean(axis=0)
    assert redder[2] - redder[0] > 20.0


def test_physics_without_its_package_is_one_sentence(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(SceneError, match=r"placement.physics: .*'scenegate\[robots\]'"):
        scene(write(DROP))


def test_objects_that_fall_off_are_left_out_with_a_note(write: Write) -> None:
    pytest.importorskip("mujoco")
    text = (
        "surfaces = [{kind = 'table', name = 'post', size = [0.14, 0.14], height = 0.6}, {}]\n"
        "models = [{path = 'models/ball.urdf', count = 6, on = 'post'}]\nplacement = {physics = 'mujoco'}"
    )
    loaded = scene(write(text))
    assert any(note.endswith("has fallen off its surface; it is left out") for note in loaded.description.warnings)
    for _, bodies in parts(loaded, "models"):
        assert np.concatenate(bodies)[:, 2].min() > 0.59


def test_arguments_of_xacro_files(write: Write) -> None:
    models = ", ".join(f'{{path = "models/side.urdf", xacro_args = {{side = {side}}}}}' for side in ("0.05", '"0.1"'))
    path = write(f'scenes = 1\nsurfaces = [{{}}]\nmodels = [{models}]\ncameras = [{{kind = "shell"}}]')
    (path.parent / "models" / "side.urdf").write_text(visual('<sphere radius="$(arg side)"/>'))
    heights = [np.ptp(np.concatenate(points)[:, 2]) for _, points in parts(scene(path), "models")]
    assert np.allclose(heights, (0.1, 0.2), rtol=0.02)
