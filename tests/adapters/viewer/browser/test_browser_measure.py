"""Distances, clicked points, axes and names of nodes, the axes to look along, and point sizes, in a real browser."""

import io
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.adapters.viewer.browser.page import Publisher, View, row

pytestmark = [pytest.mark.browser, pytest.mark.slow]

RED, GREEN = [1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 1.0]


@pytest.fixture
def view(shown: View, publisher: Publisher) -> View:
    """The page with a red box on the left and a green one on the right, seen from −Y."""
    publisher.box(["left"], RED, x=-1.0)
    publisher.box(["right"], GREEN, x=1.0)
    shown.look_at("right")
    shown.until(lambda: min(shown.share("red"), shown.share("green")) > 0.02, "two boxes")
    return shown


def test_distance_between_two_clicks(view: View) -> None:
    page = view.page
    before = view.colors()
    page.get_by_role("button", name="Measure between two points").click()
    bar = page.get_by_role("group", name="Measurement")
    bar.get_by_text("Click a point in the scene.").wait_for()
    page.mouse.click(*view.at(-1.0, -0.5, 0.2))
    bar.get_by_text("Click a second point.").wait_for()
    page.mouse.click(*view.at(1.0, -0.5, 0.2))
    text = bar.get_by_role("status").inner_text()
    distance, _, rest = text.partition(" m ")
    assert float(distance) == pytest.approx(2.0, abs=0.02)
    numbers = [float(word) for word in rest.replace(",", "").split() if word.lstrip("-")[:1].isdigit()]
    np.testing.assert_allclose(numbers, [2, 0, 0, -1, -0.5, 0.2, 1, -0.5, 0.2], atol=0.02)
    x, y = view.at(0.0, -0.5, 0.2)
    area = page.locator(".stage canvas").bounding_box()
    column, line = int(x - area["x"]), int(y - area["y"])
    beside = np.s_[line - 4 : line + 5, column]
    view.until(lambda: bool((view.colors()[beside] != before[beside]).any()), "a line between the points")
    assert page.locator(".details h2").count() == 0, "nothing is selected"
    page.keyboard.press("Escape")
    bar.wait_for(state="hidden")
    view.until(lambda: bool((view.colors()[beside] == before[beside]).all()), "the line is gone")


def test_the_bars_leave_the_view_of_a_phone_free(view: View, publisher: Publisher) -> None:
    page = view.page
    path = ["robot", "a-link-with-a-name-" + "x" * 60]
    publisher.box(path, RED, size=0.5)
    view.look_at(*path)
    page.set_viewport_size({"width": 390, "height": 844})
    page.evaluate("path => scenegate.select(scenegate.model.find(path))", path)
    page.get_by_role("button", name="Measure between two points").click()
    page.keyboard.press("c")
    for x in (-0.2, 0.2):
        page.mouse.click(*view.at(x, -0.25, 0.1))
    page.locator(".pill .ends").wait_for(state="attached")
    area = page.locator(".stage .view").bounding_box()
    bars = [bar.bounding_box() for bar in page.locator(".pill").all()]
    assert len(bars) == 2
    assert sum(bar["height"] for bar in bars) < 0.15 * area["height"]
    assert max(bar["x"] + bar["width"] for bar in bars) <= 390
    assert page.get_by_role("button", name="Stop following").is_visible()
    assert page.get_by_role("button", name="Stop measuring").is_visible()


def test_a_measurement_by_keyboard(view: View) -> None:
    """Enter clicks in the middle of the view, which a cross shows."""
    page = view.page
    page.keyboard.press("m")
    bar = page.get_by_role("group", name="Measurement")
    page.keyboard.press("Tab")
    page.locator(".stage canvas").focus()
    cross = "getComputedStyle(document.querySelector('.stage .view'), '::after').content"
    assert page.evaluate(cross) == '"+"'
    for x in (-1.0, 1.0):
        page.evaluate("x => scenegate.rig.place({ eye: [x, -4, 0], target: [x, 0, 0], up: [0, 0, 1] })", x)
        page.keyboard.press("Enter")
    view.until(lambda: bar.get_by_role("status").inner_text().startswith("2 m"), "the distance")
    page.keyboard.press("m")
    bar.wait_for(state="hidden")
    page.keyboard.press("Enter")
    page.locator(".details h2", has_text="right").wait_for()


