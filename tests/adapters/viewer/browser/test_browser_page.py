"""What clients set for the page, in a real browser: clicks, background, grid, home camera, hidden and faded nodes."""

import json
import queue
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from gateway.adapters.viewer.routes import ACKNOWLEDGE, ACKNOWLEDGE_CONTROLS
from scenegate import Box, Click, TreeViewer
from tests.adapters.viewer.browser.page import View
from tests.support import clients
from tests.support.browser import PAGE_SECONDS

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@pytest.fixture
def view(browser: Any, url: str, client: TreeViewer) -> Iterator[View]:
    """The page with a green box on the left and a red one on the right."""
    client.set_view(background=None, grid=None, home=None)
    client["ui"]["go"].set(Box((1, 1, 1), color=(0, 1, 0)), transform=(-1, 0, 0))
    client["robot"].set(Box((1, 1, 1), color=(1, 0, 0)), transform=(1, 0, 0))
    with View(browser, url) as view:
        view.look_at("robot")
        view.until(lambda: min(view.share("red"), view.share("green")) > 0.02, "two boxes")
        yield view


def test_a_click_arrives_at_the_client(view: View, client: TreeViewer) -> None:
    sent: list[str] = []
    view.page.on("websocket", lambda socket: socket.on("framesent", lambda text: sent.append(text)))
    view.page.reload()
    view.look_at("robot")
    heading = view.page.locator(".details h2")

    def selected() -> bool:
        view.page.mouse.click(*view.at(-1.0, -0.5, 0))  # again: the page may not have drawn the boxes yet
        texts: list[str] = heading.all_inner_texts()
        return texts == ["ui / go"]

    view.until(selected, "the box is selected")
    assert set(sent) <= {ACKNOWLEDGE, ACKNOWLEDGE_CONTROLS}, "no client wants clicks"
    received: queue.Queue[Click] = queue.Queue()
    stop = client.on_click("ui", received.put)
    view.until(
        lambda: view.page.mouse.move(*view.at(-1.0, -0.5, 0)) or cursor(view) == "pointer", "a pointer on the button"
    )
    view.until(lambda: view.page.mouse.move(*view.at(1.0, -0.5, 0)) or cursor(view) == "", "no pointer elsewhere")
    view.page.mouse.click(*view.at(1.0, -0.5, 0))
    for button in ("left", "middle", "right"):
        view.page.mouse.click(*view.at(-1.0, -0.5, 0), button=button)
        click = received.get(timeout=PAGE_SECONDS)
        assert (click.path, click.button) == (("ui", "go"), button)
        np.testing.assert_allclose(click.point, (-1.0, -0.5, 0.0), atol=0.02)
    stop()
    view.page.mouse.move(*view.at(-1.0, -0.5, 0))
    view.until(lambda: cursor(view) == "", "no pointer any more")
    assert received.empty()


def cursor(view: View) -> str:
    style: str = view.page.evaluate("scenegate.stage.canvas.style.cursor")
    return style


def test_the_page_follows_the_view_of_the_client(view: View, client: TreeViewer, browser: Any, url: str) -> None:
    client.set_view(background=(0.0, 0.0, 1.0), grid=False, home=((0, 0.1, 8), (0, 0, 0), (0, 1, 0)))
    where = "[...scenegate.rig.camera.position.toArray(), ...scenegate.rig.camera.up.toArray()]"
    home = [0, 0.1, 8, 0, 1, 0]
    with View(browser, url) as later:
        for page in (view, later):
            page.until(lambda: page.share("blue") > 0.5, "a blue background")  # noqa: B023 - used at once
            page.until(lambda: np.allclose(page.page.evaluate(where), home), "the home camera")  # noqa: B023 - used at once
            assert not page.page.evaluate("scenegate.stage.grid.visible")
            page.open_display_menu()
            assert not page.page.get_by_label("Grid on the ground").is_checked()
            page.page.keyboard.press("Escape")
    view.page.get_by_role("button", name="Top, from").click()
    view.until(lambda: view.page.evaluate("scenegate.rig.camera.up.toArray()") == [0, 0, 1], "from above")
    view.page.keyboard.press("h")
    view.until(lambda: np.allclose(view.page.evaluate(where), home), "home again")
    view.open_display_menu()
    view.page.get_by_label("Background").select_option("white")
    view.until(lambda: view.share("blue") < 0.01, "the visitor's own background")
    view.page.get_by_label("Background").select_option("theme")
    client.set_view(background=None, grid=True)
    view.until(lambda: view.share("blue") < 0.01, "the page's own background")
    assert view.page.evaluate("scenegate.stage.grid.visible")
    client.set_view(home=None, grid=None)  # for later tests, which have the same gateway


def test_hidden_and_faded_nodes(view: View, client: TreeViewer, url: str) -> None:
    client["robot"].set_visible(False)
    client["ui"].set_opacity(0.1)
    view.until(lambda: view.share("red") == 0.0, "the robot is hidden")
    view.until(lambda: view.share("green") < 0.01, "the button is faded")
    glb = clients.get(f"{url}/scene.glb").content
    (length,) = struct.unpack_from("<I", glb, 12)
    names = [node.get("name") for node in json.loads(glb[20 : 20 + length])["nodes"]]
    assert "ui" in names
    assert "robot" not in names
    client["robot"].set_visible(True)
    client["ui"].set_opacity(1.0)
    view.until(lambda: min(view.share("red"), view.share("green")) > 0.02, "both are back")


def test_one_light_opens_the_state_of_all_interfaces(view: View, client: TreeViewer) -> None:
    """It has the worst state, and fits windows of any width."""
    light = view.page.locator(".status summary .light")
    view.until(lambda: light.inner_text().endswith(" interfaces ready"), "all are ready")
    green = light.evaluate("e => getComputedStyle(e, '::before').backgroundColor")
    client["bad"].set(Box((-1, 1, 1)))
    view.until(lambda: light.inner_text() == "Tree viewer: 1 warning", "a warning")
    assert light.evaluate("e => getComputedStyle(e, '::before').backgroundColor") != green
    view.page.evaluate("document.querySelector('.status').style.fontSize = '15px'")  # as a larger font of the browser
    cut = "() => { const e = document.querySelector('.status'); return e.scrollWidth > e.clientWidth; }"
    for width in (320, 700, 900, 1280, 1600):
        view.page.set_viewport_size({"width": width, "height": 800})
        assert not view.page.evaluate(cut), width
        assert light.is_visible()
    light.click()
    sentence = view.page.get_by_text('setgeometry[0] ["bad"]: lengths has a negative number')
    sentence.wait_for()
    tree = view.page.locator(".status li", has_text="Tree viewer")
    assert view.page.locator(".status li", has_text=": ready").count() > 3
    client["bad"].delete()
    view.until(lambda: light.inner_text().endswith(" interfaces ready"), "all are ready again")
    sentence.wait_for(state="detached")
    view.page.locator(".status summary").focus()
    view.page.keyboard.press("Enter")
    tree.wait_for(state="hidden")
