"""Arguments of ``scenegate render`` that are parsed from text, and combinations that are rejected before any work."""

import os
import threading
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from gateway.cli.commands import app
from gateway.cli.render import _parse_color, _parse_types
from gateway.runtime.kernels import parts
from renderers.images import decode_image
from tests.files.robots.files import visual
from tests.support.command import scenegate
from tests.support.waiting import SECONDS


def test_types_are_in_a_fixed_order() -> None:
    given = {
        "label, color": ("color", "label"),
        "depth,depth,": ("depth",),
        "label,depth,color": ("color", "depth", "label"),
    }
    assert {text: _parse_types(text) for text in given} == given
    for text in ("", ",", "colour", "color,normals"):
        with pytest.raises(ValueError, match=r"--type .*color, depth, label, instance"):
            _parse_types(text)


def test_colors_have_three_numbers_up_to_255() -> None:
    assert _parse_color("0, 128,255") == (0, 128, 255)
    for text in ("", "1,2", "1,2,3,4", "1,2,256", "-1,2,3", "0,0,-1", "1,2,x"):
        with pytest.raises(ValueError, match=r"--background .*255"):
            _parse_color(text)


def render(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> Result:
    """Run the command up to the point at which it would load the kernels."""

    class KernelsNeeded(Exception):
        pass

    def stop(**_: object) -> None:
        raise KernelsNeeded

    monkeypatch.setattr(parts, "ensure_compiled", stop)
    return CliRunner().invoke(app, ["render", *arguments])


@pytest.fixture
def scenes(tmp_path: Path) -> tuple[str, str]:
    """Return the paths of a file and of a folder."""
    (tmp_path / "scene.glb").write_bytes(b"")
    (tmp_path / "folder.png").mkdir()
    return str(tmp_path / "scene.glb"), str(tmp_path / "folder.png")


def test_other_numbers_of_samples_are_rejected(monkeypatch: pytest.MonkeyPatch, scenes: tuple[str, str]) -> None:
    for samples in ("2", "3", "16"):
        result = render(monkeypatch, scenes[0], "-o", "out.png", "--samples", samples)
        assert str(result.exception) == f"--samples {samples} is not one of 0, 1, 4, 8"


def test_one_image_needs_one_file_one_type_and_no_camera_file(
    monkeypatch: pytest.MonkeyPatch, scenes: tuple[str, str]
) -> None:
    file, folder = scenes
    for arguments in ((file, file), (folder,), (file, "--type", "color,depth"), (file, "--cameras", file)):
        result = render(monkeypatch, *arguments, "-o", "out.PNG")
        assert "out.PNG is one image: for more scenes, types or cameras" in str(result.exception)
    assert type(render(monkeypatch, file, "-o", "out.PNG").exception).__name__ == "KernelsNeeded"
    # A folder that exists may have the suffix of an image.
    assert type(render(monkeypatch, file, file, "-o", folder).exception).__name__ == "KernelsNeeded"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--type", "stereo"), "stereo images need --baseline METRES or --stereo-profile NAME"),
        (("--type", "color", "--baseline", "0.1"), "--baseline and --stereo-profile are for --type stereo or measured"),
        (("--stereo-profile", "rgbd"), "--baseline and --stereo-profile are for --type stereo or measured"),
        (("--type", "measured", "--baseline", "0.1"), "measured images need --stereo-profile NAME"),
        (
            ("--type", "stereo", "--baseline", "0.1", "--stereo-profile", "rgbd"),
            "--stereo-profile has a baseline: leave out --baseline",
        ),
    ],
)
def test_baselines_and_profiles_are_for_stereo_images(
    monkeypatch: pytest.MonkeyPatch, scenes: tuple[str, str], arguments: tuple[str, ...], sentence: str
) -> None:
    assert str(render(monkeypatch, scenes[0], "-o", "out", *arguments).exception) == sentence


def test_a_rig_for_another_look_is_a_warning(monkeypatch: pytest.MonkeyPatch, scenes: tuple[str, str]) -> None:
    file, _ = scenes
    for look, warned in (("phong", True), ("pbr", True), ("auto", False), ("studio", False)):
        result = render(monkeypatch, file, "-o", "out.png", "--rig", file, "--look", look)
        assert ("--rig lights the studio look only" in result.stderr) == warned


def test_a_pipe_is_drawn_once_and_makes_no_dataset(tmp_path: Path) -> None:
    pipe, out = tmp_path / "pipe", tmp_path / "a.png"
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_bytes, args=(visual('<box size="$(arg side) 1 1"/>').encode(),))
    writer.start()
    ran = scenegate("render", str(pipe), "-o", str(out), "--xacro-arg", "side:=1")
    writer.join(SECONDS)
    assert (ran.exit_code, ran.stderr) == (0, "")
    assert len(np.unique(decode_image(out.read_bytes()))) > 2
    assert "pipe" in scenegate("render", str(pipe), "-o", str(tmp_path / "out")).stderr
