"""``scenegate view`` as users run it, over HTTP and in a browser."""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from gateway.files.assets.mesh_files import MeshFiles
from gateway.replay.log_replay import LogReplay
from tests.adapters.treeviewer.conversation import message
from tests.adapters.viewer.browser.page import View
from tests.replay.logs import BEGIN, CHANNEL, write_log
from tests.replay.test_log_timeline import moving
from tests.support import clients
from tests.support.browser import chromium
from tests.support.command import scenegate
from tests.support.corpus import corpus_dir
from tests.support.gateway_process import GatewayProcess
from tests.support.waiting import wait_until

BALL = ("drake", "illustration", "plant", "ball", "ball")


@contextmanager
def viewing(log: Path, *flags: str, env: dict[str, str] | None = None) -> Iterator[tuple[GatewayProcess, str]]:
    """Run the command; yield it with its URL when the log is indexed."""
    process = GatewayProcess(str(log), "--http-port", "0", *flags, env=env, name="view")
    try:
        line = process.wait_for(f"{log} is at ")["event"]
        url = line.removeprefix(f"{log} is at ").removesuffix("/view until Ctrl+C.")
        wait_until(lambda: interfaces(url).get("log", {}).get("indexed") == 1.0)
        yield process, url
    finally:
        process.kill()


def interfaces(url: str) -> dict[str, Any]:
    found: dict[str, Any] = clients.get(f"{url}/healthz").json()["interfaces"]
    return found


def x_of(scene: dict[str, Any]) -> float:
    (node,) = (node for node in scene["nodes"] if node["path"] == ["a"])
    return float(node["transform"][0][3])


def colors(url: str, **query: Any) -> NDArray[np.uint8]:
    response = clients.get(f"{url}/scene/render", params={"width": 64, "height": 48, **query})
    assert response.status_code == 200, response.text
    return np.asarray(Image.open(io.BytesIO(response.content)).convert("RGB"))


@pytest.mark.slow
def test_a_log_over_http(tmp_path: Path) -> None:
    """The scene at any time; the last one by default. No other interface runs, and settings of a server do nothing."""
    mesh = {"path": ["m"], "geometry": {"type": "mesh_file", "filename": "/no/file.obj"}}
    log = write_log(
        tmp_path / "x.lcmlog",
        [*moving(20), (1.94, CHANNEL, message({"setgeometry": [mesh]})), (1.95, CHANNEL, b"no message")],
    )
    env = {"SCENEGATE_STATE": str(tmp_path / "state"), "SCENEGATE_HOST": "0.0.0.0", "SCENEGATE_DEMO": "1"}
    with viewing(log, "--mesh-root", "off", env=env) as (process, url):
        assert url.startswith("http://127.0.0.1:")
        assert interfaces(url).keys() == {"kernels", "scene", "view", "log"}
        assert interfaces(url)["log"]["incomplete_messages"] == 2
        assert x_of(clients.get(f"{url}/scene", params={"time": BEGIN + 0.55}).json()) == 5.0
        assert x_of(clients.get(f"{url}/scene", params={"time": -1.0}).json()) == 9.0
        assert x_of(clients.get(f"{url}/scene").json()) == 19.0
        late = clients.get(f"{url}/scene", params={"time": BEGIN + 5})
        assert (late.status_code, "the last 1.9 seconds" in late.text) == (404, True)
        camera = "eye=5,-9,3;target=5,0,0;fovy=20"
        seen = [colors(url, camera=camera, time=BEGIN + seconds) for seconds in (0.05, 0.55)]
        assert (seen[0] == seen[0][0, 0]).all(), "the box is out of view"
        assert (seen[1] != seen[1][0, 0]).any()
        assert process.stop() == 0
        assert any("messages that are not shown completely: 2;" in entry["event"] for entry in process.rest_of_log())
    assert not (tmp_path / "state").exists()


def test_what_is_no_log(tmp_path: Path) -> None:
    text = tmp_path / "x.lcmlog"
    text.write_text("no log")
    ran = scenegate("view", str(text), "--http-port", "0")
    assert (ran.exit_code, ran.stderr) == (1, f"scenegate: {text}: this is not an LCM log, it has no event\n")
    assert scenegate("view", str(tmp_path / "none")).exit_code == 2
    assert scenegate("view", str(text), "--mesh-root", "off:auto").exit_code == 2


@pytest.mark.browser
@pytest.mark.slow
def test_a_simulation_of_drake_in_the_page(tmp_path: Path) -> None:
    """The page plays from the start; each time that is sought has the pose of the message before."""
    recorded = corpus_dir() / "drakeviewer" / "drake_default.lcmlog"
    if not recorded.is_file():
        pytest.skip("SCENEGATE_CORPUS has no log of Drake's channels")
    log = tmp_path / "drake.lcmlog"
    log.write_bytes(recorded.read_bytes().replace(b"LABDIR", b"/lab"))  # a folder of the recording, as the lengths say
    heights: list[tuple[float, float, float]] = []
    with LogReplay(log, MeshFiles(())) as replay:
        while replay.next_event is not None:
            replay.step()
            pose = replay.snapshot.root.world_matrix(BALL)
            if pose is not None:
                heights.append((replay.clock.time_ns / 1e9, float(pose[2, 3]), replay.simulation_seconds or 0.0))
    with chromium() as browser, viewing(log) as (_, url):
        view = View(browser, url)
        view.wait_for_node(*BALL)
        view.page.get_by_role("button", name="Play").wait_for()  # at the end of the log, after 2 s
        for index in (len(heights) - 1, 10, len(heights) // 3, 12):
            seconds, height, simulation = heights[index]
            view.page.get_by_label("Time", exact=True).fill(f"{seconds + 1e-4 - heights[-1][0]:.6f}")
            view.until(lambda height=height: abs(height_in(view) - height) < 1e-5, f"the ball at {height}")
            view.until(lambda text=f"simulation {simulation:.2f} s": text in bar_of(view), f"the time {simulation}")
        assert not view.faults
        view.page.close()


def bar_of(view: View) -> str:
    return str(view.page.locator(".timebar").inner_text())


def height_in(view: View) -> float:
    height: float = view.page.evaluate("path => scenegate.model.find(path)?.world.elements[14] ?? -1", list(BALL))
    return height
