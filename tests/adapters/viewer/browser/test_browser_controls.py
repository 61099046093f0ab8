"""Controls of programs in a real browser: a client adds them, a visitor uses them by pointer, keyboard and touch."""

import math
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import pytest

from scenegate import Box, TreeViewer
from scenegate.tree.control_panel import ControlHandle
from tests.adapters.viewer.browser.page import View, hub_url, needs_axe
from tests.files.robots.files import ARM, write
from tests.support.waiting import SECONDS

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@pytest.fixture
def view(browser: Any, url: str, client: TreeViewer) -> Iterator[View]:
    """The page."""
    with View(browser, url) as view:
        yield view


def test_controls_of_all_types(view: View, client: TreeViewer, browser: Any, url: str) -> None:
    received: list[Any] = []
    arm = client.controls["Arm"]
    speed = client.controls.add_slider("Speed", 0, 2, value=0.5, unit="m/s")
    arm.add_button("Start").on_click(lambda: received.append("start"))
    controls: list[ControlHandle[Any]] = [
        speed,
        arm.add_number("Gain", 3.0, max=4.0),
        arm.add_text("Name", "panda"),
        arm.add_checkbox("Gravity"),
        arm.add_dropdown("Mode", ["position", "torque"]),
        arm.add_color("Colour", (1, 0, 0)),
    ]
    for control in controls:
        control.on_update(received.append)
    page = view.page
    page.get_by_text("Arm").wait_for()  # the panel opens for the first control
    slider = page.get_by_role("slider", name="Speed")
    slider.focus()
    page.keyboard.press("ArrowRight")
    page.get_by_role("button", name="Start").click()
    page.get_by_label("Gain").fill("9")
    page.keyboard.press("Enter")
    page.get_by_label("Name").fill("ü" * 5)
    page.keyboard.press("Tab")
    page.get_by_label("Gravity").check()
    page.get_by_label("Mode").select_option("torque")
    page.get_by_label("Colour").fill("#00ff00")
    view.until(lambda: len(received) == 7, f"seven values: {received}")
    assert received == [pytest.approx(0.52), "start", 4.0, "ü" * 5, True, "torque", (0.0, 1.0, 0.0)]
    with View(browser, url) as other:
        other.until(lambda: float(other.page.get_by_role("slider", name="Speed").input_value()) == 0.52, "the value")
        assert other.page.get_by_label("Mode").input_value() == "torque"
        speed.value = 1.5
        for each in (view, other):
            field = each.page.get_by_label("Speed, value")
            each.until(lambda: field.input_value() == "1.5", "the program's value")  # noqa: B023 - used at once
    page.get_by_label("Gain").fill("2")
    page.keyboard.press("Escape")
    assert page.get_by_label("Gain").input_value() == "4"
    arm.delete()
    page.get_by_text("Arm").wait_for(state="detached")
    assert slider.is_visible()


def test_a_slider_of_a_published_robot_is_dragged(view: View, url: str, tmp_path: Path) -> None:
    robot = write(tmp_path, ARM)
    command = [sys.executable, "-m", "scenegate", "publish", str(robot), "--path", "arm", "--lcm-url", hub_url(url)]
    process = subprocess.Popen([*command, "--timeout", str(SECONDS)])
    try:
        slider = view.page.get_by_role("slider", name="elbow")
        slider.wait_for()
        hand = "scenegate.model.find(['arm', 'hand']).world.elements"
        before = np.array(view.page.evaluate(hand))
        box = slider.bounding_box()
        middle = box["y"] + box["height"] / 2
        view.page.mouse.move(box["x"] + box["width"] / 2, middle)
        view.page.mouse.down()
        for part in (0.6, 0.7, 0.75):
            view.page.mouse.move(box["x"] + part * box["width"], middle)
        view.page.mouse.up()
        angle = float(slider.input_value())
        assert angle == pytest.approx(math.pi / 2, abs=0.3)
        view.until(lambda: not np.allclose(view.page.evaluate(hand), before), "the hand turns")

        def rotation() -> Any:
            return np.array(view.page.evaluate(hand)).reshape(4, 4).T[:3, :3]

        R = before.reshape(4, 4).T[:3, :3]
        cosine = math.cos(angle)
        view.until(lambda: abs((np.trace(R.T @ rotation()) - 1) / 2 - cosine) < 1e-3, "by the slider's angle")
        view.page.get_by_role("button", name="Reset").click()
        view.until(lambda: np.allclose(rotation(), R, atol=1e-5), "the first pose")
        assert slider.input_value() == "0"
    finally:
        process.terminate()
        process.wait()
    slider.wait_for(state="detached")


def test_a_plot_shows_its_curves(view: View, client: TreeViewer) -> None:
    plot = client.controls.add_plot("Torque", "left", "right", unit="N m", seconds=10)
    times = np.arange(0, 20, 0.1)
    plot.add_samples(times, np.column_stack([np.sin(times), np.full(len(times), np.nan)]))
    image = view.page.get_by_role("img", name="Torque: left")
    image.wait_for()
    view.until(
        lambda: image.get_attribute("aria-label") == f"Torque: left {math.sin(19.9):.4g} N m, right –",
        "the newest values",
    )
    left, right = (image.locator("path").nth(i).get_attribute("d") for i in range(2))
    assert (left.count("L"), right) == (99, "")  # the last ten seconds
    plot.add(-2.0, 1.0, time_s=20.0)
    view.until(lambda: image.get_attribute("aria-label") == "Torque: left -2 N m, right 1 N m", "a new sample")


