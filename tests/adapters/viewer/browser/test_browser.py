"""The page in a real browser, against a real gateway, fed by real LCM."""

import base64
import io
import math
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from gateway.files.gltf import read_gltf
from tests.adapters.viewer.browser.page import FLAGS, Publisher, View, needs_axe, row
from tests.support import clients
from tests.support.browser import PAGE_SECONDS, new_page, wait_in_page
from tests.support.forms import CONTENT_TYPE, body, drake_fields, gltf
from tests.support.gateway_process import gateway_process
from tests.support.waiting import wait_until

pytestmark = [pytest.mark.browser, pytest.mark.slow]


STILL = """async () => {
  const where = () => [...scenegate.rig.camera.position.toArray(), ...scenegate.rig.controls.target.toArray()];
  const before = where();
  for (let frame = 0; frame < 3; frame += 1) await new Promise(requestAnimationFrame);
  return where().every((value, i) => Math.abs(value - before[i]) < 1e-6);
}"""
"""True if the camera did not move for three frames."""
RED, GREEN = [1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 1.0]


def test_published_box_appears_moves_and_disappears(shown: View, publisher: Publisher) -> None:
    shown.look()
    shown.until(lambda: shown.share("red") == 0.0, "an empty scene")
    publisher.box(["a", "box"], RED, x=-1.0)
    shown.look_at("a", "box")
    shown.until(lambda: shown.share("red", "left") > 0.02, "a red box on the left")
    assert shown.share("red", "right") == 0.0
    publisher.send(settransform=[publisher.at(["a", "box"], 1.0)])
    shown.until(lambda: shown.share("red", "right") > 0.02, "the box on the right")
    assert shown.share("red", "left") == 0.0
    publisher.send(delete=[{"path": ["a"]}])
    shown.until(lambda: shown.share("red") == 0.0, "the box is gone")


def test_hiding_and_opacity(shown: View, publisher: Publisher) -> None:
    publisher.box(["hide", "one"], RED, x=-1.0)
    publisher.box(["hide", "two"], GREEN, x=1.0)
    shown.look_at("hide", "two")
    shown.until(lambda: min(shown.share("red"), shown.share("green")) > 0.02, "two boxes")
    row(shown, ["hide", "one"]).locator(".eye").click()
    shown.until(lambda: shown.share("red") == 0.0, "one is hidden")
    assert shown.share("green") > 0.02
    publisher.send(settransform=[publisher.at(["hide", "one"], -0.9)])
    row(shown, ["hide", "one"]).locator(".eye").click()
    shown.until(lambda: shown.share("red") > 0.02, "one is back")
    row(shown, ["hide", "two"]).click()
    shown.page.get_by_label("Opacity").fill("0.1")
    shown.until(lambda: shown.share("green") < 0.01, "two is nearly transparent")
    assert shown.share("red") > 0.02


def png(pixels: Any) -> str:
    """Return pixels as a PNG file in base64."""
    file = io.BytesIO()
    Image.fromarray(np.asarray(pixels, np.uint8)).save(file, "PNG")
    return base64.b64encode(file.getvalue()).decode()


SQUARE = {"vertices": [[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]], "faces": [[0, 1, 2], [0, 2, 3]]}
TEXTURED = {"type": "mesh", **SQUARE, "uv": [[0, 1], [1, 1], [1, 0], [0, 0]]}
TEXT = {"type": "text", "text": "MM", "size": 1}
HAIRLINE = {"type": "line", "points": [[-1.5, 0, 0], [1.5, 0, 0]], "radius": 0, "color": RED}
UPRIGHT = {"quaternion": [0.5**0.5, 0.5**0.5, 0.0, 0.0]}
STANDING = {"transform": UPRIGHT}


RED_SHARES: list[tuple[dict[str, Any], float, float]] = [
    ({"type": "mesh", **SQUARE, "colors": [RED] * 4}, 0.12, 0.4),
    ({"type": "mesh", **SQUARE, "colors": [[1, 0, 0, 0.02]] * 4}, 0.0, 0.0),
    ({**TEXTURED, "image": png([[[255, 0, 0], [0, 0, 0]]])}, 0.05, 0.3),
    ({"type": "image", "image": png([[[255, 0, 0, 255]]]), "width": 2, **STANDING}, 0.12, 0.4),
    ({"type": "image", "image": png([[[255, 0, 0, 0]]]), "width": 2, **STANDING}, 0.0, 0.0),
    ({**TEXT, "color": RED, **STANDING}, 0.01, 0.2),
    ({**TEXT, "color": GREEN, "background": RED, **STANDING}, 0.05, 0.2),
    (HAIRLINE, 0.0002, 0.005),
    ({**HAIRLINE, "line_width": 60}, 0.04, 0.2),
    ({"type": "pointcloud", "points": [[0, 0, 0]], "color": RED, "point_size": 8}, 0.00003, 0.0005),
    ({"type": "pointcloud", "points": [[0, 0, 0]], "color": RED, "point_size": 256}, 0.05, 0.2),
    ({"type": "heightmap", "heights": [[0] * 2] * 2, "lengths": [2, 2], "color": RED, **STANDING}, 0.12, 0.4),
]
"""Geometries, and the smallest and largest share of the view that is red."""


def test_images_and_sizes_in_pixels(shown: View, publisher: Publisher) -> None:
    for number, (geometry, low, high) in enumerate(RED_SHARES):
        publisher.send(delete=[{"path": []}])
        publisher.send(setgeometry=[{"path": ["it", number], "geometry": geometry}])
        shown.wait_for_node("it", number)
        shown.look()
        shown.until(lambda: low <= shown.share("red") <= high, f"{low} to {high} of the view in red: {geometry}")  # noqa: B023 - used at once


def test_textures_of_replaced_and_deleted_images_are_freed(browser: Any) -> None:
    """An image, a text and a textured mesh: 45 updates, then deletes. A history would keep them for a minute."""
    with gateway_process(*FLAGS, "--history-seconds", "0") as (_, url), View(browser, url) as shown:
        _replace_and_delete_images(shown, Publisher(url))


def _replace_and_delete_images(shown: View, publisher: Publisher) -> None:
    page = shown.page
    page.set_viewport_size({"width": 300, "height": 240})

    def publish(count: int) -> None:
        pixels = png(np.full((4, 4, 3), (255, count % 256, 0)))
        for name, geometry in (
            ("image", {"type": "image", "image": pixels, "width": 1, "transform": UPRIGHT}),
            ("text", {"type": "text", "text": str(count), "size": 0.2, "color": GREEN}),
            ("mesh", {**TEXTURED, "image": pixels}),
        ):
            publisher.send(setgeometry=[{"path": [name], "geometry": geometry}])

    def drawn() -> dict[str, int]:
        counts: dict[str, int] = page.evaluate(
            """async () => {
              for (let frame = 0; frame < 3; frame += 1) await new Promise(requestAnimationFrame);
              return { ...scenegate.stage.renderer.info.memory };
            }"""
        )
        return counts

    publisher.box(["box"], RED, size=0.1)
    shown.look_at("box")
    before = drawn()
    publish(0)
    shown.look_at("mesh")
    shown.until(
        lambda: drawn()["textures"] == before["textures"] + 4, "three textures, and the one in which they are blended"
    )
    first = drawn()
    for count in range(1, 16):
        revision = page.evaluate("scenegate.model.revision")
        publish(count)
        wait_in_page(page, "before => scenegate.model.revision > before", revision)
    shown.until(lambda: drawn() == first, "three textures after 45 updates")
    publisher.send(delete=[{"path": [name]} for name in ("image", "text", "mesh")])
    shown.until(lambda: drawn() == before, "no texture after the deletes")


