"""The browser view from another container: the page, its scene over WebSocket, nothing from other hosts."""

import io
import os

import cv2
import httpx2
import numpy as np
import pytest
from PIL import Image

from tests.support.browser import Watched, chromium, wait_in_page

pytestmark = [pytest.mark.compose, pytest.mark.browser]


@pytest.mark.skipif("SCENEGATE_URL" not in os.environ, reason="test_image runs it")
def test_the_page_shows_the_demo_scene(url: str) -> None:
    with chromium() as browser:
        shown = Watched(browser, url, width=480, height=320)  # more pixels of the demo take a minute without a GPU
        wait_in_page(shown.page, "scenegate.model.find(['demo', 'robot'])?.parts != null")
        before = where(shown)
        wait_in_page(
            shown.page,
            "before => JSON.stringify(scenegate.model.find(['demo', 'drone']).local.elements) != before",
            before,
        )
        png = shown.page.locator(".stage canvas").screenshot()
        picture = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))
        assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 100, "something is drawn"
        assert shown.faults == []


def where(shown: Watched) -> str:
    found: str = shown.page.evaluate("JSON.stringify(scenegate.model.find(['demo', 'drone']).local.elements)")
    return found


def test_a_picture_by_our_own_rasterizer(http: httpx2.Client) -> None:
    answer = http.get("/view/frame.jpg", params={"camera": "fit", "width": 320, "height": 240})
    assert answer.status_code == 200, answer.text
    picture = cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    assert picture.shape == (240, 320, 3)
    assert picture.std() > 10
