"""Runs are reproducible and continue where they stopped; one bad scene does not stop the others."""

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from gateway.datasets import local_tasks, resume
from gateway.datasets import worker as worker_module
from gateway.datasets.errors import DatasetError
from gateway.datasets.files import locked
from gateway.datasets.job import RenderTask, Result
from gateway.datasets.run import run
from gateway.datasets.scene_sources import Source
from gateway.datasets.scenes import LoadedScene, load_scene
from gateway.datasets.views import CameraFile, View
from gateway.datasets.worker import run_task
from scenegate.datasets import manifest
from scenegate.datasets.dataset import NO_LABEL, Dataset
from tests.datasets.conftest import SETTINGS, Draw, contents, draw_in_processes, failures_of, job_of
from tests.support import forms
from tests.support.command import scenegate
from tests.support.slow import slow_gltf
from tests.support.waiting import SECONDS, wait_until

LIGHTS = "KHR_lights_punctual"


def test_renders_every_kind_of_scene(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    views = CameraFile((View("corner", "fit"), View("low", "eye=3,-3,1;target=0,0.5,0.2")))
    progress = draw(job_of(scenes, tmp_path / "out", orbit=0, cameras=views))
    assert not progress.failures
    dataset = Dataset(tmp_path / "out")
    assert dataset.scenes == ("a.gltf", "deep/mesh.stl", "depth.multipart", "robot.tree.json")
    assert len(dataset) == 7
    for sample in dataset:
        if sample.record.scene == "depth.multipart":
            assert sample.depth.shape == (48, 64)
            assert np.isclose(sample.depth[24, 32], 1.0)  # forms.gltf: 1 m in front of the camera
            continue
        assert sample.color.shape == (24, 32, 3)
        seen = np.isfinite(sample.depth)
        assert seen.any(), sample.id
        assert not seen.all(), sample.id
        assert ((sample.label != NO_LABEL) == seen).all(), sample.id
        assert set(np.unique(sample.label[seen]).tolist()) <= set(dataset.labels(sample.record.scene))
    assert set(dataset.labels("robot.tree.json").values()) == {(("robot", "base"),), (("robot", "arm"),)}


def test_depth_and_camera_give_points_on_the_mesh(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    """Depth put back into the world by K and X_world_camera lies on the mesh: the triangle in the plane z = 0."""
    draw(job_of(scenes / "deep", tmp_path / "out", orbit=5))
    for sample in Dataset(tmp_path / "out"):
        depth = sample.depth
        points = (sample.rays * depth[..., None])[np.isfinite(depth)]
        world = points @ sample.X_world_camera[:3, :3].T + sample.X_world_camera[:3, 3]
        assert len(world) > 5
        assert np.abs(world[:, 2]).max() < 1e-5
        assert (world[:, :2] > -0.05).all()
        assert (world[:, :2].sum(axis=1) < 1.05).all()
        c = sample.record.camera
        assert sample.K.tolist() == [[c.fx, 0, c.cx], [0, c.fy, c.cy], [0, 0, 1]]


def test_a_stopped_run_continues(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    whole, out = tmp_path / "whole", tmp_path / "out"
    draw(job_of(scenes, whole))
    with pytest.raises(KeyboardInterrupt):
        draw(job_of(scenes, out), most=2)
    with (out / manifest.JOURNAL_FILE).open("ab") as journal:
        journal.write(b'{"id":"torn')  # what a process that is killed in the middle of a line leaves
    with pytest.raises(manifest.RecordError, match="not finished"):
        Dataset(out)
    left = out / "scenes" / "a.gltf" / "orbit-0.color.png.7.part"
    left.write_bytes(b"half")
    progress = draw(job_of(scenes, out))
    assert progress.kept == 4
    assert progress.rendered == 3
    assert contents(out) == contents(whole)
    assert draw(job_of(scenes, out)).rendered == 0


@pytest.mark.parametrize(("change", "rendered"), [("image", 1), ("missing", 1), ("description", 2)])
def test_renders_again_only_what_changed(scenes: Path, tmp_path: Path, draw: Draw, change: str, rendered: int) -> None:
    out = tmp_path / "out"
    draw(job_of(scenes, out))
    whole = contents(out)
    folder = out / "scenes" / "deep" / "mesh.stl"
    if change == "image":
        (folder / "orbit-1.label.png").write_bytes(b"broken")
    else:
        (folder / ("orbit-1.depth.tiff" if change == "missing" else manifest.SCENE_FILE)).unlink()
    assert draw(job_of(scenes, out)).rendered == rendered
    assert contents(out) == whole


def test_renders_a_changed_scene_again(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    out = tmp_path / "out"
    draw(job_of(scenes, out))
    whole = contents(out)
    path = scenes / "deep" / "mesh.stl"
    path.write_text(path.read_text().replace("vertex 0 1 0", "vertex 0 2 0"))
    assert draw(job_of(scenes, out)).rendered == 2
    changed = {name for name, data in contents(out).items() if data != whole[name]} - {manifest.MANIFEST_FILE}
    assert {name for name in changed if not name.startswith("scenes/deep/mesh.stl/")} == set()
    assert "scenes/deep/mesh.stl/orbit-0.color.png" in changed


@pytest.mark.parametrize("other", ["pipe", "/dev/zero"])
def test_files_that_are_not_regular_are_rendered_again(scenes: Path, tmp_path: Path, draw: Draw, other: str) -> None:
    job = job_of(scenes, tmp_path / "out")
    draw(job)
    first = contents(tmp_path / "out")
    image = tmp_path / "out" / "scenes" / "a.gltf" / "orbit-0.color.png"
    image.unlink()
    if other == "pipe":
        os.mkfifo(image)
    else:
        image.symlink_to(other)
    assert draw(job).rendered == 1
    assert image.is_file()
    assert not image.is_symlink()
    assert contents(tmp_path / "out") == first


def test_hashing_stops_with_the_run(scenes: Path, tmp_path: Path, draw: Draw, monkeypatch: pytest.MonkeyPatch) -> None:
    """An exception, as from SIGTERM, ends the threads that hash, although they have not finished."""
    job = job_of(scenes, tmp_path / "out")
    draw(job)
    waiting = threading.Event()

    def endless(path: Path, check: Callable[[], object]) -> str:
        waiting.set()
        while True:
            check()
            threading.Event().wait(0.01)  # short: between two checks

    class Interrupted(ThreadPoolExecutor):
        def map(self, *arguments: Any, **named: Any) -> Any:
            super().map(*arguments, **named)
            assert waiting.wait(SECONDS)
            raise KeyboardInterrupt

    monkeypatch.setattr(resume, "sha256_of", endless)
    monkeypatch.setattr(resume, "ThreadPoolExecutor", Interrupted)
    samples = list(manifest.read_lines(tmp_path / "out" / manifest.MANIFEST_FILE, manifest.SampleRecord))
    digests = {sample.scene: sample.scene_sha256 for sample in samples}
    monkeypatch.setattr(resume, "_current_digest", lambda job, source: digests[source.name])
    with pytest.raises(KeyboardInterrupt):
        list(resume.valid_samples(job, 2))


def test_a_changed_external_buffer_renders_its_scene_again(tmp_path: Path, draw: Draw) -> None:
    folder = tmp_path / "scenes"
    folder.mkdir()
    document = forms.gltf(buffers=[{"byteLength": 36, "uri": "corners.bin"}])
    (folder / "a.gltf").write_text(json.dumps(document))
    corners = np.array(((-0.5, -0.5, -1), (0.5, -0.5, -1), (0, 0.5, -1)), np.float32)
    (folder / "corners.bin").write_bytes(corners.tobytes())
    draw(job_of(folder, tmp_path / "out"))
    assert draw(job_of(folder, tmp_path / "out")).rendered == 0
    (folder / "corners.bin").write_bytes((corners * 0.5).astype(np.float32).tobytes())
    assert draw(job_of(folder, tmp_path / "out")).rendered == 2


def test_reports_each_bad_scene_and_view(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    (scenes / "broken.gltf").write_text("{")
    (scenes / "cut.multipart").write_bytes(forms.body(forms.gltf())[:-100])
    cameras = CameraFile((View("missing", 'path:["missing"]'),))
    progress = draw(job_of(scenes, tmp_path / "out", orbit=40, cameras=cameras))
    failed = failures_of(tmp_path / "out")
    assert [(failure.scene, failure.view) for failure in failed] == [
        ("a.gltf", "missing"),
        ("broken.gltf", None),
        ("cut.multipart", None),
        ("deep/mesh.stl", "missing"),
        ("robot.tree.json", "missing"),
    ]
    assert "there is no such node" in failed[0].reason
    assert "not JSON" in failed[1].reason
    assert "cut short" in failed[2].reason
    assert progress.finished == 3 * 40 + 1
    assert len(Dataset(tmp_path / "out")) == progress.finished


def test_reports_each_scene_with_an_invalid_name(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    good = (scenes / "a.gltf").read_bytes()
    long = f"{'b' * 235}.gltf"
    for name in ("two\nlines.gltf", long, "c\\d.gltf"):
        (scenes / name).write_bytes(good)
    out = tmp_path / "out"
    progress = draw(job_of(scenes, out))
    failed = failures_of(out)
    assert [(failure.scene, failure.view) for failure in failed] == [
        (name, None) for name in (long, "c\\d.gltf", r"two\nlines.gltf")
    ]
    assert failed[0].reason == "a name of 240 characters; 200 are the most: rename the file"
    assert failed[2].reason.startswith(r"a name with the character '\n'")
    assert (progress.rendered, progress.total) == (7, 13)
    assert len(Dataset(out)) == 7
    for name in ("two\nlines.gltf", long, "c\\d.gltf"):
        (scenes / name).rename(scenes / f"{name[0]}.gltf")
    progress = draw(job_of(scenes, out))
    assert (progress.kept, progress.rendered, progress.failures) == (7, 6, {})
    assert not (out / manifest.FAILURES_FILE).exists()


@pytest.mark.slow
def test_a_bad_scene_gives_exit_code_1_and_the_others_are_rendered(scenes: Path, tmp_path: Path) -> None:
    bad, size = scenes / "two\nlines.gltf", ("--width", "32", "--height", "24")
    bad.write_bytes((scenes / "a.gltf").read_bytes())
    done = scenegate("render", str(scenes), *size, "-o", str(tmp_path / "out"))
    assert done.exit_code == 1, done.stderr
    assert r"scenegate: two\nlines.gltf: a name with the character '\n'" in done.stderr
    assert "4 of 5 samples" in done.stderr
    # A single picture has no place in a dataset, and needs no name.
    assert scenegate("render", str(bad), *size, "-o", str(tmp_path / "one.png")).exit_code == 0
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "out/scenes/a.gltf/default.color.png").read_bytes()


def test_a_run_killed_before_the_journal_was_removed_continues(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    out = tmp_path / "out"
    draw(job_of(scenes, out))
    whole = contents(out)
    lines = (out / manifest.MANIFEST_FILE).read_bytes().splitlines(keepends=True)
    (out / manifest.JOURNAL_FILE).write_bytes(b"".join(reversed(lines)))  # the manifest is there, the journal still is
    (out / f"{manifest.MANIFEST_FILE}.7.part").write_bytes(lines[0])
    progress = draw(job_of(scenes, out))
    assert (progress.kept, progress.rendered) == (7, 0)
    assert contents(out) == whole


def test_renders_again_with_another_renderer(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    out = tmp_path / "out"
    draw(job_of(scenes, out))
    whole = contents(out)
    description = out / manifest.DATASET_FILE
    known = manifest.read_dataset(out)
    description.write_bytes(manifest.encode_indented(msgspec.structs.replace(known, renderer="0" * 16)))
    with pytest.raises(KeyboardInterrupt):
        draw(job_of(scenes, out), most=0)
    assert manifest.read_dataset(out).renderer == known.renderer
    assert not (out / manifest.MANIFEST_FILE).exists(), "an old manifest under a new renderer would be believed"
    progress = draw(job_of(scenes, out))
    assert (progress.kept, progress.rendered) == (0, 7)
    assert contents(out) == whole


def test_refuses_a_folder_with_other_files(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "thesis.tex").write_text("years of work")
    with pytest.raises(DatasetError, match="not empty and holds no dataset"):
        draw(job_of(scenes, out))
    assert contents(out) == {"thesis.tex": b"years of work"}


def test_refuses_a_dataset_with_other_settings_or_scenes(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    out = tmp_path / "out"
    draw(job_of(scenes, out))
    before = contents(out)
    other = msgspec.structs.replace(SETTINGS, width=64)
    with pytest.raises(DatasetError, match=r"other settings \(width: 32 there, 64 now\)"):
        draw(job_of(scenes, out, settings=other))
    (scenes / "a.gltf").unlink()
    with pytest.raises(DatasetError, match=r"2 samples .*\(a.gltf"):
        draw(job_of(scenes, out))
    assert contents(out) == before


def test_refuses_a_folder_in_use(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    out = tmp_path / "out"
    out.mkdir()
    with locked(out), pytest.raises(DatasetError, match="another run works on"):
        draw(job_of(scenes, out))
    assert draw(job_of(scenes, out)).rendered == 7


def test_a_dataset_grows(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    moved = scenes / "a.gltf"
    data = moved.read_bytes()
    moved.unlink()
    draw(job_of(scenes, tmp_path / "out"))
    moved.write_bytes(data)
    assert draw(job_of(scenes, tmp_path / "out")).rendered == 2
    draw(job_of(scenes, tmp_path / "whole"))
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


def test_workers_with_another_renderer_refuse(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    def strange(tasks: list[RenderTask]) -> Iterator[Result]:
        return map(run_task, [replace(task, renderer_digest="0123") for task in tasks])

    progress = run(job_of(scenes, tmp_path / "out"), strange, lambda _: None)
    assert progress.finished == 0
    assert all("another version of Scenegate" in failure.reason for failure in progress.failures)


def _killer(task: RenderTask) -> Result:
    """Stands in for a worker's work: scene 'a.gltf' kills its process."""
    if task.source.name == "a.gltf":
        os.kill(os.getpid(), signal.SIGKILL)
    return run_task(task)


@pytest.mark.slow
def test_a_worker_that_dies_fails_only_its_own_task(
    scenes: Path, tmp_path: Path, draw: Draw, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(local_tasks, "_run_task", _killer)
    job = job_of(scenes, tmp_path / "out")
    progress = draw_in_processes(job)
    failures = [(failure.scene, failure.reason) for failure in progress.failures]
    assert failures == [("a.gltf", local_tasks.DIED_MESSAGE)] * 2
    monkeypatch.undo()
    draw(job)
    draw(job_of(scenes, tmp_path / "whole"))
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


def test_reports_an_unexpected_error_in_one_scene(
    scenes: Path, tmp_path: Path, draw: Draw, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(source: Source, up: str) -> LoadedScene:
        if source.name == "a.gltf":
            raise RecursionError("too deep")
        return load_scene(source)

    monkeypatch.setattr(worker_module, "load_scene", broken)
    progress = draw(job_of(scenes, tmp_path / "out"))
    assert [(f.scene, f.reason) for f in progress.failures] == [("a.gltf", "RecursionError: too deep")]
    assert progress.rendered == 5


@pytest.mark.slow
def test_sigterm_ends_all_workers_and_the_run_can_continue(scenes: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    arguments = (str(scenes), "-o", str(out), "--orbit", "1500", "--width", "64", "--height", "48", "--threads", "2")
    command = [sys.executable, "-m", "scenegate", "render", *arguments]
    # Its workers hold the other end of stderr: it ends when the last of them has ended.
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        journal = out / manifest.JOURNAL_FILE
        # There is no event for the first line.
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
    done = list(manifest.read_lines(journal, manifest.SampleRecord))
    assert 0 < len(done) < 4500
    for sample in done:
        assert all((out / image.path).stat().st_size == image.bytes for image in sample.images.values())


def test_warns_about_an_ignored_rig(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    document = forms.gltf(generator="another program", extensions={LIGHTS: {"lights": [{"type": "directional"}]}})
    document["nodes"].append({"extensions": {LIGHTS: {"light": 0}}})
    document["scenes"][0]["nodes"].append(len(document["nodes"]) - 1)
    (scenes / "lit.gltf").write_text(json.dumps(document))
    (scenes / "drake.gltf").write_text(json.dumps(forms.gltf(generator="Drake glTF merger")))

    def warned(text: str, types: tuple[manifest.ImageType, ...] = ("color",), look: str = "auto") -> dict[str, str]:
        number = len(list(tmp_path.iterdir()))
        rig = tmp_path / f"{number}.toml"
        rig.write_text(text)
        settings = msgspec.structs.replace(SETTINGS, types=types, look=look, rig=str(rig))
        progress = draw(job_of(scenes, tmp_path / f"out-{number}", orbit=1, settings=settings))
        assert not progress.failures
        return {name: texts[-1] for name, texts in progress.warnings.items() if texts and "rig" in texts[-1]}

    light = '[[lights]]\nkind = "directional"\n'
    drake = "drawn as Drake shows it, without --rig; --look studio takes it"
    replaced = "its own lights replace those of --rig; scene_lights = false in the rig's file keeps them"
    assert warned(light) == {"drake.gltf": drake, "depth.multipart": drake, "lit.gltf": replaced}
    assert warned(light, look="studio") == {"lit.gltf": replaced}
    assert warned(f"scene_lights = false\n{light}") == {"drake.gltf": drake, "depth.multipart": drake}
    dark = warned("exposure = 2.0\n", look="studio")
    assert "lit.gltf" not in dark
    assert set(dark.values()) == {"drawn black: the rig has neither [[lights]] nor [surroundings] (--rig)"}
    assert warned(light, ("depth",)) == {}
    assert warned(light, look="pbr") == {}


@pytest.mark.slow
def test_a_timeout_fails_one_scene_and_the_others_are_rendered(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    (scenes / "slow.gltf").write_bytes(slow_gltf())
    settings = msgspec.structs.replace(SETTINGS, width=1024, height=1024)
    job = job_of(scenes, tmp_path / "out", orbit=1, settings=settings)
    progress = draw(replace(job, timeout=10.0))  # short: the slow scene would take hours
    failures = {failure.scene: failure.reason for failure in progress.failures}
    assert failures == {"slow.gltf": "it took longer than --timeout = 10 s"}
    assert progress.finished >= 3


@pytest.mark.slow
def test_a_timeout_of_one_image_is_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "slow.gltf").write_bytes(slow_gltf())
    size = ("--width", "1024", "--height", "1024")
    ended = scenegate("render", str(tmp_path / "slow.gltf"), "-o", str(tmp_path / "a.png"), *size, "--timeout", "1")
    assert ended.exit_code == 1
    assert ended.stderr.splitlines()[-1].endswith("a.png: it took longer than --timeout = 1 s")
    assert not (tmp_path / "a.png").exists()