def test_image_stays_until_the_next_one_is_downloaded(shown: View, publisher: Publisher) -> None:
    """Late ones are shown until the newest is there: images may be published faster than they are downloaded."""
    held: list[Any] = []

    def publish(*color: int) -> None:
        pixels = png(np.full((4, 4, 3), color))
        geometry = {"type": "image", "image": pixels, "width": 2, **STANDING}
        publisher.send(setgeometry=[{"path": ["image"], "geometry": geometry}])

    publish(255, 0, 0)
    shown.look_at("image")
    shown.until(lambda: shown.share("red") > 0.1, "the first image")
    shown.page.route("**/view/image/*", lambda route: held.append(route))
    publish(0, 255, 0)
    shown.until(lambda: len(held) == 1, "the second image is requested")
    publish(0, 0, 255)
    shown.until(lambda: len(held) == 2, "the third image is requested")
    assert shown.share("red") > 0.1
    held[0].continue_()
    shown.until(lambda: shown.share("green") > 0.1, "the second image")
    held[1].continue_()
    shown.until(lambda: shown.share("blue") > 0.1, "the third image")


def test_large_coordinates_are_as_precise_as_small_ones(shown: View, publisher: Publisher, url: str) -> None:
    """A survey grid in metres: boxes of 4 cm, 8 cm apart, are seen apart; details and files have its numbers."""
    x, y = 500_000.0, 5_400_000.0
    for number in range(5):
        path = ["far", str(number)]
        box = {"type": "box", "lengths": [0.04] * 3, "color": RED}
        publisher.send(
            setgeometry=[{"path": path, "geometry": box}],
            settransform=[
                {"path": path, "transform": {"translation": [x + 0.08 * number, y, 0.123], "quaternion": [1, 0, 0, 0]}}
            ],
        )
    shown.until(lambda: row(shown, ["far", "4"]).count() == 1, "five boxes")
    shown.page.evaluate("for (const o of ['grid', 'axes']) scenegate.stage.show(scenegate.stage[o], false)")
    shown.page.keyboard.press("2")  # along x, which hides all but one
    shown.page.keyboard.press("3")

    def red_columns() -> NDArray[np.bool_]:
        pixels = shown.colors().astype(int)
        found: NDArray[np.bool_] = (pixels[:, :, 0] > pixels[:, :, 1:].max(axis=2) + 60).any(axis=0)
        return found

    def count() -> int:
        return int((np.diff(red_columns().astype(int)) == 1).sum())

    shown.until(lambda: count() == 5, "five red boxes side by side")
    columns = np.flatnonzero(red_columns())
    assert columns[-1] - columns[0] > 0.5 * len(red_columns()), "they fill the view"
    shown.page.evaluate("scenegate.select(scenegate.model.find(['far', '1']))")
    values = shown.page.locator(".details dd")
    assert values.nth(0).inner_text() == "500000.08  5400000  0.123"
    assert values.nth(3).inner_text().startswith("500000.06  5399999.98  0.103")
    with shown.page.expect_response(lambda each: "scene.glb" in each.url) as scene:
        shown.page.get_by_role("link", name=".glb").click()
    camera = parse_qs(urlsplit(scene.value.url).query)["camera"][0]
    target = [float(number) for number in camera.partition("target=")[2].partition(";")[0].split(",")]
    assert target == pytest.approx([x + 0.16, y, 0.123], abs=1e-3, rel=0)


def test_text_faces_the_camera(shown: View, publisher: Publisher) -> None:
    """A plane would be seen from the edge, or from behind."""
    text = {**TEXT, "color": GREEN, "background": RED}
    publisher.send(setgeometry=[{"path": ["it"], "geometry": {**text, "transform": UPRIGHT}}])
    shown.look_at("it")
    shown.until(lambda: shown.share("red") > 0.05, "the text is shown")
    for quaternion in ([1.0, 0.0, 0.0, 0.0], [0.5, 0.5, 0.5, 0.5], [0.0, 0.0, 1.0, 0.0]):
        publisher.send(setgeometry=[{"path": ["it"], "geometry": {**text, "transform": {"quaternion": quaternion}}}])
        sign = f"sign {quaternion}"
        publisher.box([sign], [0.0, 0.0, 1.0, 1.0], x=9.0, size=0.1)
        shown.until(lambda: row(shown, [sign]).count() == 1, "the turned text has arrived")  # noqa: B023 - used at once
        shown.until(lambda: 0.05 < shown.share("red") < 0.2, "the turned text looks the same")


def test_text_in_other_scripts(shown: View, publisher: Publisher) -> None:

    def mask(text: str) -> Any:
        """Publish a text; return which pixels of it are green."""
        before = shown.page.evaluate("scenegate.model.revision")
        geometry = {"type": "text", "text": text, "size": 1, "color": GREEN}
        publisher.send(setgeometry=[{"path": ["text"], "geometry": geometry}])
        wait_in_page(shown.page, "before => scenegate.model.revision > before", before)
        shown.look()
        shown.until(lambda: shown.share("green") > 0.005, text)
        pixels = shown.colors().astype(int)
        return pixels[:, :, 1] > pixels[:, :, 0] + 90

    question = mask("??")
    for text in ("Жю", "日本"):
        letters = mask(text)
        assert (letters != question).sum() > 0.3 * question.sum(), f"{text} is not drawn as ??"


