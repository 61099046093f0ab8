"""The page in Chromium: times between frames of moving scenes, and memory over minutes of changes.

    python -m bench.page [--seconds 10] [--minutes 10] [--nodes 1000,5000] [--points 1000000]

Frame times: boxes that all move 60 times a second, and a cloud in a view that zooms. Memory: a camera image, 640 x 480,
at 10 Hz, 100 boxes that move at 60 Hz, and a mesh that is deleted and published again with other vertices at 5 Hz, all
at once; ``--minutes 0`` leaves it out. Chromium draws by SwiftShader, without a GPU: compare lines of one run.
"""

from __future__ import annotations

import argparse
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np

from bench.browser import FLAGS, SECONDS, launched, tcpq_url
from bench.gateways import gateway
from bench.running import tree_of
from scenegate import Box, ImagePlane, Mesh, PointCloud, TreeViewer

COUNT_FRAMES: Final = """(seconds) => new Promise((resolve) => {
  const { stage, model } = scenegate;
  const [frames, revision, start, times] = [stage.frames, model.revision, performance.now(), []];
  let [last, drawn] = [start, stage.frames];
  const step = (now) => {
    if (stage.frames > drawn) { times.push(now - last); [last, drawn] = [now, stage.frames]; }
    if (now - start < 1000 * seconds) requestAnimationFrame(step);
    else resolve({ times, rate: (stage.frames - frames) / seconds, revisions: (model.revision - revision) / seconds });
  };
  requestAnimationFrame(step);
})"""
TURN: Final = """() => {
  const turn = () => {
    scenegate.rig.controls.dollyIn(1 + 0.01 * Math.sin(performance.now() / 500));
    requestAnimationFrame(turn);
  };
  turn();
}"""
COUNTS: Final = """() => {
  const { renderer: { info }, frames } = scenegate.stage;
  return { ...info.memory, programs: info.programs.length, frames };
}"""


