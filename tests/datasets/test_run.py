"""Runs: the same input gives the same bytes, what is done is not done again, and one bad scene stops nobody."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from gateway.client import manifest
from gateway.client.dataset import NO_LABEL, Dataset
from gateway.datasets import local_tasks, tasks
from gateway.datasets.camera_file import CameraFile
from gateway.datasets.files import InUseError, alone
from gateway.datasets.plan import PlanError, Result, Task
from gateway.datasets.run import run
from gateway.datasets.scenes import LoadedScene, load_scene
from gateway.datasets.sources import Source
from gateway.datasets.tasks import Worker
from gateway.datasets.views import View
from tests.datasets.conftest import SETTINGS, Draw, contents, order_of
from tests.support import forms
from tests.support.slow import slow_gltf
from tests.support.waiting import SECONDS, wait_until

LIGHTS = "KHR_lights_punctual"


def test_every_kind_of_scene_is_drawn(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    views = CameraFile((View("corner", "fit"), View("low", "eye=3,-3,1;target=0,0.5,0.2")))
    progress = draw(order_of(scenes, tmp_path / "out", orbit=0, cameras=views))
    assert not progress.failures
    dataset = Dataset(tmp_path / "out")
    assert dataset.scenes == ("a.gltf", "deep/mesh.stl", "depth.multipart", "robot.tree.json")
    assert len(dataset) == 7
    for sample in dataset:
        if sample.record.scene == "depth.multipart":
            assert sample.depth.shape == (48, 64)
            assert np.isclose(sample.depth[24, 32], 1.0)  # forms.gltf: a metre before the camera
            continue
        assert sample.color.shape == (24, 32, 3)
        seen = np.isfinite(sample.depth)
        assert seen.any(), sample.id
        assert not seen.all(), sample.id
        assert ((sample.label != NO_LABEL) == seen).all(), sample.id
        assert set(np.unique(sample.label[seen]).tolist()) <= set(dataset.labels(sample.record.scene))
    assert set(dataset.labels("robot.tree.json").values()) == {(("robot", "base"),), (("robot", "arm"),)}


def test_the_camera_of_the_manifest_is_the_one_of_the_pictures(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    """Depth put back into the world by K and X_world_camera lies on the mesh: the triangle in the plane z = 0."""
    draw(order_of(scenes / "deep", tmp_path / "out", orbit=5))
    for sample in Dataset(tmp_path / "out"):
        depth = sample.depth
        points = (sample.rays * depth[..., None])[np.isfinite(depth)]
        world = points @ sample.X_world_camera[:3, :3].T + sample.X_world_camera[:3, 3]
        assert len(world) > 5
        assert np.abs(world[:, 2]).max() < 1e-5
        assert (world[:, :2] > -0.05).all()
        assert (world[:, :2].sum(axis=1) < 1.05).all()
        assert sample.K[0, 0] == sample.record.camera.fx


def test_the_same_input_gives_the_same_bytes_with_any_number_of_workers(
    scenes: Path, tmp_path: Path, draw: Draw
) -> None:
    draw(order_of(scenes, tmp_path / "one", orbit=20))
    order = order_of(scenes, tmp_path / "two", orbit=20)
    run(order, lambda tasks: local_tasks.run_local(tasks, 2), lambda _: None)
    assert contents(tmp_path / "one") == contents(tmp_path / "two")


def test_a_stopped_run_goes_on_where_it_was(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    whole, out = tmp_path / "whole", tmp_path / "out"
    draw(order_of(scenes, whole))
    with pytest.raises(KeyboardInterrupt):
        draw(order_of(scenes, out), most=2)
    with (out / manifest.JOURNAL).open("ab") as journal:
        journal.write(b'{"id":"torn')  # what a process that is killed in the middle of a line leaves
    with pytest.raises(manifest.RecordError, match="not finished"):
        Dataset(out)
    left = out / "scenes" / "a.gltf" / "orbit-0.color.png.7.part"
    left.write_bytes(b"half")
    progress = draw(order_of(scenes, out))
    assert progress.kept == 4
    assert progress.drawn == 3
    assert contents(out) == contents(whole)
    assert draw(order_of(scenes, out)).drawn == 0


@pytest.mark.parametrize("change", ["picture", "missing", "scene", "description"])
def test_what_changed_is_drawn_again_and_nothing_else(scenes: Path, tmp_path: Path, draw: Draw, change: str) -> None:
    out = tmp_path / "out"
    draw(order_of(scenes, out))
    whole = contents(out)
    folder = out / "scenes" / "deep" / "mesh.stl"
    if change == "picture":
        (folder / "orbit-1.label.png").write_bytes(b"broken")
    elif change == "missing":
        (folder / "orbit-1.depth.tiff").unlink()
    elif change == "scene":
        path = scenes / "deep" / "mesh.stl"
        path.write_text(path.read_text().replace("vertex 0 1 0", "vertex 0 2 0"))
    else:
        (folder / manifest.SCENE).unlink()
    progress = draw(order_of(scenes, out))
    assert progress.drawn == (1 if change in ("picture", "missing") else 2)
    if change == "scene":
        changed = {name for name, data in contents(out).items() if data != whole[name]}
        assert {name for name in changed if name != manifest.MANIFEST} <= {
            name for name in whole if name.startswith("scenes/deep/mesh.stl/")
        }
        assert "scenes/deep/mesh.stl/orbit-0.color.png" in changed
    else:
        assert contents(out) == whole


def test_files_beside_a_scene_count(tmp_path: Path, draw: Draw) -> None:
    folder = tmp_path / "scenes"
    folder.mkdir()
    document = forms.gltf(buffers=[{"byteLength": 36, "uri": "corners.bin"}])
    (folder / "a.gltf").write_text(json.dumps(document))
    corners = np.array(((-0.5, -0.5, -1), (0.5, -0.5, -1), (0, 0.5, -1)), np.float32)
    (folder / "corners.bin").write_bytes(corners.tobytes())
    draw(order_of(folder, tmp_path / "out"))
    assert draw(order_of(folder, tmp_path / "out")).drawn == 0
    (folder / "corners.bin").write_bytes((corners * 0.5).astype(np.float32).tobytes())
    assert draw(order_of(folder, tmp_path / "out")).drawn == 2


def test_bad_scenes_and_views_are_a_line_each(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    (scenes / "broken.gltf").write_text("{")
    (scenes / "cut.multipart").write_bytes(forms.body(forms.gltf())[:-100])
    cameras = CameraFile((View("nobody", 'path:["nobody"]'),))
    progress = draw(order_of(scenes, tmp_path / "out", orbit=40, cameras=cameras))
    failed = list(manifest.read_lines(tmp_path / "out" / manifest.FAILED, manifest.Failure))
    assert [(failure.scene, failure.view) for failure in failed] == [
        ("a.gltf", "nobody"),
        ("broken.gltf", None),
        ("cut.multipart", None),
        ("deep/mesh.stl", "nobody"),
        ("robot.tree.json", "nobody"),
    ]
    assert "there is no such node" in failed[0].reason
    assert "not JSON" in failed[1].reason
    assert "cut short" in failed[2].reason
    assert progress.finished == 3 * 40 + 1
    assert len(Dataset(tmp_path / "out")) == progress.finished


def test_scenes_whose_names_cannot_be_used_are_a_line_each(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    good = (scenes / "a.gltf").read_bytes()
    long = f"{'b' * 235}.gltf"
    for name in ("two\nlines.gltf", long, "c\\d.gltf"):
        (scenes / name).write_bytes(good)
    out = tmp_path / "out"
    progress = draw(order_of(scenes, out))
    failed = list(manifest.read_lines(out / manifest.FAILED, manifest.Failure))
    assert [(failure.scene, failure.view) for failure in failed] == [
        (long, None),
        ("c\\d.gltf", None),
        (r"two\nlines.gltf", None),
    ]
    assert failed[0].reason == "a name of 240 characters; 200 are the most: rename the file"
    assert failed[2].reason.startswith(r"a name with the character '\n'")
    assert (progress.drawn, progress.total) == (7, 13)
    assert len(Dataset(out)) == 7
    for name in ("two\nlines.gltf", long, "c\\d.gltf"):
        (scenes / name).rename(scenes / f"{name[0]}.gltf")
    progress = draw(order_of(scenes, out))
    assert (progress.kept, progress.drawn, progress.failures) == (7, 6, {})
    assert not (out / manifest.FAILED).exists()


def test_the_command_draws_the_others_and_ends_with_1(scenes: Path, tmp_path: Path) -> None:
    (scenes / "two\nlines.gltf").write_bytes((scenes / "a.gltf").read_bytes())
    command = [sys.executable, "-m", "gateway.cli", "render", str(scenes), "--width", "32", "--height", "24"]
    done = subprocess.run([*command, "-o", str(tmp_path / "out")], capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stderr
    assert r"scenegate: two\nlines.gltf: a name with the character '\n'" in done.stderr
    assert "4 of 5 samples" in done.stderr
    picture = [str(scenes / "two\nlines.gltf"), "-o", str(tmp_path / "one.png")]
    command[4:5] = picture  # a single picture has no place in a dataset, and needs no name
    assert subprocess.run(command, capture_output=True, text=True, check=False).returncode == 0
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "out/scenes/a.gltf/default.color.png").read_bytes()


def test_a_run_that_was_killed_at_its_very_end_goes_on(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    out = tmp_path / "out"
    draw(order_of(scenes, out))
    whole = contents(out)
    lines = (out / manifest.MANIFEST).read_bytes().splitlines(keepends=True)
    (out / manifest.JOURNAL).write_bytes(b"".join(reversed(lines)))  # the manifest is there, the journal still is
    (out / f"{manifest.MANIFEST}.7.part").write_bytes(lines[0])
    progress = draw(order_of(scenes, out))
    assert (progress.kept, progress.drawn) == (7, 0)
    assert contents(out) == whole


def test_pictures_of_another_renderer_are_drawn_again(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    out = tmp_path / "out"
    draw(order_of(scenes, out))
    whole = contents(out)
    description = out / manifest.DATASET
    known = manifest.read_dataset(out)
    description.write_bytes(manifest.encode_for_people(msgspec.structs.replace(known, renderer="0" * 16)))
    with pytest.raises(KeyboardInterrupt):
        draw(order_of(scenes, out), most=0)
    assert manifest.read_dataset(out).renderer == known.renderer
    assert not (out / manifest.MANIFEST).exists(), "an old manifest under a new renderer would be believed"
    progress = draw(order_of(scenes, out))
    assert (progress.kept, progress.drawn) == (0, 7)
    assert contents(out) == whole


def test_a_folder_with_something_else_is_left_alone(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "thesis.tex").write_text("years of work")
    with pytest.raises(PlanError, match="not empty and holds no dataset"):
        draw(order_of(scenes, out))
    assert contents(out) == {"thesis.tex": b"years of work"}


def test_a_dataset_of_other_settings_or_scenes_is_left_alone(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    out = tmp_path / "out"
    draw(order_of(scenes, out))
    before = contents(out)
    other = msgspec.structs.replace(SETTINGS, width=64)
    with pytest.raises(PlanError, match=r"other settings \(width: 32 there, 64 now\)"):
        draw(order_of(scenes, out, settings=other))
    (scenes / "a.gltf").unlink()
    with pytest.raises(PlanError, match=r"2 pictures of scenes or views that this command does not name \(a.gltf"):
        draw(order_of(scenes, out))
    assert contents(out) == before


def test_two_runs_do_not_share_a_folder(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    out = tmp_path / "out"
    out.mkdir()
    with alone(out), pytest.raises(InUseError, match="another run works on"):
        draw(order_of(scenes, out))
    assert draw(order_of(scenes, out)).drawn == 7


def test_a_dataset_grows(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    moved = scenes / "a.gltf"
    data = moved.read_bytes()
    moved.unlink()
    draw(order_of(scenes, tmp_path / "out"))
    moved.write_bytes(data)
    assert draw(order_of(scenes, tmp_path / "out")).drawn == 2
    draw(order_of(scenes, tmp_path / "whole"))
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


def test_workers_with_another_renderer_refuse(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    def strange(tasks: list[Task]) -> Iterator[Result]:
        return map(Worker().work, [replace(task, renderer="0123") for task in tasks])

    progress = run(order_of(scenes, tmp_path / "out"), strange, lambda _: None)
    assert progress.finished == 0
    assert all("another version of Scenegate" in failure.reason for failure in progress.failures)


def _killer(task: Task) -> Result:
    """Stands in for a worker's work: scene 'a.gltf' kills its process."""
    if task.source.name == "a.gltf":
        os.kill(os.getpid(), signal.SIGKILL)
    from gateway.datasets.tasks import work

    return work(task)


