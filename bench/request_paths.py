"""Path of a request through our code: files that run and calls of functions, for three kinds of request.

    python -m bench.request_paths [--calls] [--repeats 9]

The server runs with a profiler in all its threads; compiled kernels count as no call. Counted are the files of
``gateway``, ``renderers`` and ``client`` of which a function is called, and those calls; resuming a coroutine is a
call, too. Each row is the repeat with the fewest calls, because timers of the server run beside them. ``--calls`` lists
the calls by function.
"""

import argparse
import json
import os
import socket
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from types import CodeType, FrameType

import grpc
from websockets.sync.client import connect

from bench.gateways import Gateway, post
from bench.render_requests import corpus, recorded
from bench.table import Row, show
from renderers.compiler.jit import KERNELS
from renderers.compiler.pending import any_pending
from scenegate.camera import image_interface_pb2 as pb
from scenegate.tree.requests import Requests

ROOT = Path(__file__).parent.parent
OURS = tuple(f"{ROOT / name}{os.sep}" for name in ("gateway", "renderers", "client"))
GENERATED = "image_interface_pb2"
SOCKET = "SCENEGATE_BENCH_SOCKET"
"""Environment variable with the path of the profiler's socket."""
SECONDS = 30.0
"""Timeout of a request."""
SETS = 10
"""Number of image sets in one repeat."""
GOALS = {"POST /render, known scene": (30, 250), "one transform, TCPQ → browser": (22, 130), "gRPC, a set": (32, 500)}
"""Maximum numbers of files and calls."""


class Profiler:
    """Counts calls by function in all threads between ``start`` and ``stop``."""

    def __init__(self) -> None:
        self._calls: Counter[CodeType] | None = None
        threading.setprofile(self._on_event)
        sys.setprofile(self._on_event)

    def start(self) -> None:
        """Begin to count, once all kernels are loaded."""
        while any_pending():  # calls of a background thread would count, too
            time.sleep(0.1)
        self._calls = Counter()

    def stop(self) -> dict[str, int]:
        """Return the calls of our functions since ``start``, by ``file function``."""
        calls, self._calls = self._calls or Counter(), None
        kernels = {kernel.dispatcher.py_func.__code__ for kernel in KERNELS}  # Numba reports their calls
        ours = ((code.co_filename, code.co_qualname, count) for code, count in calls.items() if code not in kernels)
        return {
            f"{Path(file).relative_to(ROOT)} {function}": count
            for file, function, count in ours
            if file.startswith(OURS) and GENERATED not in file
        }

    def _on_event(self, frame: FrameType, event: str, _: object) -> None:
        if event == "call" and self._calls is not None:
            self._calls[frame.f_code] += 1


def serve() -> None:
    """Run the command line with a profiler that a client of a Unix socket starts and stops."""
    from scenegate.cli import main

    listener = socket.socket(socket.AF_UNIX)
    listener.bind(os.environ.pop(SOCKET))
    listener.listen()
    profiler = Profiler()

    def control() -> None:
        sys.setprofile(None)
        with listener.accept()[0].makefile("rw") as lines:
            for line in lines:
                if line == "start\n":
                    profiler.start()
                lines.write(json.dumps({} if line == "start\n" else profiler.stop()) + "\n")
                lines.flush()

    threading.Thread(target=control, daemon=True).start()
    main()


class ProfiledGateway(Gateway):
    """A gateway with a profiler."""

    def __init__(self, folder: str) -> None:
        path = str(Path(folder, "profiler"))
        super().__init__(
            *("--grpc-port", "0", "--tcpq-port", "0", "--lcm-url", "off"),
            program=("-c", "from bench.request_paths import serve; serve()"),
            environment={SOCKET: path},
        )
        control = socket.socket(socket.AF_UNIX)
        control.connect(path)
        self._control = control.makefile("rw")

    def count(self, action: Callable[[], object], repeats: int) -> dict[str, int]:
        """Return the calls by function of the repeat of ``action`` with the fewest calls."""
        found = []
        for _ in range(repeats):
            self._command("start")
            action()
            found.append(self._command("stop"))
        return min(found, key=lambda counts: sum(counts.values()))

    def _command(self, command: str) -> dict[str, int]:
        self._control.write(command + "\n")
        self._control.flush()
        counts: dict[str, int] = json.loads(self._control.readline())
        return counts


def render(gateway: ProfiledGateway, repeats: int) -> dict[str, int]:
    """POST /render of a known scene in new poses."""
    folder = corpus()
    if folder is None:
        raise SystemExit("SCENEGATE_CORPUS names no folder of recorded requests")
    scene = recorded(folder, "001", "color")
    post(gateway.port, scene.next_body(640, 480))
    bodies = iter([scene.next_body(640, 480) for _ in range(repeats)])
    return gateway.count(lambda: post(gateway.port, next(bodies)), repeats)


def transform(gateway: ProfiledGateway, repeats: int) -> dict[str, int]:
    """One transform over an open TCPQ connection, its response, and the frame for a browser."""
    url = gateway.interface("treeviewer")["tcpq"]["url"]
    box = {"type": "box", "lengths": [1, 1, 1]}
    requests = Requests(url, SECONDS, binary=False)
    requests.send({"setgeometry": [{"path": ["box"], "geometry": box}]})
    with (
        closing(requests.connection),
        connect(f"ws://127.0.0.1:{gateway.port}/view/ws", compression=None, max_size=None) as view,
    ):
        offsets = iter(range(1, repeats + 1))

        def move() -> None:
            view.send("k")  # acknowledges the update before: the next one is not sent without
            pose = {"translation": [next(offsets), 0, 0], "quaternion": [1, 0, 0, 0]}
            requests.send({"settransform": [{"path": ["box"], "transform": pose}]})
            while b'"update"' not in view.recv(decode=False)[:64]:
                pass

        with suppress(TimeoutError):  # the scene before the first move
            while view.recv(timeout=1.0):
                pass
        return gateway.count(move, repeats)


def image_set(gateway: ProfiledGateway, repeats: int) -> dict[str, int]:
    """One set of left image and disparity, of a stream."""
    channel = grpc.insecure_channel(
        f"127.0.0.1:{gateway.interface('stereo')['port']}", [("grpc.max_receive_message_length", -1)]
    )
    call = channel.unary_stream("/ImageInterface/StreamImageSets", pb.ImageSetRequest.SerializeToString)
    sets = call(pb.ImageSetRequest(left_enabled=True, disparity_enabled=True))
    for _ in range(SETS):
        next(sets)
    counts = gateway.count(lambda: [next(sets) for _ in range(SETS)], repeats)
    sets.cancel()
    per_set = {name: round(count / SETS) for name, count in counts.items()}
    return {name: count for name, count in per_set.items() if count}  # the others belong to timers


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--calls", action="store_true")
    parser.add_argument("--repeats", type=int, default=9)
    arguments = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        gateway = ProfiledGateway(folder)
        try:
            for (title, (files, calls)), measure in zip(GOALS.items(), (render, transform, image_set), strict=True):
                counts = measure(gateway, arguments.repeats)
                found_files, found_calls = len({name.split()[0] for name in counts}), sum(counts.values())
                met = found_files <= files and found_calls <= calls
                ours, goal = f"{found_files} / {found_calls}", f"≤ {files} / {calls}"
                rows.append(Row(f"{title}: files / calls", ours, goal=goal, met=met))
                for function, count in sorted(counts.items(), key=lambda item: -item[1]) if arguments.calls else ():
                    print(f"{count:6} {function}")
        finally:
            gateway.stop()
    show(rows)


if __name__ == "__main__":
    main()