def test_coordinates_of_a_clicked_point(view: View, publisher: Publisher) -> None:
    page = view.page
    page.mouse.click(*view.at(1.2, -0.5, 0.3))
    value = page.locator(".details dt", has_text="Clicked point").locator("+ dd")
    numbers = [float(word) for word in value.inner_text().split()]
    np.testing.assert_allclose(numbers, (1.2, -0.5, 0.3), atol=0.02)
    page.get_by_label("Relative to", exact=True).focus()
    page.get_by_label("Relative to", exact=True).select_option("left")
    view.until(lambda: float(value.inner_text().split()[0]) == pytest.approx(2.2, abs=0.02), "in another frame")
    row(view, ["right"]).click()
    value.wait_for(state="detached")
    assert publisher.sent > 0


def test_axes_to_look_along(view: View) -> None:
    """They turn with the camera; a click keeps target and distance."""
    gizmo = view.page.get_by_role("group", name="Look along an axis")
    camera = "[scenegate.rig.controls.getDistance(), ...scenegate.rig.view.target]"
    before = view.page.evaluate(camera)
    direction = """(() => {
      const { view: { eye, target }, controls } = scenegate.rig;
      return eye.map((x, i) => (x - target[i]) / controls.getDistance());
    })()"""
    for name, expected in (
        ("Top, from +Z", (0, 0, 1)),
        ("Back, from −X", (-1, 0, 0)),
        ("Left side, from +Y", (0, 1, 0)),
        ("Bottom, from −Z", (0, 0, -1)),
        ("Front, from +X", (1, 0, 0)),
        ("Right side, from −Y", (0, -1, 0)),
    ):
        gizmo.get_by_role("button", name=name).focus()
        view.page.keyboard.press("Enter")
        np.testing.assert_allclose(view.page.evaluate(direction), expected, atol=1e-3, err_msg=name)
    assert view.page.evaluate(camera) == pytest.approx(before, abs=1e-6)
    center = gizmo.bounding_box()
    x_axis = gizmo.get_by_role("button", name="Front, from +X")

    def x_is_right() -> bool:
        box = x_axis.bounding_box()
        return bool(box["x"] + box["width"] / 2 > center["x"] + center["width"] / 2 + 25)

    view.until(x_is_right, "x points to the right")


def test_points_have_a_size_in_metres(view: View, publisher: Publisher) -> None:
    """As large as a square of the same size, at any distance and in an orthographic view."""
    publisher.send(delete=[{"path": []}])
    cloud = {"type": "pointcloud", "points": [[0, 0, 0]], "color": RED}
    publisher.send(setgeometry=[{"path": ["point"], "geometry": cloud}])
    view.look_at("point")
    view.open_display_menu()
    view.page.get_by_label("Point size").select_option("Metres")
    view.page.get_by_label("Size of points").fill("0.5")

    def side() -> float:
        """Side of the red square, in metres at its distance."""
        pixels = view.colors().astype(int)
        red = pixels[:, :, 0] > pixels[:, :, 1:].max(axis=2) + 90
        return float(red.any(axis=0).sum() / height_of_a_metre())

    def height_of_a_metre() -> float:
        return view.at(0, 0, 0)[1] - view.at(0, 0, 1)[1]

    view.until(lambda: side() == pytest.approx(0.5, abs=0.03), "half a metre")
    view.page.keyboard.press("Escape")
    view.page.keyboard.press("-")
    view.page.keyboard.press("-")
    view.until(lambda: side() == pytest.approx(0.5, abs=0.03), "half a metre, farther away")
    view.open_display_menu()
    view.page.get_by_label("Orthographic").check()
    view.until(lambda: side() == pytest.approx(0.5, abs=0.03), "half a metre in an orthographic view")
    view.page.get_by_label("Point size").select_option("Pixels")
    view.page.get_by_label("Size of points").fill("30")
    view.until(lambda: side() * height_of_a_metre() == pytest.approx(30, abs=1), "30 pixels")
    view.page.get_by_label("Point size").select_option("As published")
    view.until(lambda: side() * height_of_a_metre() < 5, "one pixel")


