"""The pictures of docs/view.md: the page in Chromium, in front of gateways of its own.

    python -m tools.pictures.browser [FOLDER [NAME ...]]

FOLDER (default: docs/images) gets view-demo.png, view-empty.png, view-robot.png, view-cloud.png and view-phone.png, or
those that are named (``demo``). The robot is of recorded requests, in the folder that SCENEGATE_CORPUS names; without
them, that picture is left as it is. Chromium draws by SwiftShader, without a GPU.
"""

import json
import shutil
import sys
import tempfile
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np

from bench.gateways import Gateway, gateway, post
from bench.render_requests import KINDS, corpus, recorded
from scenegate import MeshFile, PointCloud, TreeViewer, Triad

FLAGS: Final = ("--grpc-port", "0", "--tcpq-port", "0", "--lcm-url", "off")
ARGUMENTS: Final = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking")
SECONDS: Final = 120.0
"""For a frame by SwiftShader on a busy machine."""
ROBOT: Final = "010"
"""Number of the recorded scene."""


class Pictures:
    """One browser, a page and a gateway a picture."""

    def __init__(self, browser: Any, folder: Path) -> None:
        self._browser = browser
        self._folder = folder

    def demo(self) -> None:
        """The demo scene and what the stereo camera sees of it."""
        with gateway("--demo", *FLAGS) as running, self._page(running, "light&shadows=on") as page:
            page.locator("[data-image=disparity] img").wait_for()
            self._shoot(page, "demo")

    def empty(self) -> None:
        """The page before anything is published."""
        with gateway(*FLAGS) as running, self._page(running, "dark", nodes=1) as page:
            page.get_by_text("The scene is empty").wait_for()
            self._shoot(page, "empty")

    def phone(self) -> None:
        """The same on a small screen."""
        with gateway("--demo", *FLAGS) as running, self._page(running, "dark", 360, 740) as page:
            self._shoot(page, "phone")

    def cloud(self) -> None:
        """A point cloud by the height of its points."""
        rng = np.random.default_rng(7)
        x, y = rng.uniform(-20, 20, (2, 100_000))
        hill = 1.6 * np.exp(-((x - 4) ** 2 + (y - 2) ** 2) / 30)
        z = 1.2 * np.sin(x / 3) * np.cos(y / 4) + 0.3 * np.sin(x + y) + hill
        points = np.stack((x, y, z), 1).astype(np.float32)
        seen_from = np.array((-6.0, -6.0, 4.0))
        distance = np.linalg.norm(points - seen_from, axis=1).astype(np.float32)
        shade = np.clip(0.55 + z / 6, 0, 1)
        rgb = (255 * shade[:, None] * np.array((0.55, 0.8, 0.4))).astype(np.uint8)
        channels = {"height": points[:, 2], "range": distance}
        terrain = PointCloud(points, colors=rgb, intensity=np.exp(-distance / 25), channels=channels)
        with gateway(*FLAGS) as running:
            with TreeViewer(tcpq_url(running)) as viewer:
                viewer["survey"]["terrain"].set(terrain)
                viewer["survey"]["scanner"].set(Triad(2.0, tube=True), transform=tuple(seen_from))
            with self._page(running, "light") as page:
                page.wait_for_function("scenegate.model.find(['survey', 'terrain'])?.parts != null")
                page.evaluate("scenegate.select(scenegate.model.find(['survey', 'terrain']))")
                page.get_by_label("Colour by").select_option("height")
                self._shoot(page, "cloud")

    def robot(self) -> None:
        """A robot as Drake posts it, and the requests that were drawn last."""
        folder = corpus()
        if folder is None:
            print("robot: SCENEGATE_CORPUS names no recorded requests", flush=True)
            return
        kinds = {kind: recorded(folder, ROBOT, kind) for kind in KINDS}
        with tempfile.TemporaryDirectory() as place:
            file = Path(place, "robot.gltf")
            file.write_bytes(kinds["color"].scene(0))
            with gateway("--mesh-root", place, *FLAGS) as running:
                with TreeViewer(tcpq_url(running)) as viewer:
                    viewer["robot"].set(MeshFile(str(file)))
                with self._page(running, "dark&shadows=on") as page:
                    page.wait_for_function("scenegate.model.find(['robot'])?.parts != null")
                    for kind, request in kinds.items():
                        if (answer := post(running.port, request.next_body(640, 480))).status != 200:
                            raise SystemExit(f"{kind}: {answer.body.decode()}")
                    post(running.port, kinds["color"].next_body(640, 480)[:3000])
                    page.get_by_role("button", name="Selection, stereo").click()
                    page.get_by_role("tab", name="Renders").click()
                    page.wait_for_function("document.querySelectorAll('.renders li').length == 4")
                    self._shoot(page, "robot")

    @contextmanager
    def _page(
        self, running: Gateway, theme: str, width: int = 1280, height: int = 800, nodes: int = 2
    ) -> Iterator[Any]:
        """Yield the page when it has a number of nodes. ``theme`` may have further parameters of the URL."""
        page = self._browser.new_page(viewport={"width": width, "height": height}, bypass_csp=True)
        page.set_default_timeout(1e3 * SECONDS)
        page.goto(f"http://127.0.0.1:{running.port}/view?theme={theme}")
        page.wait_for_function(f"window.scenegate?.model.nodes.size >= {nodes}")
        yield page
        page.close()

    def _shoot(self, page: Any, name: str) -> None:
        """When the page has drawn a while and every picture in it has come."""
        page.wait_for_function("[...document.images].every(image => image.complete)")
        page.wait_for_timeout(5000)
        path = self._folder / f"view-{name}.png"
        page.screenshot(path=path)
        print(f"{path} {path.stat().st_size / 1e3:.0f} kB", flush=True)


def tcpq_url(running: Gateway) -> str:
    """Return the URL of the gateway's TCPQ hub."""
    with urllib.request.urlopen(f"http://127.0.0.1:{running.port}/healthz", timeout=60) as answer:
        return str(json.load(answer)["interfaces"]["treeviewer"]["tcpq"]["url"])


@contextmanager
def launched() -> Iterator[Any]:
    """Yield Chromium; exit with a message if there is none."""
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        sys.exit("playwright is not installed: make test sets it up")
    path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if path is None:
        sys.exit("no chromium on this machine (on Debian: apt install chromium)")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=list(ARGUMENTS))
        yield browser
        browser.close()


def main() -> None:
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images")
    folder.mkdir(parents=True, exist_ok=True)
    with launched() as browser:
        pictures = Pictures(browser, folder)
        known: dict[str, Callable[[], None]] = {
            "demo": pictures.demo,
            "empty": pictures.empty,
            "robot": pictures.robot,
            "cloud": pictures.cloud,
            "phone": pictures.phone,
        }
        wanted = sys.argv[2:] or list(known)
        if unknown := set(wanted) - set(known):
            sys.exit(f"no such picture: {', '.join(sorted(unknown))}; there are {', '.join(known)}")
        for name in wanted:
            known[name]()


if __name__ == "__main__":
    main()