def test_a_gizmo_moves_a_node(view: View, client: TreeViewer) -> None:
    client["cell"].transform((0, 0, 0.25))
    client["cell"]["box"].set(Box((0.2, 0.2, 0.2), color=(1, 0, 0)), transform=(0.5, 0, 0))
    view.look_at("cell", "box")
    gizmo = client.controls.add_gizmo("Target", "cell/box")
    view.page.get_by_label("x m").wait_for()
    assert view.page.get_by_label("z m").input_value() == "0"
    fields = view.page.get_by_role("group", name="Target").bounding_box()
    panel = view.page.get_by_role("tabpanel", name="Controls").bounding_box()
    assert fields is not None
    assert panel is not None
    assert panel["x"] < fields["x"] < fields["x"] + fields["width"] < panel["x"] + panel["width"] + 1
    assert panel["y"] < fields["y"]
    node = "scenegate.model.find(['cell', 'box']).world.elements.slice(12, 15)"
    start = view.at(0.5, 0, 0.25)

    def dragged() -> bool:
        # again: the page may not have drawn the handles yet; the x axis points right, its handle is beside the centre
        view.drag(start[0] + 40, start[1], start[0] + 140, start[1], steps=5)
        return gizmo.value is not None

    view.until(dragged, "a new pose")
    view.until(lambda: view.page.evaluate(node)[0] > 0.6, "the node moves")
    assert view.page.evaluate(node)[1:] == pytest.approx([0, 0.25], abs=1e-6)

    def pose() -> Any:
        assert gizmo.value is not None
        return gizmo.value

    view.until(lambda: np.allclose(pose()[:3, 3], [view.page.evaluate(node)[0], 0, 0], atol=1e-5), "its pose")
    view.page.get_by_label("Target, handles").select_option("rotate")
    view.page.get_by_label("yaw °").fill("90")
    view.page.keyboard.press("Enter")
    view.until(lambda: np.allclose(pose()[:3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-5), "it turns")
    client["cell"].delete()
    view.page.get_by_text("cell / box is not in the scene").wait_for()


def test_a_gizmo_of_a_followed_node(view: View, client: TreeViewer) -> None:
    """The camera follows after the drag: otherwise it would move the handle under the pointer on and on."""
    client["box"].set(Box((0.2, 0.2, 0.2), color=(1, 0, 0)), transform=(0, 0, 0.25))
    view.look_at("box")
    client.controls.add_gizmo("Target", "box")
    view.page.get_by_label("x m").wait_for()
    view.page.evaluate("scenegate.select(scenegate.model.find(['box']))")
    view.page.keyboard.press("c")
    view.until(lambda: "&follow=" in unquote(view.page.url), "the address of a camera that was not moved")
    moved = "scenegate.model.find(['box']).world.elements[12]"
    start = view.at(0, 0, 0.25)

    def dragged() -> bool:
        view.drag(start[0] + 40, start[1], start[0] + 100, start[1], steps=30)
        return bool(view.page.evaluate(moved) > 0)

    view.until(dragged, "the node moves")
    assert view.page.evaluate(moved) < 0.4


@needs_axe
def test_accessibility_rules_of_axe(view: View, client: TreeViewer) -> None:
    client["box"].set(Box((1, 1, 1)))
    folder = client.controls["Arm"]
    folder.add_slider("Speed", 0, 1, unit="m/s")
    folder.add_number("Gain", unit="N/m")
    folder.add_text("Name")
    folder.add_checkbox("Gravity")
    folder.add_dropdown("Mode", ["a", "b"])
    folder.add_color("Colour")
    folder.add_button("Start")
    folder.add_gizmo("Target", "box")
    folder.add_gizmo("Lost", "nothing")
    folder.add_plot("Torque", *(f"joint {i}" for i in range(10)), unit="N m").add(*range(10))
    view.page.get_by_text("Torque").wait_for()
    view.check_accessibility("the controls")


def test_a_phone_shows_all_tabs_and_controls(browser: Any, url: str, client: TreeViewer) -> None:
    long = {letter: letter * 100 for letter in "abcdefgu"}
    client["box"].set(Box((1, 1, 1)))
    with client.controls.batch():
        client.controls.add_slider("Speed " + "x" * 60, -1e6, 1e6, value=-123456.7, unit=long["u"])
        client.controls[long["f"]].add_button(long["b"])
        client.controls.add_number(long["a"], 3, unit=long["u"])
        client.controls.add_checkbox(long["c"])
        client.controls.add_dropdown(long["d"], [long["e"]])
        client.controls.add_gizmo(long["g"], "box")
        plot = client.controls.add_plot(long["e"], long["a"], unit=long["u"])
    plot.add(1.0)
    with View(browser, url, width=390, height=844) as view:
        view.page.get_by_role("button", name="Selection, stereo").click()
        view.page.get_by_role("tab", name="Controls").click()
        view.page.get_by_role("slider", name="Speed").wait_for()
        wide = "[...document.querySelectorAll('.right *')].filter((e) => e.getBoundingClientRect().right > 391).length"
        view.until(lambda: view.page.evaluate(wide) == 0, "everything is on the screen")
