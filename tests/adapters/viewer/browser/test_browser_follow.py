"""The camera that follows a node, and poses in a chosen frame, in a real browser."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from scenegate import Box, Transform, TreeViewer
from tests.adapters.viewer.browser.page import View, row
from tests.support.browser import wait_in_page

pytestmark = [pytest.mark.browser, pytest.mark.slow]

EYE = "scenegate.rig.view.eye"
TARGET = "scenegate.rig.view.target"
UP = "scenegate.rig.view.up"
LEFT = (0.5**0.5, 0.0, 0.0, 0.5**0.5)
"""A quarter turn to the left."""


@pytest.fixture
def view(browser: Any, url: str, client: TreeViewer) -> Iterator[View]:
    """The page with a car at x = 1 m."""
    publish(client)
    with View(browser, url) as view:
        view.look_at("road", "car")
        yield view


def publish(viewer: TreeViewer, x: float = 1.0) -> None:
    viewer["road"]["car"].set(Box((0.4, 0.3, 0.2), color=(1, 0, 0)), transform=(x, 0, 0))
    viewer["sign"].set(Box((0.1, 0.1, 1), color=(0, 1, 0)), transform=(0, 1, 0))


def read(view: View, what: str) -> list[float]:
    values: list[float] = view.page.evaluate(what)
    return values


def test_camera_follows_a_node_and_keeps_its_heading(view: View, client: TreeViewer) -> None:
    page = view.page
    row(view, ["road", "car"]).click()
    eye, target = np.array(read(view, EYE)), np.array(read(view, TARGET))
    page.get_by_role("button", name="Follow", exact=True).click()
    bar = page.get_by_role("group", name="The camera follows a node")
    assert "road / car" in bar.inner_text()
    client["road"].transform(Transform((0, 3, 0), LEFT))
    view.until(lambda: np.allclose(read(view, EYE), np.add(eye, (-1, 4, 0))), "the camera has moved as the car")
    np.testing.assert_allclose(read(view, TARGET), np.add(target, (-1, 4, 0)), atol=1e-6)
    page.get_by_role("button", name="Top, from").click()
    above = np.array(read(view, EYE))
    client["road"].delete()
    bar.get_by_text("is not in the scene").wait_for()
    np.testing.assert_allclose(read(view, EYE), above)
    publish(client, x=9.0)
    view.until(lambda: np.allclose(read(view, EYE), np.add(above, (9, -4, 0))), "the camera follows the new node")
    bar.get_by_role("button", name="Stop following").click()
    bar.wait_for(state="hidden")
    client["road"]["car"].transform((1, 0, 0))
    wait_in_page(page, "scenegate.model.find(['road', 'car']).world.elements[12] === 1")
    np.testing.assert_allclose(read(view, EYE), np.add(above, (9, -4, 0)))


def test_camera_rides_along_by_keyboard(view: View, client: TreeViewer) -> None:
    """A drag turns the camera about the direction that is up for the node."""
    page = view.page
    row(view, ["road"]).click()
    tree = page.get_by_role("tree")
    tree.focus()
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Shift+Enter")
    bar = page.get_by_role("group", name="The camera follows a node")
    mode = bar.get_by_label("The camera")
    assert mode.input_value() == "follow"
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("c")
    assert mode.input_value() == "ride"
    assert row(view, ["road", "car"]).get_by_label("The camera follows it").is_visible()
    ahead = np.array(read(view, TARGET)) - read(view, EYE)
    client["road"].transform(Transform((0, 0, 0), (0.5**0.5, 0.5**0.5, 0, 0)))  # on its right side
    view.until(lambda: np.allclose(read(view, UP), (0, -1, 0)), "the camera lies on its side, too")
    turned = np.array(read(view, TARGET)) - read(view, EYE)
    np.testing.assert_allclose(turned, (ahead[0], -ahead[2], ahead[1]), atol=1e-4)
    box = page.locator(".stage canvas").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    view.drag(x, y, x + 80, y)
    view.until(lambda: not np.allclose(np.subtract(read(view, TARGET), read(view, EYE)), turned), "the drag turns it")
    dragged = np.subtract(read(view, TARGET), read(view, EYE))
    np.testing.assert_allclose(dragged[1], turned[1], atol=1e-4)
    page.keyboard.press("c")
    bar.wait_for(state="hidden")


def test_followed_node_is_in_the_address(view: View, client: TreeViewer) -> None:
    """The camera of a link is relative to the node, wherever that is when the link is opened."""
    page = view.page
    page.evaluate("scenegate.select(scenegate.model.find(['road', 'car']))")
    page.keyboard.press("c")
    page.keyboard.press("c")
    eye = np.array(read(view, EYE))
    view.until(lambda: "&ride=" in page.url, "the address has the node")
    link = page.url
    client["road"]["car"].transform((1, 5, 0))
    view.until(lambda: np.allclose(read(view, EYE), np.add(eye, (0, 5, 0))), "the camera rides along")
    page.wait_for_timeout(1000)  # short: a slow page is only tested less
    assert page.url == link
    page.reload()
    view.wait_for_node("road", "car")
    view.until(lambda: np.allclose(read(view, EYE), np.add(eye, (0, 5, 0)), atol=1e-6), "the same view")
    page.keyboard.press("h")
    view.until(lambda: "#" not in page.url, "the home view follows nothing")
    page.evaluate("link => (location.hash = link)", link.partition("#")[2])
    view.until(lambda: np.allclose(read(view, EYE), np.add(eye, (0, 5, 0)), atol=1e-6), "a link is followed")
    page.evaluate("location.hash = 'eye=1,-5,2;target=1,0,2&follow=nothing'")
    view.until(lambda: np.allclose(read(view, EYE), (1, -5, 2)), "an address without a valid path")
    page.get_by_role("group", name="The camera follows a node").wait_for(state="hidden")


def test_pose_relative_to_a_chosen_frame(view: View, client: TreeViewer) -> None:
    client["road"].transform(Transform((10, 0, 0), LEFT))
    row(view, ["road", "car"]).click()
    position = view.page.locator(".details dd").first
    view.until(lambda: position.inner_text() == "10  1  0", "in the world")
    frame = view.page.get_by_label("Relative to", exact=True)
    frame.select_option("Parent")
    assert position.inner_text() == "1  0  0"
    frame.focus()
    frame.select_option("sign")
    assert position.inner_text() == "10  0  0"
    row(view, ["road"]).click()
    assert frame.input_value() == '["sign"]'
    view.until(lambda: position.inner_text() == "10  -1  0", "another node in the same frame")
    client["sign"].delete()
    view.until(lambda: "not in the scene" in position.inner_text(), "the frame is gone")
    publish(client)
    view.until(lambda: position.inner_text() == "10  -1  0", "the frame is back")
