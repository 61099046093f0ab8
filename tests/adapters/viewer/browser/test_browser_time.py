"""The time bar, in a real browser: a page that rests while the scene moves, and its address."""

import re
import time
from collections.abc import Iterator
from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest

from scenegate import Box, TreeViewer
from tests.adapters.viewer.browser.page import FLAGS, View
from tests.support import clients
from tests.support.gateway_process import gateway_process

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@pytest.fixture
def view(browser: Any, url: str, client: TreeViewer) -> Iterator[View]:
    """The page with a cart at x = 0."""
    client["cart"].set(Box((0.4, 0.3, 0.2), color=(1, 0, 0)), transform=(0, 0, 0))
    with View(browser, url) as view:
        view.wait_for_node("cart")
        yield view


def move(viewer: TreeViewer, x: float) -> None:
    viewer["cart"].transform((x, 0, 0))


def x_of(view: View) -> float:
    """Return x of the cart on the page."""
    x: float = view.page.evaluate("scenegate.model.find(['cart']).world.elements[12]")
    return x


def bar(view: View) -> Any:
    return view.page.get_by_role("region", name="Time of the scene")


def moment(view: View) -> str:
    return str(bar(view).get_by_role("status").inner_text())


def test_a_page_rests_while_the_scene_moves_until_it_is_live_again(view: View, client: TreeViewer) -> None:
    move(client, 1.0)
    view.until(lambda: x_of(view) == 1.0, "live")
    bar(view).get_by_role("button", name="Pause").click()
    view.until(lambda: bar(view).get_by_role("button", name="Play (P)").is_visible(), "paused")
    for x in (2.0, 3.0):
        move(client, x)
        time.sleep(0.1)  # short: the history merges changes within 11 ms
    view.until(lambda: re.match(r"[1-9]\d*\.\d s ago", moment(view)), "a second later")
    assert x_of(view) == 1.0
    view.page.keyboard.press(".")
    view.until(lambda: x_of(view) == 2.0, "one change forward")
    view.page.keyboard.press(",")
    view.page.keyboard.press(",")
    view.until(lambda: x_of(view) == 0.0, "two changes back")
    bar(view).get_by_role("button", name="Live").click()
    view.until(lambda: x_of(view) == 3.0, "live again")
    assert not bar(view).get_by_role("status").is_visible()


def test_the_slider_is_dragged_and_has_keys(view: View, client: TreeViewer) -> None:
    client["new"].set(Box((0.1, 0.1, 0.1)))  # carts of other tests are in the history
    move(client, 1.0)
    view.until(lambda: x_of(view) == 1.0, "live")
    slider = bar(view).get_by_role("slider", name="Time")
    slider.focus()
    slider.press("Home")
    view.until(lambda: view.page.evaluate("scenegate.model.find(['new'])") is None, "before it was published")
    assert view.page.locator(".empty-state").count() == 0, "the scene of now is not empty"
    assert " ago" in slider.get_attribute("aria-valuetext")
    slider.press("End")
    view.until(lambda: view.page.evaluate("scenegate.model.find(['new'])") and x_of(view) == 1.0, "live")
    view.page.evaluate("new Promise((done) => setTimeout(done, 3500))")  # so long a history
    for _ in range(3):
        slider.press("ArrowLeft")
    view.until(lambda: re.match(r"[3-9]\.\d s ago", moment(view)), "each key counts")
    rate = bar(view).get_by_role("combobox", name="Rate")
    rate.focus()
    rate.dispatch_event("pointerdown")  # a click would open a menu of the system
    rate.select_option("2")
    view.page.keyboard.press("l")
    view.until(lambda: not bar(view).get_by_role("status").is_visible(), "live by key after a rate was chosen")
    box = slider.bounding_box()
    view.page.mouse.click(box["x"] + 0.25 * box["width"], box["y"] + 0.5 * box["height"])
    view.until(lambda: bar(view).get_by_role("button", name="Play (P)").is_visible(), "paused by the mouse")


def test_the_address_has_the_moment(view: View, client: TreeViewer, browser: Any, url: str) -> None:
    move(client, 1.0)
    view.until(lambda: x_of(view) == 1.0, "live")
    view.page.keyboard.press("p")
    view.until(lambda: "time=" in view.page.url, "the address has the time")
    time = parse_qs(urlsplit(view.page.url).fragment)["time"][0]
    move(client, 2.0)
    listing = clients.get(f"{url}/scene", params={"time": time}).json()
    assert next(node for node in listing["nodes"] if node["path"] == ["cart"])["transform"][0][3] == 1.0
    with view.page.expect_response(lambda each: "scene/render" in each.url) as response:
        view.page.get_by_role("link", name="Render").click()
    drawn_at = parse_qs(urlsplit(response.value.url).query)["time"][0]
    assert float(drawn_at) == pytest.approx(float(time), rel=0.0, abs=1e-3)
    with View(browser, url) as other:
        other.page.goto(view.page.url)
        other.until(lambda: other.page.evaluate("scenegate.model.find(['cart'])") and x_of(other) == 1.0, "that moment")
        other.page.keyboard.press("l")
        other.until(lambda: x_of(other) == 2.0 and "time=" not in other.page.url, "live again")


def test_a_page_is_live_if_the_gateway_comes_back_without_history(browser: Any) -> None:
    with gateway_process(*FLAGS) as (_, url):
        view = View(browser, url)
        view.until(lambda: bar(view).is_visible(), "a time bar")
        view.page.keyboard.press("p")
        view.until(lambda: "time=" in view.page.url, "paused")
    with gateway_process(*FLAGS, "--port", url.rsplit(":", 1)[1], "--history-seconds", "0"):
        view.until(lambda: bar(view).count() == 0 and "time=" not in view.page.url, "live, without a time bar")
    view.page.close()