def test_a_large_request_is_shown_at_once(shown: View, publisher: Publisher) -> None:
    """No state of the page has some of 5000 boxes, or one without its pose."""
    shown.page.set_viewport_size({"width": 300, "height": 240})
    shown.page.evaluate(
        """() => {
          const { model } = scenegate;
          const apply = model.apply.bind(model);
          window.states = [];
          model.apply = (update) => {
            const change = apply(update);
            const boxes = [...model.nodes.values()].filter((node) => node.parts);
            states.push([boxes.length, boxes.filter(({ world }) => world.elements[14] !== 7).length]);
            return change;
          };
        }"""
    )
    box = {"type": "box", "lengths": [0.1] * 3, "color": RED}
    commands = [{"path": ["boxes", str(number)]} for number in range(5000)]
    publisher.send(
        setgeometry=[{**each, "geometry": box} for each in commands],
        settransform=[
            {**each, "transform": {"translation": [number % 70, number // 70, 7], "quaternion": [1, 0, 0, 0]}}
            for number, each in enumerate(commands)
        ],
    )
    wait_in_page(shown.page, "states.at(-1)?.[0] === 5000")
    assert {tuple(state) for state in shown.page.evaluate("states")} <= {(0, 0), (5000, 0)}


IN_VIEW = """scenegate.model.nodes.size > 1 && [...scenegate.model.nodes.values()].every((node) => {
  const at = new scenegate.Box3().min.setFromMatrixPosition(node.world).project(scenegate.rig.camera);
  return Math.max(Math.abs(at.x), Math.abs(at.y)) < 1;
})"""
"""True if the places of all nodes are in view."""


@pytest.mark.parametrize("touched", [False, True])
def test_home_view_follows_the_first_nodes(shown: View, publisher: Publisher, touched: bool) -> None:
    """Until two seconds are over, or the visitor has moved it."""
    shown.page.evaluate("performance.now = () => 0")
    publisher.box(["first"], RED)
    shown.until(lambda: row(shown, ["first"]).count() == 1, "the first node is shown")
    assert shown.page.evaluate(IN_VIEW)
    publisher.box(["second"], GREEN, x=40.0)
    shown.until(lambda: shown.page.evaluate(IN_VIEW) and row(shown, ["second"]).count() == 1, "both are in view")
    where = "scenegate.rig.camera.position.toArray()"
    if touched:
        shown.page.locator(".stage canvas").click()
    else:
        shown.page.evaluate("performance.now = () => 2001")
    before = shown.page.evaluate(where)
    publisher.box(["later"], GREEN, x=-90.0)
    shown.until(lambda: row(shown, ["later"]).count() == 1, "a later node is shown")
    assert shown.page.evaluate(where) == pytest.approx(before)


def test_home_view_fits_a_window_of_another_shape(shown: View, publisher: Publisher) -> None:
    publisher.box(["left"], RED, x=-20.0)
    publisher.box(["right"], GREEN, x=20.0)
    shown.until(lambda: row(shown, ["right"]).count() == 1, "two nodes far apart")
    shown.page.keyboard.press("h")
    shown.page.set_viewport_size({"width": 360, "height": 740})
    shown.until(lambda: shown.page.evaluate(IN_VIEW + " && scenegate.rig.camera.aspect < 1"), "both are in view")
    shown.page.locator(".stage canvas").click(position={"x": 5, "y": 5})
    before = shown.page.evaluate("scenegate.rig.camera.position.toArray()")
    shown.page.set_viewport_size({"width": 740, "height": 360})
    shown.until(lambda: shown.page.evaluate("scenegate.rig.camera.aspect > 1"), "the phone is turned")
    assert shown.page.evaluate("scenegate.rig.camera.position.toArray()") == pytest.approx(before)


def test_code_of_the_empty_scene_is_copied(shown: View) -> None:
    shown.page.get_by_role("tab", name="Python").focus()
    shown.page.keyboard.press("ArrowRight")
    assert shown.page.get_by_role("tab", name="A file").evaluate("tab => tab === document.activeElement")
    code = shown.page.get_by_role("tabpanel", name="Code").locator("code").inner_text()
    assert code.startswith("scenegate publish ")
    # As on a page that is neither from this host nor over HTTPS, where browsers have no clipboard.
    shown.page.evaluate("Object.defineProperty(navigator, 'clipboard', { value: undefined })")
    shown.page.get_by_role("button", name="Copy").click()
    shown.page.get_by_role("button", name="Selected").wait_for()
    assert shown.page.evaluate("getSelection().toString()").strip() == code.strip()


def test_click_selects_the_node_under_the_pointer(shown: View, publisher: Publisher) -> None:
    publisher.box(["pick", "left"], RED, x=-1.0)
    publisher.box(["pick", "right"], GREEN, x=1.0)
    shown.look_at("pick", "right")
    shown.until(lambda: min(shown.share("red"), shown.share("green")) > 0.02, "two boxes")
    box = shown.page.locator(".stage canvas").bounding_box()
    pixels = shown.colors().astype(int)
    rows, columns = np.nonzero(pixels[:, :, 1] > pixels[:, :, 0] + 90)
    shown.page.mouse.click(box["x"] + float(columns.mean()), box["y"] + float(rows.mean()))
    heading = shown.page.locator(".details h2")
    shown.until(lambda: heading.inner_text() == "pick / right", "the green box is selected")
    assert row(shown, ["pick", "right"]).get_attribute("aria-selected") == "true"


def test_search_finds_paths(shown: View, publisher: Publisher) -> None:
    for path in (["demo", "robot", "arm"], ["demo", "table"], ["robot"]):
        publisher.box(path, RED)
    shown.until(lambda: row(shown, ["demo", "table"]).count() == 1, "the tree")
    search = shown.page.get_by_label("Search paths")
    found = shown.page.locator(".tree .row .name")
    for text, names in (
        ("demo/robot", ["scene", "demo", "robot", "arm"]),
        ("Demo / Rob", ["scene", "demo", "robot", "arm"]),
        ("/robot", ["scene", "demo", "robot", "arm", "robot"]),
        ("table", ["scene", "demo", "table"]),
        ("demo/arm", []),
        ("", ["scene", "demo", "robot", "table", "robot"]),
    ):
        search.fill(text)
        shown.until(lambda names=names: found.all_inner_texts() == names, text)
        assert shown.page.get_by_text(f"No path contains “{text}”.").is_visible() == (not names)


def test_tree_is_used_by_keyboard_and_screen_reader(shown: View, publisher: Publisher) -> None:
    for path in (["demo", "robot", "arm"], ["demo", "table"], ["last"]):
        publisher.box(path, RED)
    shown.until(lambda: row(shown, ["last"]).count() == 1, "the tree")
    page = shown.page
    row(shown, []).click()
    selected = page.locator(".row[aria-selected=true] .name")
    page.get_by_role("tree").focus()
    for key, name in (
        ("ArrowRight", "demo"),
        ("ArrowRight", "robot"),
        ("ArrowRight", "robot"),  # opens
        ("ArrowRight", "arm"),
        ("ArrowRight", "arm"),
        ("ArrowLeft", "robot"),
        ("ArrowLeft", "robot"),  # closes
        ("ArrowLeft", "demo"),
    ):
        page.keyboard.press(key)
        assert selected.all_inner_texts() == [name], key
    for keys, name in (("t", "table"), ("l", "last"), ("ro", "robot"), ("d", "demo")):
        page.keyboard.type(keys)
        assert selected.all_inner_texts() == [name], keys
        page.wait_for_timeout(800)  # short: a slow page is only tested less
    assert row(shown, ["demo", "table"]).locator(".name").get_attribute("title") == "demo / table"
    table = row(shown, ["demo", "table"])
    assert [table.get_attribute(f"aria-{name}") for name in ("level", "posinset", "setsize")] == ["3", "2", "2"]
    eye = table.locator(".eye")
    assert (eye.get_attribute("aria-label"), eye.get_attribute("aria-pressed")) == ("Hide table", None)
    page.emulate_media(forced_colors="active")
    outline = "row => getComputedStyle(row).outlineStyle"
    assert row(shown, ["demo"]).evaluate(outline) == "solid"
    assert table.evaluate(outline) == "none"
    row(shown, ["last"]).click()
    page.keyboard.press("m")  # after a click, keys are those of the view
    assert page.get_by_role("group", name="Measurement").is_visible()
    page.keyboard.press("m")
    page.keyboard.press("ArrowUp")
    page.keyboard.press("l")  # after an arrow key, they find names again
    assert selected.all_inner_texts() == ["last"]


def test_selection_survives_delete_and_publish(shown: View, publisher: Publisher) -> None:
    publisher.box(["robot", "arm"], RED)
    shown.wait_for_node("robot", "arm")
    row(shown, ["robot", "arm"]).click()
    heading = shown.page.locator(".details h2")
    assert heading.inner_text() == "robot / arm"
    shown.page.get_by_role("tab", name="Stereo").click()
    publisher.send(delete=[{"path": ["robot"]}])
    shown.until(lambda: row(shown, ["robot"]).count() == 0, "the robot is deleted")
    publisher.box(["robot", "arm"], GREEN)
    selected = shown.page.locator(".row[aria-selected=true] .name")
    shown.until(lambda: selected.all_inner_texts() == ["arm"], "it is selected again")
    assert shown.page.get_by_role("tab", name="Stereo").get_attribute("aria-selected") == "true", "the tab stays"
    shown.page.get_by_role("tab", name="Selection").click()
    assert heading.inner_text() == "robot / arm"
    publisher.send(delete=[{"path": ["robot"]}])
    shown.page.get_by_text("robot / arm is not in the scene any more").wait_for()
    shown.page.keyboard.press("Escape")
    publisher.box(["robot", "arm"], RED)
    shown.wait_for_node("robot", "arm")
    shown.page.get_by_text("Nothing is selected").wait_for()
    assert selected.count() == 0


def test_values_of_the_selection_can_be_copied(shown: View, publisher: Publisher) -> None:
    """A selected text stays while the node moves; equal values are not replaced."""
    publisher.box(["moving"], RED)
    shown.wait_for_node("moving")
    row(shown, ["moving"]).click()
    value = shown.page.locator(".details dd").first
    assert value.inner_text() == "0  0  0"
    shown.page.evaluate("window.first = document.querySelector('.details dd')")
    shown.page.wait_for_timeout(1500)  # short: the details are drawn each second; a slow page is only tested less
    assert shown.page.evaluate("first.isConnected")
    shown.page.evaluate("getSelection().selectAllChildren(first)")
    publisher.send(settransform=[publisher.at(["moving"], 1.5)])
    shown.page.wait_for_timeout(2500)  # short: likewise
    assert shown.page.evaluate("getSelection().toString()").strip() == "0  0  0"
    shown.page.evaluate("getSelection().removeAllRanges()")
    shown.until(lambda: value.inner_text() == "1.5  0  0", "the new position")


def test_disparity_thumbnail_changes(shown: View, publisher: Publisher) -> None:
    shown.open_stereo_panel()
    thumb = shown.page.locator("[data-image=disparity] img")
    reading = "image => image.complete && image.naturalWidth > 0 ? image.src : ''"
    shown.until(lambda: thumb.evaluate(reading) != "", "a thumbnail")

    def image() -> bytes:
        with clients.Client() as http:
            response = http.get(thumb.evaluate("image => image.src"))
        assert response.status_code == 200
        return response.content

    # The first image may still be of what an earlier test had published.
    shown.until(lambda: np.asarray(Image.open(io.BytesIO(image()))).max() < 24, "nothing to be measured")
    publisher.box(["seen"], RED, size=1.2)
    shown.until(lambda: np.asarray(Image.open(io.BytesIO(image()))).max() > 150, "colours where the box is")
    thumb.click()
    shown.page.locator("dialog img").wait_for(state="visible")
    shown.page.keyboard.press("Escape")


def test_controls_set_the_device_parameters(shown: View, url: str) -> None:
    shown.open_stereo_panel()
    shown.page.get_by_text("Stereo matching", exact=True).click()
    shown.page.get_by_label("quality", exact=True).select_option("Low")
    with clients.Client(base_url=url) as http:
        path = "/api/v2/pipelines/0/nodes/rc_stereomatching/parameters/quality"
        shown.until(lambda: http.get(path).json()["value"] == "Low", "the parameter is set")
        assert http.put(path, json={"value": "High"}).status_code == 200
        path = "/api/v2/pipelines/0/nodes/rc_camera/parameters/exp_max"
        before = http.get(path).json()
        shown.page.get_by_text("Camera", exact=True).click()
        slider = shown.page.get_by_role("slider", name="exp_max", exact=True)
        slider.focus()
        shown.page.keyboard.press("Home")
        shown.until(lambda: http.get(path).json()["value"] == pytest.approx(before["min"]), "the lowest exposure")
        number = shown.page.get_by_role("spinbutton", name="exp_max, value")
        number.fill("0.006")
        number.press("Enter")
        shown.until(lambda: http.get(path).json()["value"] == 0.006, "the number")
        logarithm = math.log(0.006 / before["min"])
        shown.until(lambda: float(slider.input_value()) == pytest.approx(logarithm, abs=1e-3), "the slider follows")
        assert http.put(path, json={"value": before["value"]}).status_code == 200


def test_the_stereo_camera_is_placed_at_the_view(shown: View, publisher: Publisher, url: str) -> None:
    publisher.box(["seen"], RED)
    shown.look_at("seen")
    shown.open_stereo_panel()
    page = shown.page
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    shown.until(lambda: page.evaluate("scenegate.frustum.hasPose"), "the stereo camera")
    place = "([eye, target]) => scenegate.rig.place({ eye, target, up: [0, 0, 1] })"
    forward = "scenegate.frustum.object.matrix.elements.slice(8, 11)"
    where = "scenegate.frustum.object.matrix.elements.slice(12, 15)"
    with clients.Client(base_url=url) as http:
        before = http.get("/cameras/0/pose").json()["pose"]
        for eye, by_key in (([3.0, 0.0, 1.0], True), ([0.0, -4.0, 0.0], False)):
            page.evaluate(place, [eye, [0.0, 0.0, eye[2]]])
            if by_key:
                page.keyboard.press("v")
            else:
                page.get_by_role("button", name="Place at this view").click()
            shown.until(lambda: np.allclose(page.evaluate(where), eye), "the frustum at the view")  # noqa: B023 - used at once
            np.testing.assert_allclose(page.evaluate(forward), [-eye[0] / 3, -eye[1] / 4, 0], atol=1e-6)
        text = "eye=0,-4,0;target=0,-3,0;up=0,0,1"
        assert http.get("/cameras/stereo/pose").json() == {"pose": text}
        shown.until(lambda: text in page.locator(".stereo-pose code").inner_text(), "the images from there")
        page.get_by_role("button", name="Copy").click()
        shown.until(lambda: page.evaluate("navigator.clipboard.readText()") == f"--stereo-pose '{text}'", "the copy")
        assert http.put("/cameras/0/pose", params={"pose": before}).status_code == 200


def test_render_requests_are_listed(shown: View, url: str) -> None:
    shown.open_stereo_panel()
    assert shown.page.get_by_role("tab", name="Renders").count() == 0
    with clients.Client(base_url=url, headers={"content-type": CONTENT_TYPE}) as http:
        assert http.post("/render", content=body(gltf())).status_code == 200
        assert http.post("/render", content=body(gltf(), drake_fields("depth"))).status_code == 200
        assert http.post("/render", content=body(gltf(), drake_fields(width="none"))).status_code == 400
    shown.page.get_by_role("tab", name="Renders").click()
    items = shown.page.locator(".renders li")
    shown.until(lambda: items.count() == 3, "three requests")
    assert items.nth(0).locator(".none").inner_text() == "400"
    assert "width" in items.nth(0).locator(".problem").inner_text()
    assert "depth, 64 × 48" in items.nth(1).inner_text()
    images = shown.page.locator(".renders img")
    loaded = "images => images.length == 2 && images.every(image => image.complete && image.naturalWidth > 0)"
    shown.until(lambda: images.evaluate_all(loaded), "the images")


def test_the_light_of_the_view_is_that_of_its_render(shown: View, publisher: Publisher) -> None:
    page = shown.page
    publisher.box(["lit"], RED)
    shown.look_at("lit")

    def parameters() -> dict[str, list[str]]:
        with page.expect_request(lambda request: "scene/render" in request.url) as request:
            page.get_by_text("Render", exact=True).click()
        query = parse_qs(urlsplit(request.value.url).query)
        return {name: values for name, values in query.items() if name.startswith("light_")}

    shown.until(lambda: shown.share("red") > 0.02, "a red box")
    assert parameters() == {}
    shown.open_display_menu()
    page.get_by_label("Key strength").fill("0")
    page.get_by_role("slider", name="Ambient").fill("0.1")
    page.keyboard.press("Escape")
    shown.until(lambda: shown.share("red") == 0.0, "a dark box")
    assert parameters() == {"light_strength": ["0"], "light_ambient": ["0.1"]}
    shown.until(lambda: "&light_strength=0&light_ambient=0.1" in page.url, "the light is in the address")
    page.reload()
    shown.wait_for_node("lit")
    assert parameters() == {"light_strength": ["0"], "light_ambient": ["0.1"]}
    shown.until(lambda: shown.share("red") == 0.0, "a dark box again")
    shown.open_display_menu()
    page.get_by_role("button", name="Reset the light").click()
    page.keyboard.press("Escape")
    shown.until(lambda: shown.share("red") > 0.02, "a red box again")
    assert parameters() == {}
    shown.until(lambda: "light_" not in page.url, "the address has no light")


def test_background_choices(shown: View, publisher: Publisher) -> None:
    publisher.box(["ground"], RED)
    shown.look_at("ground")
    shown.open_display_menu()
    choice = shown.page.get_by_label("Background")
    for name, color in (("white", (255, 255, 255)), ("black", (0, 0, 0)), ("sky", (204, 229, 255))):
        choice.select_option(name)
        shown.until(lambda color=color: tuple(shown.colors()[5, 5]) == color, name)
    shown.page.get_by_label("Dark theme").check()
    assert tuple(shown.colors()[5, 5]) == (204, 229, 255), "what was chosen stays"
    choice.select_option("theme")
    shown.until(lambda: shown.colors()[5, 5].max() < 64, "the dark theme's own")


def test_downloads_show_what_the_page_shows(shown: View, publisher: Publisher) -> None:
    """The images have the page's hidden nodes, projection and background; the file has no hidden nodes."""
    publisher.box(["take"], RED, x=-1.0)
    publisher.box(["leave", "it"], GREEN, x=1.0)
    shown.look_at("leave", "it")
    shown.until(lambda: min(shown.share("red", "left"), shown.share("green", "right")) > 0.02, "two boxes")
    row(shown, ["leave"]).locator(".eye").click()
    shown.open_display_menu()
    shown.page.get_by_label("Orthographic").check()
    shown.page.get_by_label("Background").select_option("white")
    shown.page.keyboard.press("Escape")
    shown.until(lambda: shown.share("green") == 0.0, "one is hidden")
    with shown.page.expect_download() as image:
        shown.page.get_by_role("button", name="PNG").click()
    assert image.value.suggested_filename == "scenegate.png"
    drawn = np.asarray(Image.open(image.value.path()).convert("RGB"))
    np.testing.assert_array_equal(drawn, shown.colors())
    assert tuple(drawn[5, 5]) == (255, 255, 255)
    with shown.page.expect_download() as image:
        shown.page.get_by_role("link", name="Render").click()
    assert image.value.suggested_filename == "scenegate-render.png"
    rendered = np.asarray(Image.open(image.value.path()).convert("RGB"))
    assert rendered.shape == drawn.shape
    different = np.abs(rendered.astype(int) - drawn.astype(int)).max(axis=2) > 60
    assert different.mean() < 0.005, "the gateway's image is the same view"
    with (
        shown.page.expect_response(lambda each: "scene.glb" in each.url) as response,
        shown.page.expect_download() as scene,
    ):
        shown.page.get_by_role("link", name=".glb").click()
    assert scene.value.suggested_filename == "scene.glb"
    assert "xmag=" in unquote(response.value.url)
    read = read_gltf(Path(scene.value.path()).read_bytes())
    assert len([path for path, node in read.root.walk() if node.parts]) == 1, "it has the visible box"


def test_a_failed_download_shows_the_reason(shown: View) -> None:
    shown.page.route("**/scene.glb**", lambda route: route.fulfill(status=404, json={"detail": "no such moment"}))
    shown.page.get_by_role("link", name=".glb").click()
    shown.page.get_by_text("scene.glb: no such moment").wait_for()
    shown.faults = [fault for fault in shown.faults if "404" not in fault]


def test_shortcuts_work_after_a_slider_and_are_listed(shown: View, publisher: Publisher) -> None:
    publisher.box(["keys"], RED)
    shown.look_at("keys")
    shown.page.get_by_role("treeitem", name="keys").click()
    slider = shown.page.locator(".details input[type=range]").first
    slider.focus()
    shown.page.keyboard.press("ArrowLeft")
    shown.page.keyboard.press("?")
    shown.until(lambda: shown.page.locator("#keys").is_visible(), "the list of keys")
    shown.page.keyboard.press("Escape")
    slider.focus()
    shown.page.keyboard.press("Escape")
    shown.until(lambda: shown.page.locator(".details h2").count() == 0, "deselected")


def test_keyboard_shortcuts_and_focus(shown: View, publisher: Publisher) -> None:
    publisher.box(["keys", "small"], RED, x=-1.0, size=0.5)
    publisher.box(["keys", "other"], GREEN, x=1.0)
    shown.look_at("keys", "other")
    keyboard = shown.page.keyboard

    def camera() -> list[float]:
        return list(shown.page.evaluate("[...scenegate.rig.camera.position, ...scenegate.rig.controls.target]"))

    def moved_by(key: str) -> list[float]:
        before = camera()
        keyboard.press(key)
        shown.until(lambda: camera() != before, key)
        return camera()

    assert moved_by("h")[0] > 1.0, "from the front right"
    home = camera()

    def distance() -> float:
        return float(shown.page.evaluate("scenegate.rig.controls.getDistance()"))

    before = distance()
    moved_by("+")
    assert distance() == pytest.approx(0.8 * before)
    moved_by("-")
    assert camera() == pytest.approx(home)
    moved_by("1")
    keyboard.press("CapsLock")
    assert moved_by("H") == pytest.approx(home), "letters are shortcuts with Caps Lock, too"
    keyboard.press("CapsLock")
    shown.open_display_menu()
    shown.page.get_by_label("Single-key shortcuts").uncheck()
    keyboard.press("Escape")
    shown.page.evaluate("document.activeElement.blur()")
    keyboard.press("1")
    assert camera() == pytest.approx(home), "shortcuts are off"
    shown.page.locator(".stage canvas").focus()
    moved_by("3")
    shown.open_display_menu()
    shown.page.get_by_label("Single-key shortcuts").check()
    keyboard.press("Escape")
    shown.page.evaluate("document.activeElement.blur()")
    assert moved_by("1")[2] > 4.0 * abs(camera()[1]), "from above"
    moved_by("2")
    shown.page.evaluate("scenegate.select(scenegate.model.find(['keys', 'small']))")
    assert moved_by("f")[3:] == pytest.approx([-1.0, 0.0, 0.0], abs=1e-3), "the selection is framed"
    shown.page.locator(".stage canvas").focus()
    for key in ("ArrowLeft", "ArrowUp", "Control+ArrowRight"):
        moved_by(key)
    keyboard.press("Escape")
    shown.until(lambda: shown.page.evaluate("scenegate.stage.highlight.visible") is False, "nothing is selected")
    shown.page.evaluate("document.activeElement.blur()")
    reached = set()
    for _ in range(24):
        keyboard.press("Tab")
        element = "e => [e.ariaLabel, e.textContent, e.title].find(text => text?.trim()) ?? ''"
        reached.add(shown.page.evaluate(f"({element})(document.activeElement)").strip())
    assert {"Top, from +Z", "Right side, from −Y", "Display", "PNG", "Render", ".glb"} <= reached
    shown.open_display_menu()
    reached = set()
    for _ in range(16):
        keyboard.press("Tab")
        element = "e => e.ariaLabel ?? e.parentElement.textContent"
        reached.add(shown.page.evaluate(f"({element})(document.activeElement)"))
    assert {"Grid on the ground", "Wireframe", "Shadows", "Point size", "Background", "Dark theme"} <= reached
    keyboard.press("Escape")
    shown.page.locator("#display").wait_for(state="hidden")


def test_wheel_zooms_to_the_cursor(shown: View, publisher: Publisher) -> None:
    """The point under the cursor stays there; the camera does not reach it, and flies on over nothing."""
    publisher.box(["near"], RED, x=-1.0)
    publisher.box(["marker"], GREEN, x=1.0, size=0.01)
    shown.look_at("marker")
    point_at = "([x, y]) => scenegate.stage.pick(x, y)?.point.toArray() ?? null"
    scroll = """([clientX, clientY, times]) => {
      const { stage: { canvas }, rig: { camera } } = scenegate;
      const wheel = { clientX, clientY, deltaY: -100 };
      for (let i = 0; i < times; i += 1) canvas.dispatchEvent(new WheelEvent("wheel", wheel));
      return camera.position.y;
    }"""
    box = shown.page.locator(".stage canvas").bounding_box()
    x, y = box["x"] + int(0.25 * box["width"]), box["y"] + int(0.4 * box["height"])
    point = shown.page.evaluate(point_at, [x, y])
    assert point[1] == pytest.approx(-0.5)
    before = shown.page.evaluate("scenegate.rig.camera.position.y")
    assert before + 1.0 < shown.page.evaluate(scroll, [x, y, 10]) < -0.5
    assert -0.53 < shown.page.evaluate(scroll, [x, y, 100]) < -0.5
    assert shown.page.evaluate(point_at, [x, y]) == pytest.approx(point, abs=1e-3)
    shown.look()
    assert shown.page.evaluate(scroll, [box["x"] + box["width"] / 2, y, 150]) > 0.5, "past the boxes"


def test_small_screen_shows_one_drawer_at_a_time(shown: View, publisher: Publisher) -> None:
    publisher.box(["phone"], RED)
    shown.page.set_viewport_size({"width": 360, "height": 740})
    shown.until(lambda: shown.page.evaluate("innerWidth") == 360, "a small screen")
    search, tabs = shown.page.get_by_label("Search paths"), shown.page.get_by_role("tab", name="Stereo")
    for name, open_one, closed_one in (("Scene tree", search, tabs), ("Selection, stereo", tabs, search)):
        shown.page.get_by_role("button", name=name).click()
        open_one.wait_for(state="visible")
        closed_one.wait_for(state="hidden")
        assert shown.page.evaluate("document.documentElement.scrollWidth") == 360, "nothing is wider than the screen"
    shown.page.keyboard.press("Escape")
    tabs.wait_for(state="hidden")


@pytest.mark.parametrize("glass", [False, True])
def test_large_cloud_is_drawn_in_steps_until_it_is_complete(shown: View, publisher: Publisher, glass: bool) -> None:
    """Three chunks; what is drawn before them stays, also in the image in which translucent surfaces are blended."""
    publisher.box(["beside"], GREEN, x=1.3, size=0.8)
    if glass:
        publisher.box(["glass"], [0.0, 0.0, 1.0, 0.1], x=9.0, size=0.1)
    count = 3 * 65_536
    x, z = np.random.default_rng(1).uniform(-1, 0, (2, count))
    points = np.stack((x, np.zeros(count), z + 0.5), axis=1).round(4).tolist()
    publisher.send(
        setgeometry=[{"path": ["cloud"], "geometry": {"type": "pointcloud", "points": points, "color": RED}}]
    )
    shown.look_at("cloud")
    chunks = "scenegate.drawing.root.children.filter((o) => o.isPoints).map((o) => 1 + o.children.length)"
    assert shown.page.evaluate(chunks) == [3]
    shown.until(lambda: shown.page.evaluate("scenegate.stage.clouds.isComplete"), "all chunks are drawn")
    assert shown.share("red", "left") > 0.1
    assert shown.share("green", "right") > 0.05


def test_panels_are_resized_and_keep_their_width(shown: View, publisher: Publisher) -> None:
    """The home view beside them stays framed."""
    publisher.box(["left"], RED, x=-5.0)
    publisher.box(["wide"], RED, x=5.0)
    shown.wait_for_node("wide")
    tree = shown.page.locator(".drawer.left")
    handle = shown.page.get_by_role("separator", name="Width of the scene tree")
    before = tree.bounding_box()["width"]
    shown.page.keyboard.press("h")
    shown.until(lambda: shown.page.evaluate(STILL), "the camera stands still")
    eye_x = "scenegate.rig.view.eye[0]"
    framed = shown.page.evaluate(eye_x)
    shown.drag(handle.bounding_box()["x"] + 2, 300, 500, 300)
    assert tree.bounding_box()["width"] == pytest.approx(500, abs=2)
    shown.until(lambda: shown.page.evaluate(eye_x) > framed + 0.1, "the home view is framed again, from farther away")
    handle.focus()
    shown.page.keyboard.press("ArrowLeft")
    assert tree.bounding_box()["width"] == pytest.approx(484, abs=2)
    shown.page.reload()
    shown.wait_for_node("wide")
    assert tree.bounding_box()["width"] == pytest.approx(484, abs=2)
    handle.dblclick()
    assert tree.bounding_box()["width"] == before


@needs_axe
def test_accessibility_rules_of_axe(shown: View, publisher: Publisher) -> None:
    page, check = shown.page, shown.check_accessibility
    page.get_by_text("The scene is empty").wait_for()
    check("the empty scene")
    publisher.box(["robot", "arm"], RED)
    shown.wait_for_node("robot", "arm")
    row(shown, ["robot", "arm"]).click()
    for tab in ("Selection", "Stereo"):
        page.get_by_role("tab", name=tab).click()
        page.get_by_role("tabpanel", name=tab).wait_for()
        check(tab)
    page.locator(".status summary").click()
    check("the interfaces")
    shown.open_display_menu()
    check("the display menu")
    page.get_by_label("From above", exact=True).check()
    page.get_by_label("Image of").select_option("stereo")
    page.keyboard.press("Escape")
    page.get_by_role("tab", name="Selection").click()
    page.get_by_label("Name", exact=True).check()
    page.keyboard.press("c")
    page.keyboard.press("m")
    page.get_by_role("group", name="Measurement").wait_for()
    check("what is over and beside the view")


COVERED = """() => [...document.querySelectorAll(".bar button, .bar a")].filter((button) => {
  if (!button.checkVisibility({ visibilityProperty: true })) return false;
  const { left, top, width, height } = button.getBoundingClientRect();
  return [0.1, 0.5, 0.9].some((x) => !button.contains(document.elementFromPoint(left + x * width, top + height / 2)));
}).map((button) => button.title)"""
"""Titles of the buttons of the bar of which something else covers a part."""


def test_toolbar_and_status_bar_fit_a_phone(shown: View, publisher: Publisher) -> None:
    publisher.box(["phone"], RED)
    # 320 x 256: a screen of 1280 x 1024 with a zoom of 400 %.
    for width, height in ((320, 256), (360, 740)):
        shown.page.set_viewport_size({"width": width, "height": height})
        shown.until(lambda width=width: shown.page.evaluate("innerWidth") == width, "a small screen")
        for bar in (".bar", ".bar .tools", ".status"):
            assert shown.page.evaluate(
                "bar => { const e = document.querySelector(bar); return e.scrollWidth <= e.clientWidth; }", bar
            ), f"{bar} is wider than the screen"
        assert shown.page.evaluate(COVERED) == []
    shown.open_display_menu()
    menu = shown.page.locator("#display")
    box = menu.bounding_box()
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= 360
    shown.page.keyboard.press("Escape")
    shown.page.get_by_role("button", name="Top, from").click()
    shown.until(
        lambda: shown.page.evaluate("scenegate.rig.camera.position.z > 4 * Math.abs(scenegate.rig.camera.position.y)"),
        "from above",
    )


def test_home_view_fills_the_view_without_the_stereo_camera(shown: View, publisher: Publisher) -> None:
    publisher.box(["home"], RED)
    wait_in_page(shown.page, "scenegate.model.find(['home'])?.parts != null")
    shown.page.keyboard.press("h")
    extent = shown.page.evaluate(
        """() => {
          const { stage, drawing, model } = scenegate;
          const [{ min, max }] = drawing.boxes(model.root);
          const corners = [];
          for (const x of [min.x, max.x])
            for (const y of [min.y, max.y])
              for (const z of [min.z, max.z]) corners.push(min.clone().set(x, y, z));
          scenegate.rig.camera.updateMatrixWorld();
          const seen = corners.map((corner) => corner.project(scenegate.rig.camera));
          return Math.max(...seen.flatMap(({ x, y }) => [Math.abs(x), Math.abs(y)]));
        }"""
    )
    assert 0.8 < extent < 1.0
    assert not shown.page.evaluate("scenegate.frustum.object.visible")
    shown.open_stereo_panel()
    shown.until(lambda: shown.page.evaluate("scenegate.frustum.object.visible"), "the stereo camera")


def test_empty_scene_shows_how_to_publish(shown: View, publisher: Publisher) -> None:
    empty = shown.page.get_by_role("region", name="The scene is empty")
    empty.wait_for()
    shown.page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    hub = publisher.url
    for way, line in (("Python", "TreeViewer("), ("A file", "scenegate publish"), ("Drake", "DrakeLcm(")):
        empty.get_by_role("tab", name=way).click()
        shown.until(lambda line=line: line in empty.inner_text() and hub in empty.inner_text(), way)
        empty.get_by_role("button", name="Copy").click()
        empty.get_by_text("Copied").wait_for()
        assert line in shown.page.evaluate("navigator.clipboard.readText()")
    publisher.box(["something"], RED)
    empty.wait_for(state="hidden")


def test_shadows_and_occlusion_are_kept(shown: View, publisher: Publisher) -> None:
    """Both are drawn, also after the page is loaded again, and the URL overrides them."""
    publisher.box(["above"], RED, size=0.6)
    # Without a GPU, an image of the default size takes seconds with occlusion.
    shown.page.set_viewport_size({"width": 400, "height": 360})
    drawn = """(({ lights, rendering }) => [
      lights.object.children.some((lamp) => lamp.castShadow), rendering.hasOcclusion])(scenegate.stage)"""
    assert shown.page.evaluate(drawn) == [False, False]
    shown.open_display_menu()
    shown.page.get_by_label("Shadows").check()
    shown.page.get_by_label("Ambient occlusion").check()
    assert shown.page.evaluate(drawn) == [True, True]
    shown.page.reload()
    shown.look_at("above")
    shown.until(lambda: shown.share("red") > 0.01, "the box")
    assert shown.page.evaluate(drawn) == [True, True]
    address, _, camera = shown.page.url.partition("#")
    shown.page.goto(f"{address}&shadows=off&occlusion=off#{camera}")
    shown.look_at("above")
    assert shown.page.evaluate(drawn) == [False, False]


def test_camera_projection_and_grid_are_kept(shown: View, publisher: Publisher) -> None:
    """The camera of a tab, also after it is loaded again; the home view still follows the first nodes."""
    camera = """(({ origin, view }) => [...view.eye, ...view.target, view.halfHeight, origin.x])(scenegate.rig)"""
    orthographic = "scenegate.rig.camera.isOrthographicCamera"

    def reload() -> None:
        shown.page.reload()
        wait_in_page(shown.page, "window.scenegate?.model.revision > 0")

    reload()
    publisher.box(["far"], RED, x=30_000.0)
    shown.until(lambda: row(shown, ["far"]).count() == 1, "the box")
    shown.until(lambda: shown.page.evaluate(camera)[-1] == 30_000.0, "the first node is framed")
    shown.open_display_menu()
    shown.page.get_by_label("Orthographic").check()
    shown.page.get_by_label("Grid on the ground").uncheck()
    shown.page.keyboard.press("Escape")
    shown.page.mouse.move(600, 400)
    shown.page.mouse.wheel(0, -400)
    shown.until(lambda: shown.page.evaluate("scenegate.rig.orthographic.zoom") > 1.0, "the wheel zooms")
    shown.drag(600, 400, 700, 450)
    shown.until(lambda: shown.page.evaluate(STILL), "the camera stands still")
    before = shown.page.evaluate(camera)

    def eye() -> list[float]:
        return [float(x) for x in shown.page.url.partition("#eye=")[2].partition(";")[0].split(",") if x]

    shown.until(lambda: eye() == pytest.approx(before[:3]), "the camera is in the address")
    reload()
    shown.wait_for_node("far")
    assert shown.page.evaluate(camera) == pytest.approx(before)
    shown.page.evaluate("location.hash = 'eye=1,-5,2;target=1,0,2;up=0,0,1;fovy=45'")
    view_eye = "scenegate.rig.view.eye"
    shown.until(lambda: shown.page.evaluate(view_eye) == pytest.approx([1.0, -5.0, 2.0]), "a link is followed")
    shown.page.evaluate("location.hash = 'eye=1,-5;target=nowhere'")
    shown.page.keyboard.press("h")
    shown.until(lambda: "#" not in shown.page.url, "the home view has no camera in its address")
    assert shown.page.evaluate(orthographic)
    assert not shown.page.evaluate("scenegate.stage.grid.visible")
    shown.open_display_menu()
    assert shown.page.get_by_label("Orthographic").is_checked()
    assert not shown.page.get_by_label("Grid on the ground").is_checked()


def test_touch_rotates_and_zooms(shown: View, publisher: Publisher) -> None:
    publisher.box(["touch"], RED)
    shown.look_at("touch")
    box = shown.page.locator(".stage canvas").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    device = shown.page.context.new_cdp_session(shown.page)

    def touch(kind: str, *points: tuple[float, float]) -> None:
        fingers = [{"x": x + dx, "y": y + dy, "id": number} for number, (dx, dy) in enumerate(points)]
        device.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": fingers})

    def read(what: str) -> float:
        return float(shown.page.evaluate(f"scenegate.rig.controls.{what}()"))

    angle, distance = read("getAzimuthalAngle"), read("getDistance")
    touch("touchStart", (0, 0))
    for step in range(1, 6):
        touch("touchMove", (20.0 * step, 0))
    touch("touchEnd")
    shown.until(lambda: abs(read("getAzimuthalAngle") - angle) > 0.2, "one finger turns")
    assert read("getDistance") == pytest.approx(distance)
    touch("touchStart", (-20, 0), (20, 0))
    for step in range(1, 6):
        touch("touchMove", (-20.0 - 20 * step, 0), (20.0 + 20 * step, 0))
    touch("touchEnd")
    shown.until(lambda: read("getDistance") < 0.6 * distance, "two fingers apart come closer")


def test_page_reconnects_after_a_restart(browser: Any) -> None:
    with ExitStack() as stack:
        process, url = stack.enter_context(gateway_process(*FLAGS))
        port = url.rsplit(":", 1)[1]
        Publisher(url).box(["again"], RED)
        shown = stack.enter_context(View(browser, url))
        shown.look_at("again")
        shown.until(lambda: shown.share("red") > 0.02, "a red box")
        shown.expect_outage = True
        assert process.stop() == 0
        shown.until(lambda: "reconnecting" in shown.page.locator(".status").inner_text(), "the page notices")
        outage = shown.page.get_by_text("this is the scene as it was")
        outage.wait_for()
        shown.page.get_by_role("button", name="PNG").click()
        shown.page.wait_for_timeout(500)  # short: a slow page is only tested less
        assert outage.is_visible()
        second, _ = stack.enter_context(gateway_process("--port", port, *FLAGS))
        publisher = Publisher(url)
        publisher.box(["other"], GREEN, x=0.5)
        shown.until(lambda: shown.share("green") > 0.02 and shown.share("red") == 0.0, "the new gateway's scene")
        assert second.stop() == 0


def test_gateway_without_stereo_camera_is_not_an_error(browser: Any) -> None:
    """Tabs are there for what is used; wheel, orbit and pan with the mouse move the camera."""
    with ExitStack() as stack:
        flags = ("--lcm-url", "off", "--tcpq-port", "0")
        _, url = stack.enter_context(gateway_process("--only", "scene,view,treeviewer", *flags))
        Publisher(url).box(["box"], RED)
        view = stack.enter_context(View(browser, url, width=900, height=460))
        view.wait_for_node("box")
        view.page.get_by_role("button", name="Selection, stereo").click()
        view.page.get_by_text("Nothing is selected").wait_for()
        view.page.get_by_text("interfaces ready").wait_for()
        assert view.page.locator("aside [role=tab]").all_inner_texts() == ["Selection"]

        where = "[...scenegate.rig.camera.position.toArray(), ...scenegate.rig.controls.target.toArray()]"

        def moves(what: str) -> None:
            view.until(lambda: view.page.evaluate(where) != before, what)

        box = view.page.locator(".stage .view canvas").bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        view.page.mouse.move(x, y)
        view.until(lambda: view.page.evaluate(STILL), "the camera stands still")
        before = view.page.evaluate(where)
        view.page.mouse.wheel(0, -400)
        moves("wheel")
        for button in ("left", "right"):
            view.until(lambda: view.page.evaluate(STILL), "the camera stands still")
            before = view.page.evaluate(where)
            view.page.mouse.down(button=button)
            view.page.mouse.move(x + 50, y + 30, steps=4)
            view.page.mouse.up(button=button)
            moves(f"{button} drag")
            view.page.mouse.move(x, y)


def test_panels_wait_for_the_first_response(browser: Any, url: str) -> None:
    """No panel shows an empty state before the gateway responds, or after it stops responding."""
    Publisher(url).send(delete=[{"path": []}])
    page = new_page(browser)
    held: list[Any] = []
    response: list[Callable[[Any], None]] = [lambda route: held.append(route)]
    page.route("**/view/sensor", lambda route: response[0](route))
    sockets: list[Any] = []
    page.route_web_socket("**/view/ws", lambda socket: sockets.append(socket))
    page.goto(f"{url}/view")
    page.get_by_text("Waiting for the scene …").wait_for()
    page.get_by_role("button", name="Selection, stereo").click()
    page.get_by_role("tab", name="Selection").wait_for()
    assert page.get_by_role("tab", name="Stereo").count() == 0, "not known yet"
    sockets.pop().connect_to_server()
    page.get_by_text("The scene is empty").wait_for()
    page.get_by_text("Waiting for the gateway …").wait_for()
    wait_until(lambda: held, PAGE_SECONDS)
    response[0] = lambda route: route.continue_()
    held.pop().continue_()
    page.locator("[data-image=left] img").wait_for()
    response[0] = lambda route: route.abort()
    page.get_by_text("these are its last images").wait_for()
    page.close()


def test_page_is_sent_compressed_and_may_only_use_its_gateway(shown: View) -> None:
    sizes = shown.page.evaluate(
        """performance.getEntriesByType("resource")
          .filter(({ name }) => name.includes("/view/assets/"))
          .map(({ encodedBodySize, decodedBodySize }) => [encodedBodySize, decodedBodySize])"""
    )
    assert len(sizes) == 2
    for encoded, decoded in sizes:
        assert 0 < encoded < 0.4 * decoded
    fetched = "fetch('https://example.org').then(() => '', (error) => error.name)"
    assert shown.page.evaluate(fetched) == "TypeError"
    assert any("Content Security Policy" in fault for fault in shown.faults)
    shown.faults.clear()


def test_without_webgl_the_page_shows_images_of_the_gateway(browser: Any, url: str) -> None:
    publisher = Publisher(url)
    publisher.send(delete=[{"path": []}])
    publisher.box(["seen"], RED)
    publisher.box(["hidden"], GREEN, size=1.5)
    page = new_page(browser)
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
    page.goto(f"{url}/view")
    page.get_by_text("This browser has no WebGL 2.").wait_for()
    shown = page.locator(".stage img")

    def share(channel: int, other: int) -> float:
        pixels = np.asarray(Image.open(io.BytesIO(shown.screenshot())).convert("RGB")).astype(int)
        pixels = pixels[110:]  # below the axes
        return float((pixels[:, :, channel] > pixels[:, :, other] + 60).mean())

    wait_until(lambda: share(1, 0) > 0.05, PAGE_SECONDS)
    page.locator(".row", has_text="hidden").locator(".eye").click()
    wait_until(lambda: share(0, 1) > 0.02 and share(1, 0) == 0.0, PAGE_SECONDS)
    page.keyboard.press("h")
    camera = "new URL(document.querySelector('.stage img').src).searchParams.get('camera')"
    before = page.evaluate(camera)
    page.get_by_role("button", name="Top, from").click()
    wait_until(lambda: page.evaluate(camera) != before, PAGE_SECONDS)
    box = shown.bounding_box()
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    selected = page.locator(".details h2", has_text="seen")
    wait_until(lambda: page.mouse.click(*middle) or selected.count() == 1, PAGE_SECONDS)  # one may be missed
    publisher.send(delete=[{"path": ["seen"]}])
    wait_until(lambda: share(0, 1) == 0.0, PAGE_SECONDS)
    page.close()
    assert faults == []


def test_view_returns_after_a_lost_context(shown: View, publisher: Publisher) -> None:
    publisher.box(["box"], RED)
    shown.look_at("box")
    shown.until(lambda: shown.share("red") > 0.02, "a red box")
    lose = "window.lost = scenegate.stage.renderer.getContext().getExtension('WEBGL_lose_context')"
    shown.page.evaluate(f"({lose}).loseContext()")
    message = shown.page.get_by_text("The browser has lost its graphics device.")
    message.wait_for()
    shown.page.evaluate("lost.restoreContext()")
    message.wait_for(state="hidden")
    shown.until(lambda: shown.share("red") > 0.02, "the red box is back")


def test_failed_texture_download_is_repeated(browser: Any, url: str, publisher: Publisher) -> None:
    publisher.send(setgeometry=[{"path": ["it"], "geometry": {**TEXTURED, "image": png([[[255, 0, 0], [0, 0, 0]]])}}])
    page = new_page(browser)
    requested: list[str] = []

    def refuse_once(route: Any) -> None:
        known = route.request.url in requested
        requested.append(route.request.url)
        route.continue_() if known else route.abort()

    page.route("**/view/image/*", refuse_once)
    page.goto(f"{url}/view")
    came = "e => e.name.includes('/view/image/') && e.responseStatus === 200"
    wait_in_page(page, f"performance.getEntriesByType('resource').some({came})")
    page.close()