def test_a_worker_that_dies_takes_only_its_task_with_it(
    scenes: Path, tmp_path: Path, draw: Draw, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(local_tasks, "_work", _killer)
    order = order_of(scenes, tmp_path / "out")
    progress = run(order, lambda tasks: local_tasks.run_local(tasks, 2), lambda _: None)
    assert [(failure.scene, failure.reason) for failure in progress.failures] == [("a.gltf", local_tasks.DIED)] * 2
    monkeypatch.undo()
    draw(order)
    draw(order_of(scenes, tmp_path / "whole"))
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


def test_a_defect_in_one_scene_is_a_line_too(
    scenes: Path, tmp_path: Path, draw: Draw, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(source: Source, up: str) -> LoadedScene:
        if source.name == "a.gltf":
            raise RecursionError("too deep")
        return load_scene(source)

    monkeypatch.setattr(tasks, "load_scene", broken)
    progress = draw(order_of(scenes, tmp_path / "out"))
    assert [(f.scene, f.reason) for f in progress.failures] == [("a.gltf", "RecursionError: too deep")]
    assert progress.drawn == 5


def test_a_command_that_is_told_to_stop_leaves_no_process_and_goes_on_later(scenes: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    arguments = (str(scenes), "-o", str(out), "--orbit", "1500", "--width", "64", "--height", "48", "--threads", "2")
    command = [sys.executable, "-m", "gateway.cli", "render", *arguments]
    # Its workers hold the other end of stderr: it ends when the last of them has ended.
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        journal = out / manifest.JOURNAL
        # Nothing tells when the first line is there.
        wait_until(lambda: process.poll() is not None or (journal.exists() and journal.stat().st_size))
        assert process.poll() is None
        process.terminate()
        _, said = process.communicate(timeout=SECONDS)
    finally:
        process.kill()
        process.communicate()
    assert process.returncode == 130
    assert "Traceback" not in said
    assert "The same command goes on from here" in said
    done = list(manifest.read_lines(journal, manifest.Sample))
    assert 0 < len(done) < 4500
    for sample in done:
        assert all((out / image.path).stat().st_size == image.bytes for image in sample.images.values())


def test_lights_of_a_rig_that_light_nothing_are_a_warning(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    document = forms.gltf(generator="somebody", extensions={LIGHTS: {"lights": [{"type": "directional"}]}})
    document["nodes"].append({"extensions": {LIGHTS: {"light": 0}}})
    document["scenes"][0]["nodes"].append(len(document["nodes"]) - 1)
    (scenes / "lit.gltf").write_text(json.dumps(document))
    (scenes / "drake.gltf").write_text(json.dumps(forms.gltf()))

    def warned(text: str, types: tuple[manifest.ImageType, ...] = ("color",), look: str = "auto") -> dict[str, str]:
        number = len(list(tmp_path.iterdir()))
        rig = tmp_path / f"{number}.toml"
        rig.write_text(text)
        settings = msgspec.structs.replace(SETTINGS, types=types, look=look, rig=str(rig))
        progress = draw(order_of(scenes, tmp_path / f"out-{number}", orbit=1, settings=settings))
        assert not progress.failures
        return {name: texts[-1] for name, texts in progress.warnings.items() if texts and "rig" in texts[-1]}

    light = '[[lights]]\nkind = "directional"\n'
    drake = "drawn as Drake shows it, without --rig; --look studio takes it"
    request = "a recorded request is drawn as /render does, without --rig"
    replaced = "its own lights replace those of --rig; scene_lights = false in the rig's file keeps them"
    assert warned(light) == {"drake.gltf": drake, "depth.multipart": request, "lit.gltf": replaced}
    assert warned(light, look="studio") == {"depth.multipart": request, "lit.gltf": replaced}
    assert warned(f"scene_lights = false\n{light}") == {"drake.gltf": drake, "depth.multipart": request}
    assert warned("exposure = 2.0\n", look="studio") == {"depth.multipart": request}
    assert warned(light, ("depth",)) == {}
    assert warned(light, look="pbr") == {}


def test_what_takes_too_long_fails_and_the_rest_is_drawn(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    (scenes / "slow.gltf").write_bytes(slow_gltf())
    settings = replace_settings(width=1024, height=1024)
    order = order_of(scenes, tmp_path / "out", orbit=1, settings=settings)
    order = replace(order, timeout=10.0)  # short: the slow one takes hours
    progress = draw(order)
    assert {failure.scene: failure.reason for failure in progress.failures} == {
        "slow.gltf": "it took longer than --timeout = 10 s"
    }
    assert progress.finished >= 3


def replace_settings(**changes: object) -> manifest.Settings:
    return msgspec.structs.replace(SETTINGS, **changes)


def test_one_picture_that_takes_too_long_is_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "slow.gltf").write_bytes(slow_gltf())
    command = [
        sys.executable,
        "-m",
        "gateway.cli",
        "render",
        str(tmp_path / "slow.gltf"),
        "-o",
        str(tmp_path / "a.png"),
    ]
    ended = subprocess.run(
        [*command, "--width", "1024", "--height", "1024", "--timeout", "1"],
        capture_output=True,
        text=True,
        timeout=SECONDS,
        check=False,
    )
    assert ended.returncode == 1
    assert ended.stderr.splitlines()[-1].endswith("a.png: it took longer than --timeout = 1 s")
    assert not (tmp_path / "a.png").exists()
