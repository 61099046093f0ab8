"""The page in a browser, and a publisher that uses LCM's own library."""

import io
import json
import struct
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from tests.support import clients
from tests.support.browser import PAGE_SECONDS, Watched
from tests.support.liblcm import liblcm

FINGERPRINT = 0xD368E03F33C568BE
"""robotlocomotion.viewer2_comms_t, as lcm-gen computes it."""


WEB = "gateway/adapters/viewer/web"
AXE = Path(__file__).parents[4] / WEB / "node_modules/axe-core/axe.min.js"
needs_axe = pytest.mark.skipif(not AXE.is_file(), reason=f"axe-core is not installed (npm ci in {WEB})")
FLAGS = ("--lcm-url", "off", "--grpc-port", "0", "--tcpq-port", "0")


def hub_url(url: str) -> str:
    """Return the URL of a gateway's TCPQ hub."""
    return str(clients.get(f"{url}/healthz").json()["interfaces"]["treeviewer"]["tcpq"]["url"])


class Publisher:
    """A client of the tree viewer that uses LCM's own library."""

    def __init__(self, url: str) -> None:
        lcm = liblcm()
        self.url = hub_url(url)
        """URL of the gateway's TCPQ hub."""
        self.bus = lcm.LCM(self.url)
        self.sent = 0

    def send(self, **request: Any) -> None:
        self.sent += 1
        full = {
            "utime": self.sent,
            "timestamp": self.sent,
            "setgeometry": [],
            "settransform": [],
            "delete": [],
            **request,
        }
        data = json.dumps(full).encode()
        name = b"treeviewer_json\0"
        head = struct.pack(">QqI", FINGERPRINT, full["utime"], len(name))
        self.bus.publish(
            "DIRECTOR_TREE_VIEWER_REQUEST_<test>", head + name + struct.pack(">iii", 1, 0, len(data)) + data
        )

    def box(self, path: list[str], color: list[float], x: float = 0.0, size: float = 1.0) -> None:
        self.send(
            setgeometry=[{"path": path, "geometry": {"type": "box", "lengths": [size] * 3, "color": color}}],
            settransform=[self.at(path, x)],
        )

    def at(self, path: list[str], x: float) -> dict[str, Any]:
        return {"path": path, "transform": {"translation": [x, 0.0, 0.0], "quaternion": [1.0, 0.0, 0.0, 0.0]}}


class View(Watched):
    """The page with a view from the side: the world's x axis points right."""

    def check_accessibility(self, what: str) -> None:
        """Check the page by the rules of axe in both themes."""
        if not self.page.evaluate("window.axe !== undefined"):
            self.page.evaluate(AXE.read_text())
        for theme in ("dark", "light"):
            self.page.evaluate("theme => (document.documentElement.dataset.theme = theme)", theme)
            violations = self.page.evaluate("axe.run().then(({ violations }) => violations)")
            assert [(each["id"], each["nodes"][0]["html"]) for each in violations] == [], f"{what}, {theme}"

    def look_at(self, *path: str) -> None:
        """Wait for a node, then ``look``. (The page frames the first node by itself.)"""
        self.wait_for_node(*path)
        self.look()

    def wait_for_node(self, *path: str | int) -> None:
        """Wait for a node."""
        self.until(lambda: self.page.evaluate("path => scenegate.model.find(path)?.parts != null", path), str(path))

    def look(self) -> None:
        """Place the camera on the −Y side with x from −2 m to 2 m in view; hide grid, axes and frustum."""
        self.page.evaluate(
            """() => {
              const { stage, frustum, Box3 } = scenegate;
              const box = new Box3();
              box.min.set(-2, -0.5, -0.5);
              box.max.set(2, 0.5, 0.5);
              scenegate.rig.look("side", [box]);
              for (const object of [stage.grid, stage.axes, frustum.object]) stage.show(object, false);
            }"""
        )

    def at(self, *point: float) -> tuple[float, float]:
        """Return the place on the page of a point in the world."""
        project = """([x, y, z]) => {
          const { stage, Box3 } = scenegate;
          const point = new Box3().min.set(x, y, z).sub(scenegate.rig.origin).project(scenegate.rig.camera);
          const area = stage.canvas.getBoundingClientRect();
          return [area.left + (point.x + 1) / 2 * area.width, area.top + (1 - point.y) / 2 * area.height];
        }"""
        left, top = self.page.evaluate(project, point)
        return left, top

    def drag(self, x: float, y: float, to_x: float, to_y: float, steps: int = 4) -> None:
        """Move the mouse from one place on the page to another with its left button pressed."""
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        self.page.mouse.move(to_x, to_y, steps=steps)
        self.page.mouse.up()

    def colors(self) -> NDArray[np.uint8]:
        """Return the pixels of the view without what lies over it, (H, W, 3) uint8."""
        show = """(visibility) => {
          const over = document.querySelectorAll(".view-axes, .pills, .marks");
          for (const { style } of over) Object.assign(style, { visibility });
        }"""
        self.page.evaluate(show, "hidden")
        png = self.page.locator(".stage .view canvas").screenshot()
        self.page.evaluate(show, "")
        return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))

    def open_stereo_panel(self) -> None:
        """Open the panels on the right, which are closed at first, but for those of a demo with a stereo camera."""
        button = self.page.get_by_role("button", name="Selection, stereo")
        if button.get_attribute("aria-pressed") != "true":
            button.click()
        self.page.get_by_role("tab", name="Stereo").click()

    def open_display_menu(self) -> None:
        """Open the menu of the toolbar, unless it is open."""
        if not self.page.locator("#display").is_visible():
            self.page.get_by_role("button", name="Display").click()

    def share(self, color: str, side: str = "both") -> float:
        """Return the share of pixels with a colour, of the whole view or one half."""
        pixels = self.colors().astype(int)
        half = pixels.shape[1] // 2
        pixels = {"both": pixels, "left": pixels[:, :half], "right": pixels[:, half:]}[side]
        channel = {"red": 0, "green": 1, "blue": 2}[color]
        others = np.delete(pixels, channel, axis=2).max(axis=2)
        return float((pixels[:, :, channel] > others + 90).mean())

    def until(self, condition: Any, what: str) -> None:
        """Wait for a condition; SwiftShader draws a few frames per second."""
        limit = time.monotonic() + PAGE_SECONDS
        while not condition():
            assert time.monotonic() < limit, f"{what}: still not so after {PAGE_SECONDS:.0f} s; faults: {self.faults}"
            self.page.wait_for_timeout(100)


def row(view: View, path: list[str]) -> Any:
    return view.page.locator(f".row[data-path='{json.dumps(path, separators=(',', ':'))}']")
