"""The page with a scene in one file, opened from a disk without a network, beside the live page."""

import html
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.adapters.viewer.browser.page import FLAGS, Publisher, View
from tests.adapters.viewer.browser.test_browser import GREEN, RED, UPRIGHT, png
from tests.adapters.viewer.browser.test_browser import TEXTURED as UNTEXTURED
from tests.adapters.viewer.recordings import frames_of
from tests.replay.test_page_file import recording_of
from tests.support import clients
from tests.support.browser import HEIGHT, PAGE_SECONDS, WIDTH, wait_in_page
from tests.support.gateway_process import gateway_process
from tests.support.view_frames import parse_frame

pytestmark = [pytest.mark.browser, pytest.mark.slow]

MAX_PAGE_BYTES = 2_000_000
CLOUD = {
    "type": "pointcloud",
    "points": [[x / 20 - 1, -0.4, z / 20 - 0.5] for x in range(40) for z in range(20)],
    "channels": {"rgb": [[0, 1, 0]] * 800, "height": [z / 20 for _ in range(40) for z in range(20)]},
    "point_size": 6,
}
TEXTURED = {**UNTEXTURED, "image": png([[[255, 0, 0], [0, 0, 255]]])}


class FileView(View):
    """A page of a file, in a browser without a network."""

    def __init__(self, browser: Any, file: Path, fragment: str = "") -> None:
        context = browser.new_context(viewport={"width": WIDTH, "height": HEIGHT}, offline=True)
        self.page = context.new_page()
        self.page.set_default_timeout(1000 * PAGE_SECONDS)
        self.faults = []
        self.expect_outage = False
        self.page.on("pageerror", lambda error: self.faults.append(f"exception: {error}"))
        self.page.on("console", self._console)
        self.page.on("request", self._request)
        self._file = file.as_uri()
        self.page.goto(f"{self._file}?theme=light{fragment}")
        wait_in_page(self.page, "window.scenegate !== undefined")

    def _request(self, request: Any) -> None:
        if not request.url.startswith(("data:", "blob:", self._file)):
            self.faults.append(f"request to {request.url}")


@pytest.fixture(scope="module")
def url(browser: Any) -> Iterator[str]:
    with gateway_process(*FLAGS, "--history-seconds", "0") as (_, url):  # no time bar, as in the file
        yield url


def download(url: str, folder: Path, query: str = "") -> Path:
    with clients.Client(base_url=url) as http:
        response = http.get(f"/view/scene.html{query}")
    assert response.status_code == 200
    file = folder / "a scene.html"
    file.write_bytes(response.content)
    return file


def test_a_file_shows_what_the_live_page_shows(browser: Any, url: str, tmp_path: Path) -> None:
    publisher = Publisher(url)
    publisher.send(
        setgeometry=[
            {"path": ["textured"], "geometry": TEXTURED},
            {"path": ["glass"], "geometry": {"type": "box", "lengths": [1, 0.2, 1], "color": [0, 1, 0, 0.4]}},
            {"path": ["text"], "geometry": {"type": "text", "text": "Hello", "size": 0.6, "color": RED}},
            {"path": ["cloud"], "geometry": CLOUD},
            {
                "path": ["</script><script>alert(1)</script>"],
                "geometry": {"type": "sphere", "radius": 0.2, "color": GREEN},
            },
        ],
        settransform=[
            {"path": ["textured"], "transform": {"translation": [-1.5, 0, 0], "quaternion": [1, 0, 0, 0]}},
            {"path": ["glass"], "transform": {"translation": [-1, -0.5, 0], "quaternion": [1, 0, 0, 0]}},
            {"path": ["text"], "transform": {"translation": [1.2, -0.5, 0.4], "quaternion": UPRIGHT["quaternion"]}},
            {"path": ["cloud"], "transform": {"translation": [1.4, 0, -0.5], "quaternion": [1, 0, 0, 0]}},
        ],
    )
    live = View(browser, url)
    live.look_at("cloud")
    file = download(url, tmp_path, "?seconds=0&view=%26light_strength%3D0.5")
    live.page.evaluate("location.hash = '&light_strength=0.5'")
    assert file.stat().st_size < MAX_PAGE_BYTES
    opened = FileView(browser, file)
    opened.look_at("cloud")
    opened.until(lambda: opened.share("red") > 0.02, "the texture")

    def differences() -> float:
        return float((np.abs(live.colors().astype(int) - opened.colors()).max(axis=2) > 24).mean())

    for each in (live, opened):
        wait_in_page(each.page, "scenegate.light.change.value.strength === 0.5")
    opened.until(lambda: differences() < 0.002, "the same image")
    assert live.share("red") > 0.02
    assert live.share("green") > 0.02
    _check_panels(opened)
    assert opened.page.get_by_text("alert(1)").count() >= 1  # a name in the tree
    assert opened.faults == []
    live.page.close()
    opened.page.close()


