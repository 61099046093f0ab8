"""The layout file for the Foxglove app."""

import json

import pytest

pytest.importorskip("foxglove", reason="needs the extra foxglove")

from tools.foxglove_layout import FILE, layout_text


def test_the_file_is_up_to_date() -> None:
    assert FILE.read_text() == layout_text(), "run: python -m tools.foxglove_layout"
    panels = json.dumps(json.loads(FILE.read_text()))
    for topic in ("/scene", "/stereo/points2", "/stereo/left/image_rect", "/stereo/depth/camera_info"):
        assert f'"{topic}"' in panels
