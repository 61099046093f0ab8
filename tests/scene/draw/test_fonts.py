"""Fonts for text in images."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.scene.draw import fonts
from gateway.scene.draw.fonts import OpenCVFont, PillowFont, font_for, text_image

THAI = "ไทย"
needs_opencv_5 = pytest.mark.skipif(not hasattr(cv2, "FontFace"), reason="OpenCV 5 has the font")


@pytest.fixture
def no_machine_fonts(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(fonts, "_machine_fonts", {})


def drawn(text: str) -> NDArray[np.uint8]:
    return text_image(text, font_for(text), (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 0.0))[0][:, :, 3]


@pytest.mark.parametrize(
    "text", ["20 °C", "Zażółć gęślą äöüß ñ Å", "Ελληνικά", "Кириллица", "日本語 かな 简体 繁體", "한국어", "≤ ∞ → µ"]
)
@needs_opencv_5
@pytest.mark.usefixtures("no_machine_fonts")
def test_text_in_most_scripts_is_drawn_on_every_machine(text: str) -> None:
    assert font_for(text).missing == ""
    letters = [drawn(char) for char in dict.fromkeys(text) if not char.isspace()]
    for index, letter in enumerate(letters):
        assert letter.max() == 255
        assert not any(np.array_equal(letter, other) for other in letters[:index])


@needs_opencv_5
@pytest.mark.usefixtures("no_machine_fonts")
def test_a_box_stands_for_each_character_that_no_font_has() -> None:
    text = f"日 {THAI} 本 {THAI}"
    assert font_for(text).missing == "ไทย", "each is named once"
    np.testing.assert_array_equal(drawn(text), drawn("日 □□□ 本 □□□"))
    assert not np.array_equal(drawn(THAI), drawn("???"))


@pytest.mark.usefixtures("no_machine_fonts")
def test_right_to_left_scripts_are_not_drawn_backwards() -> None:
    assert font_for("שלום").missing == "שלום"


@pytest.mark.parametrize("script", ["exit 1", "echo /nowhere.ttf", "echo " + __file__, "true"])
def test_useless_fonts_of_the_machine_are_not_used(
    script: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    program = tmp_path / "fc-match"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(fonts, "_machine_fonts", {})
    assert font_for(THAI).missing == THAI


def test_fonts_of_the_machine_draw_what_no_other_font_has(monkeypatch: pytest.MonkeyPatch) -> None:
    text = "שלום"
    monkeypatch.setattr(fonts, "_machine_fonts", {})
    if shutil.which("fc-match") is None or font_for(text).missing:
        pytest.skip("no font with Hebrew letters")
    assert isinstance(font_for(text), PillowFont)
    letters = drawn(text)
    assert letters.max() == 255
    assert letters.shape[1] > drawn(text[:2]).shape[1]


@needs_opencv_5
@pytest.mark.usefixtures("no_machine_fonts")
def test_older_versions_of_opencv_leave_pillows_font(monkeypatch: pytest.MonkeyPatch) -> None:
    assert isinstance(font_for("日本"), OpenCVFont)
    monkeypatch.delattr(cv2, "FontFace")
    assert font_for("日 b").missing == "日"
