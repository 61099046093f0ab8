"""The commands except serve, as a user types them."""

import json
import os
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
from typer.testing import CliRunner, Result

from gateway.cli.commands import app
from gateway.runtime import instance_probe
from tests.support import forms
from tests.support.waiting import PAUSE, SECONDS


def scenegate(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "scenegate", *arguments],
        env={**os.environ, "COLUMNS": "200", **environment},
        capture_output=True,
        text=True,
        timeout=SECONDS,
        check=False,
    )


def test_doctor_is_one_table_and_needs_no_kernels() -> None:
    result = scenegate("doctor", SCENEGATE_HTTP_PORT="0", SCENEGATE_TCPQ_PORT="0", SCENEGATE_GRPC_PORT="0")
    assert result.returncode == 0, result.stdout + result.stderr
    for word in ("scenegate", "Python", "libraries", "kernels", "loopback", "multicast"):
        assert any(line.startswith(word) for line in result.stdout.splitlines()), word


def test_doctor_reports_a_taken_port(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(instance_probe, "READ_SECONDS", PAUSE)  # the port's owner does not respond
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        environment = {"COLUMNS": "200", "SCENEGATE_HTTP_PORT": str(port)}
        result = CliRunner().invoke(app, ["doctor"], env=environment)
    assert result.exit_code == 1
    assert f"HTTP: another program listens there (127.0.0.1 port {port})" in result.stdout


def render(*arguments: str) -> Result:
    """Run the command in this process, which loads the kernels once."""
    return CliRunner().invoke(app, ["render", *arguments])


def render_triangle(folder: Path, *arguments: str) -> Result:
    (folder / "scene.gltf").write_text(json.dumps(forms.gltf(generator="Drake glTF merger")))
    return render(str(folder / "scene.gltf"), *arguments)


@pytest.mark.slow
def test_render_uses_the_camera_of_the_file(tmp_path: Path) -> None:
    out = tmp_path / "new" / "out.png"
    (tmp_path / "scene.gltf").write_text(json.dumps(forms.gltf()))
    result = scenegate("render", str(tmp_path / "scene.gltf"), "-o", str(out), "--width", "80", "--height", "60")
    assert result.returncode == 0, result.stderr
    bgr: Any = cv2.imread(str(out))
    image = bgr[:, :, ::-1]
    assert image.shape == (60, 80, 3)
    assert tuple(image[0, 0]) == (204, 229, 255)
    assert image[40, 40, 0] > 200  # the red triangle
    assert image[40, 40, 1:].max() < 30


def test_render_depth_in_metres_with_a_camera_text(tmp_path: Path) -> None:
    out = tmp_path / "out.tiff"
    camera = "eye=0,0,1;target=0,0,-1;up=0,1,0;fovy=45"
    result = render_triangle(tmp_path, "-o", str(out), "--type", "depth", "--camera", camera, "--up", "z")
    assert result.exit_code == 0, result.stderr
    depth = tifffile.imread(out)
    assert depth.shape == (480, 640)
    assert np.isclose(depth[240, 320], 2.0, atol=1e-5)


def test_render_rotates_y_up_files(tmp_path: Path) -> None:
    (tmp_path / "scene.gltf").write_text(json.dumps(forms.gltf(generator="another program")))
    depths = {}
    for up in ("auto", "y", "z"):
        # The triangle faces +z at z = -1 in the file; turned, it faces -y at y = 1.
        camera = "eye=0,0,0;target=0,1,0;fovy=45" if up != "z" else "eye=0,0,0;target=0,0,-1;up=0,1,0;fovy=45"
        out = tmp_path / f"{up}.tiff"
        result = render(
            *(str(tmp_path / "scene.gltf"), "-o", str(out), "--type", "depth", "--up", up, "--camera", camera)
        )
        assert result.exit_code == 0, result.stderr
        depths[up] = tifffile.imread(out)
    assert np.isclose(depths["auto"][240, 320], 1.0, atol=1e-5)
    assert np.array_equal(depths["auto"], depths["y"])
    assert np.allclose(depths["auto"], depths["z"], atol=1e-5)


@pytest.mark.slow
def test_render_a_folder_skips_scenes_that_cannot_be_rendered(tmp_path: Path) -> None:
    scenes, out = tmp_path / "scenes", tmp_path / "out"
    (scenes / "deep").mkdir(parents=True)
    for name in ("a.gltf", "deep/b.gltf"):
        (scenes / name).write_text(json.dumps(forms.gltf(generator="another program")))
    (scenes / "broken.gltf").write_text("{")
    arguments = (str(scenes), "-o", str(out), "--type", "label,color", "--camera", "fit", "--width", "64")
    result = render(*arguments)
    assert result.exit_code == 1
    complaints = [line for line in result.stderr.splitlines() if line.startswith("scenegate: ")]
    assert len(complaints) == 1
    assert complaints[0].startswith("scenegate: broken.gltf: ")
    checked = CliRunner().invoke(app, ["dataset", "check", str(out)])
    assert checked.exit_code == 0, checked.stderr
    assert "2 samples of 2 scenes, 4 images" in checked.stdout
    assert "note: broken.gltf was not drawn: " in checked.stderr
    again = render(*arguments)
    assert "2 of 3 samples, 2 of them from before, 0 rendered" in again.stderr
    (out / "scenes" / "a.gltf" / "camera-000.label.png").write_bytes(b"")
    checked = CliRunner().invoke(app, ["dataset", "check", str(out)])
    assert checked.exit_code == 1
    assert "scenegate: a.gltf/camera-000: scenes/a.gltf/camera-000.label.png: changed" in checked.stderr


def test_errors_of_render_are_sentences(tmp_path: Path) -> None:
    for arguments, message in (
        (("-o", "out.tiff"), "a color image is written as .png or .jpg"),
        (("-o", "out.bmp"), "out.bmp: images are written as .png, .jpg, .jpeg, .tif, .tiff; or name a folder"),
        (("-o", str(tmp_path / "o.png"), "--camera", "eye=1,2"), "camera"),
        (("-o", str(tmp_path / "o.png"), "--camera", 'path:["nobody"]'), "there is no such node"),
    ):
        result = render_triangle(tmp_path, *arguments)
        assert result.exit_code == 1
        assert isinstance(result.exception, ValueError)  # what main() prints as one sentence
        assert message in str(result.exception)


def test_a_file_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    log = tmp_path / "no" / "log"
    said = scenegate("record", str(log), "--lcm-url", "memq://", "--seconds", "1")
    assert (said.returncode, said.stderr) == (1, f"scenegate: {log}: No such file or directory\n")


COMPLETIONS = {
    "d": ["dataset", "doctor"],
    "con": ["convert"],
    "convert --pro": ["--profile"],
    "e": ["export"],
    "p": ["play", "publish"],
    "publish --re": ["--reload"],
    "record --profile r": ["ros2"],
    "serve --worker": ["--workers"],
    "serve --stereo-s": ["--stereo-scene", "--stereo-seed"],
    "serve --depth-mode m": ["matched"],
    "v": ["view"],
    "--ver": ["--version"],
    "view --mesh": ["--mesh-root"],
    "dataset ": ["check", "export", "schema", "show", "track"],
}
"""What bash offers after what was typed."""
COMPLETE = """
import contextlib, io, json, os, sys
from scenegate.cli import main
offered = {}
for typed in json.load(sys.stdin):
    words = ["scenegate", *typed.split(" ")]
    os.environ |= {"COMP_WORDS": " ".join(words), "COMP_CWORD": str(len(words) - 1)}
    with contextlib.redirect_stdout(io.StringIO()) as printed, contextlib.suppress(SystemExit):
        main()
    offered[typed] = sorted(printed.getvalue().split())
print(json.dumps(offered))
"""


def test_words_are_completed_in_bash(tmp_path: Path) -> None:
    script = tmp_path / "scenegate"  # the name under which the completion is installed
    script.write_text(COMPLETE)
    paths = {"PYTHONPATH": f"{Path.cwd()}:{Path.cwd() / 'client'}"}
    result = subprocess.run(
        [sys.executable, str(script)],
        input=json.dumps(list(COMPLETIONS)),
        env={**os.environ, **paths, "_SCENEGATE_COMPLETE": "complete_bash"},
        capture_output=True,
        text=True,
        timeout=SECONDS,
        check=True,
    )
    assert json.loads(result.stdout) == COMPLETIONS