def test_axes_and_names_of_nodes(view: View, publisher: Publisher) -> None:
    """They move with the node, and are kept when it is published again; axes have the same size from afar."""
    page = view.page
    publisher.send(delete=[{"path": []}])
    publisher.box(["robot", "arm"], [0.2, 0.2, 0.2, 1.0], x=-1.0, size=0.01)
    view.look_at("robot", "arm")
    row(view, ["robot"]).click()
    page.get_by_label("Name", exact=True).check()
    page.get_by_label("Axes", exact=True).check()
    names = page.locator(".marks span")
    view.until(lambda: names.all_inner_texts() == ["robot"], "the name of the robot")
    page.get_by_label("and below").check()
    view.until(lambda: sorted(names.all_inner_texts()) == ["arm", "robot"], "the names of both")
    arm = page.locator(".marks span", has_text="arm")

    def red() -> tuple[float, float]:
        """Return the place of the arm's x axis, at its left end, and its length in pixels."""
        pixels = view.colors().astype(int)
        pixels = pixels[:, : pixels.shape[1] // 2 - 20]
        columns = np.flatnonzero((pixels[:, :, 0] > pixels[:, :, 2] + 90).any(axis=0))
        return (float(columns[0]), float(len(columns))) if len(columns) else (0.0, 0.0)

    canvas = page.locator(".stage canvas").bounding_box()
    height = canvas["height"]

    def is_at(x: float) -> bool:
        left, _ = view.at(x, 0, 0)
        box = arm.bounding_box()
        return bool(abs(box["x"] - left) < 12 and abs(red()[0] + canvas["x"] - left) < 4)

    view.until(lambda: is_at(-1.0), "axes and name at the arm")
    length = red()[1]
    assert length == pytest.approx(0.06 * height, abs=6)
    publisher.send(settransform=[publisher.at(["robot", "arm"], -0.7)])
    view.until(lambda: is_at(-0.7), "they move with it")
    with page.expect_download() as download:
        page.get_by_role("button", name="PNG").click()
    drawn = np.asarray(Image.open(download.value.path()).convert("RGB")).astype(int)
    rows, columns = np.nonzero(np.abs(drawn - view.colors()).max(axis=2) > 20)
    boxes = [name.bounding_box() for name in names.all()]
    left, right = min(box["x"] for box in boxes), max(box["x"] + box["width"] for box in boxes)
    assert left - 2 <= columns.min() + canvas["x"] < columns.max() + canvas["x"] <= right + 2
    assert len({*rows.tolist()}) >= 8, "the image has the names"
    page.evaluate("document.activeElement.blur()")
    for _ in range(3):
        page.keyboard.press("-")
    view.until(lambda: is_at(-0.7) and abs(red()[1] - length) < 3, "the same size from farther away")
    publisher.send(delete=[{"path": ["robot"]}])
    view.until(lambda: names.count() == 0, "no names")
    publisher.box(["robot", "arm"], [0.2, 0.2, 0.2, 1.0], x=-1.0, size=0.01)
    view.until(lambda: names.count() == 2, "both names are back")
    page.get_by_role("tree").focus()
    row(view, ["robot"]).locator(".eye").click()
    view.until(lambda: names.count() == 0, "no names of hidden nodes")


def test_views_side_by_side(view: View, publisher: Publisher) -> None:
    """From above, and from a node: red is on the left, green on the right, and both follow the scene."""
    page = view.page
    publisher.send(
        setgeometry=[{"path": ["camera"], "geometry": {"type": "triad", "scale": 0.1}}],
        settransform=[{"path": ["camera"], "transform": {"translation": [0, -6, 0], "quaternion": [1, -1, 0, 0]}}],
    )
    row(view, ["camera"]).click()
    width = page.locator(".stage .view").bounding_box()["width"]
    view.open_display_menu()
    page.get_by_label("From above", exact=True).check()
    page.get_by_label("Image of").select_option("camera")
    page.keyboard.press("Escape")
    assert page.locator(".stage .view").bounding_box()["width"] == pytest.approx(0.66 * width, abs=2)
    above, seen = page.locator(".sideviews canvas"), page.locator(".sideviews img")

    def colors(of: Any) -> tuple[float, float]:
        """Return the shares of red on the left and of green on the right."""
        pixels = np.asarray(Image.open(io.BytesIO(of.screenshot())).convert("RGB")).astype(int)[30:]
        half = pixels.shape[1] // 2
        red = pixels[:, :half, 0] > pixels[:, :half, 1:].max(axis=2) + 60
        green = pixels[:, half:, 1] > pixels[:, half:, ::2].max(axis=2) + 60
        return float(red.mean()), float(green.mean())

    view.until(lambda: min(colors(above)) > 0.01, "both boxes from above")
    view.until(lambda: min(colors(seen)) > 0.01, "both boxes in the image of the camera")
    publisher.send(delete=[{"path": ["left"]}])
    view.until(lambda: colors(above)[0] == colors(seen)[0] == 0.0, "the red one is gone from both")
    view.until(lambda: view.share("green") > 0.02, "the view has the other one")
    page.set_viewport_size({"width": 360, "height": 740})
    main = page.locator(".stage .view")
    view.until(lambda: above.bounding_box()["y"] >= sum(main.bounding_box()[each] for each in ("y", "height")), "below")
    view.open_display_menu()
    page.get_by_label("From above", exact=True).uncheck()
    page.get_by_label("Image of").select_option("None")
    page.locator(".sideviews").wait_for(state="detached")