def _check_panels(opened: FileView) -> None:
    """Colour the cloud by a channel of the file, and look for what needs a gateway."""
    page = opened.page
    page.evaluate("() => scenegate.select(scenegate.model.find(['cloud']))")
    page.get_by_label("Colour by").wait_for()
    before = opened.colors().astype(int)
    page.get_by_label("Colour by").select_option("height")
    opened.until(lambda: (np.abs(opened.colors() - before).max(axis=2) > 60).mean() > 0.002, "colours by height")
    for name in ("Render", ".glb", ".html"):
        assert page.get_by_role("link", name=name, exact=True).count() == 0
    for name in ("Stereo", "Renders", "Controls"):
        assert page.get_by_role("tab", name=name).count() == 0
    opened.open_display_menu()
    assert page.get_by_label("Image of").count() == 0
    page.keyboard.press("Escape")
    with page.expect_download() as download_of:
        page.get_by_role("button", name="PNG").click()
    image = Image.open(io.BytesIO(Path(download_of.value.path()).read_bytes()))
    assert image.size == opened.colors().shape[1::-1]


def moved_box(browser: Any, folder: Path) -> Path:
    """Return a file with the history of a gateway: a box moves from x = -1 to 1."""
    with gateway_process(*FLAGS) as (_, url):
        publisher = Publisher(url)
        publisher.box(["box"], RED, x=-1.0, size=0.5)
        live = View(browser, url)
        live.look_at("box")
        for number in range(1, 21):
            publisher.send(settransform=[publisher.at(["box"], -1.0 + 0.1 * number)])
            live.page.wait_for_timeout(50)  # short: the motion
        live.until(lambda: live.share("red", "right") > 0.02, "the box on the right")
        live.page.close()
        return download(url, folder)


def test_the_time_bar_of_a_file_moves_the_scene(browser: Any, tmp_path: Path) -> None:
    file = moved_box(browser, tmp_path)
    opened = FileView(browser, file)
    page = opened.page
    slider = page.get_by_role("slider", name="Time")
    slider.wait_for()
    opened.look_at("box")

    def x() -> float:
        return float(page.evaluate("scenegate.model.find(['box'])?.world.elements[12] ?? NaN"))

    slider.press("End")
    opened.until(lambda: abs(x() - 1.0) < 1e-6, "the end")
    opened.until(lambda: opened.share("red", "right") > 0.02 and opened.share("red", "left") == 0.0, "the image of it")
    page.get_by_role("button", name="Play", exact=False).first.wait_for()  # it rests at the end
    slider.press("Home")
    opened.until(lambda: x() == -1.0, "the start")
    opened.until(lambda: opened.share("red", "left") > 0.02 and opened.share("red", "right") == 0.0, "the image of it")
    page.get_by_role("button", name="One change forward").click()
    opened.until(lambda: -1.0 < x() < -0.5, "a change later")
    page.get_by_role("button", name="Play (P)").click()
    opened.until(lambda: x() > 0.5, "it plays")
    assert page.get_by_role("button", name="Live").count() == 0
    assert opened.faults == []
    page.close()
    _check_moment(browser, file)


def _check_moment(browser: Any, file: Path) -> None:
    """Open the file at a moment, as an address or the file itself names it."""
    frames = frames_of(recording_of(file.read_bytes()))
    times = [time for time, frame in frames if parse_frame(frame)[0]["kind"] == "update"]
    moment = f"eye=0,-5,0;target=0,0,0&time={times[len(times) // 2] + 0.001:.6f}"
    other = file.with_name("moment.html")
    other.write_bytes(file.read_bytes().replace(b'data-view=""', f'data-view="{html.escape(moment)}"'.encode()))
    for opened in (FileView(browser, file, f"#{moment}"), FileView(browser, other)):
        opened.page.get_by_role("button", name="Play (P)").wait_for()
        shown = opened.page.evaluate("scenegate.model.find(['box']).world.elements[12]")
        assert -0.9 < shown < 0.9
        assert opened.page.evaluate("scenegate.rig.camera.position.y") == pytest.approx(-5.0, abs=0.01)
        opened.page.close()


def test_a_damaged_file_says_so(browser: Any, url: str, tmp_path: Path) -> None:
    file = download(url, tmp_path)
    data = file.read_bytes()
    start = data.index(b'id="recording"') + 60
    file.write_bytes(data[:start] + b"AAAA" + data[start + 4 :])
    opened = FileView(browser, file)
    opened.page.get_by_text("The recording in this file cannot be read").wait_for()
    opened.page.close()
