"""Camera mounts."""

import numpy as np
import pytest

from gateway.scene.draw.cameras import CameraError
from gateway.scene.draw.mount import mount_pose_text, parse_mount_path, parse_mount_pose


def test_a_pose_as_numbers_is_the_optical_frame() -> None:
    half = np.sqrt(0.5)
    pose = parse_mount_pose(f"1,2,3,{half},0,0,{half}")
    assert np.allclose(pose[:3, 3], (1, 2, 3))
    assert np.allclose(pose[:3, 0], (0, 1, 0))  # a quarter turn about z: its x axis points along the world's y


def test_a_pose_in_words_looks_at_the_target_with_up_upwards() -> None:
    pose = parse_mount_pose("eye=2,0,1;target=0,0,1")
    assert np.allclose(pose[:3, 2], (-1, 0, 0))  # +Z forward
    assert np.allclose(pose[:3, 1], (0, 0, -1))  # +Y down
    assert np.allclose(pose[:3, 3], (2, 0, 1))


@pytest.mark.parametrize(
    "text",
    [
        "eye=2,0,1;target=1,0,1;up=0,0,1",
        "eye=0,0,9;target=0,0,8;up=0,1,0",
        "eye=-123456.789,1e-5,0.25;target=0,0,0",
        "1,2,3,0.5,0.5,-0.5,0.5",
    ],
)
def test_a_pose_is_the_same_after_its_text(text: str) -> None:
    pose = parse_mount_pose(text)
    written = mount_pose_text(pose)
    assert np.allclose(parse_mount_pose(written), pose, atol=3e-6)
    assert "e-" not in written
    assert "-0," not in written


@pytest.mark.parametrize(
    "text", ["", "1,2,3", "1,2,3,0,0,0,0", "1,2,3,1,0,0,nan", "a,b,c,d,e,f,g", "fit", "eye=1,2,3", 'path:["a=b"]']
)
def test_anything_else_is_refused(text: str) -> None:
    with pytest.raises(CameraError):
        parse_mount_pose(text)


def test_a_path_is_json() -> None:
    assert parse_mount_path('["robot", "a/b", 3]') == ("robot", "a/b", 3)
    with pytest.raises(CameraError, match="not a JSON list"):
        parse_mount_path("robot/head")