def poses(count: int, tick: int) -> np.ndarray:
    """Return (count, 7): x, y, z, qw, qx, qy, qz of boxes in a square that all turn and rise."""
    number = np.arange(count)
    side = int(np.ceil(np.sqrt(count)))
    half = 0.01 * tick + 0.1 * number
    height = 0.3 * np.sin(0.05 * tick + 0.2 * number)
    zero = np.zeros(count)
    return np.stack((number % side, number // side, height, np.cos(half), zero, zero, np.sin(half)), axis=1)


@contextmanager
def repeated(rate: float, action: Callable[[int], object]) -> Iterator[None]:
    """Call ``action(number)`` in a thread, at a rate in Hz, or as often as it can."""
    ended = threading.Event()

    def run() -> None:
        number, due = 0, time.perf_counter()
        while not ended.is_set():
            action(number)
            number, due = number + 1, max(due + 1.0 / rate, time.perf_counter())
            ended.wait(due - time.perf_counter())

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


class Bench:
    """One browser; a gateway and a page for each row."""

    def __init__(self, browser: Any, seconds: float) -> None:
        self._browser = browser
        self._seconds = seconds

    @contextmanager
    def _page(self) -> Iterator[tuple[TreeViewer, Any]]:
        """Yield a publisher and the page of its gateway."""
        with gateway(*FLAGS) as running, TreeViewer(tcpq_url(running), timeout=SECONDS) as viewer:
            page = self._browser.new_page(viewport={"width": 1280, "height": 800}, bypass_csp=True)
            page.set_default_timeout(1e3 * SECONDS)
            page.goto(f"http://127.0.0.1:{running.port}/view?theme=light")
            page.wait_for_function("window.scenegate?.model.nodes.size >= 1")
            yield viewer, page
            page.close()

    def _report(self, name: str, page: Any) -> None:
        page.wait_for_timeout(5000)  # the first view follows the scene for two seconds
        found = page.evaluate(COUNT_FRAMES, self._seconds)
        times = np.array(found["times"] or [np.nan])
        middle, slow = np.percentile(times, (50, 95))
        print(
            f"{name:24} {found['rate']:5.1f} frames/s, {found['revisions']:5.1f} revisions/s; between frames: "
            f"median {middle:6.1f} ms, 95 % {slow:6.1f} ms, longest {times.max():6.1f} ms",
            flush=True,
        )

    def moving(self, count: int) -> None:
        """Boxes that all move."""
        paths = [("boxes", str(number)) for number in range(count)]
        with self._page() as (viewer, page):
            with viewer.batch() as batch:
                for number, path in enumerate(paths):
                    batch[path].set(Box((0.6, 0.4, 0.3), color=(0.2 + 0.6 * (number % 7) / 7, 0.5, 0.7)))
                batch.set_transforms(paths, poses(count, 0))
            with repeated(60.0, lambda tick: viewer.set_transforms(paths, poses(count, tick))):
                self._report(f"{count} moving nodes", page)

    def cloud(self, count: int) -> None:
        """A cloud in a view that changes with each frame."""
        points = np.random.default_rng(7).normal(size=(count, 3)).astype(np.float32)
        with self._page() as (viewer, page):
            viewer["cloud"].set(PointCloud(points, rgb=(127 + 40 * points.clip(-3, 3)).astype(np.uint8)))
            page.wait_for_function("scenegate.model.find(['cloud'])?.parts != null")
            page.evaluate(TURN)
            self._report(f"{count} points, zooming", page)

    def memory(self, minutes: float) -> None:
        """Images, poses and deletes, all at once."""
        random = np.random.default_rng(3)
        images = random.integers(0, 255, (20, 480, 640, 3), np.uint8)
        boxes = [("boxes", str(number)) for number in range(100)]
        faces = np.array([[0, 1, 2], [0, 2, 3]])

        def mesh(number: int) -> None:
            if number % 2:
                viewer["mesh"].delete()
            else:
                viewer["mesh"].set(Mesh(random.normal(size=(4, 3)).astype(np.float32), faces))

        with self._page() as (viewer, page):
            with viewer.batch() as batch:
                for path in boxes:
                    batch[path].set(Box((0.5, 0.5, 0.5)))
            with (
                repeated(10.0, lambda number: viewer["image"].set(ImagePlane(images[number % 20], width=4.0))),
                repeated(60.0, lambda tick: viewer.set_transforms(boxes, poses(100, tick))),
                repeated(10.0, mesh),
            ):
                print("minute  geometries  textures  programs  frames  JS heap  renderer   GPU process   (MB)")
                start, steps = time.monotonic(), 10
                for step in range(steps + 1):
                    page.wait_for_timeout(max(0.0, 1e3 * (start + 60 * minutes * step / steps - time.monotonic())))
                    self._print_memory(page, (time.monotonic() - start) / 60)

    def _print_memory(self, page: Any, minute: float) -> None:
        session = page.context.new_cdp_session(page)
        session.send("HeapProfiler.collectGarbage")
        heap = session.send("Runtime.getHeapUsage")["usedSize"] / 1e6
        session.detach()
        found = page.evaluate(COUNTS)
        counts = "".join(f"{found[name]:>10}" for name in ("geometries", "textures", "programs", "frames"))
        print(
            f"{minute:6.1f}{counts}{heap:9.1f}{resident('renderer'):10.0f}{resident('gpu-process'):14.0f}", flush=True
        )


def resident(kind: str) -> float:
    """Return the resident memory of the browser's processes of a kind, MB."""
    found = 0
    for pid in tree_of(os.getpid()):
        try:
            command = Path(f"/proc/{pid}/cmdline").read_bytes()
            if f"--type={kind}".encode() in command:
                found += int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
        except OSError:
            continue  # it has ended
    return found / 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0, help="measured for each row of frame times")
    parser.add_argument("--minutes", type=float, default=10.0, help="measured for memory; 0: not at all")
    parser.add_argument("--nodes", default="1000,5000", help="numbers of moving nodes; empty: none")
    parser.add_argument("--points", default="1000000", help="numbers of points; empty: none")
    options = parser.parse_args()
    with launched() as browser:
        bench = Bench(browser, options.seconds)
        for count in filter(None, options.nodes.split(",")):
            bench.moving(int(count))
        for count in filter(None, options.points.split(",")):
            bench.cloud(int(count))
        if options.minutes > 0:
            bench.memory(options.minutes)


if __name__ == "__main__":
    main()
