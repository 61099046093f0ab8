"""The tree viewer against its peers: the same jobs, from the client's call to the viewer's answer.

    python -m bench.treeviewer [--peers PYTHON] [--seconds S] [--latency]

Ours runs as the service that the gateway runs, in a process of its own, over UDP multicast and over the TCPQ hub. The
floor is the least that any viewer of this protocol could do: a loop of liblcm, the fastest JSON reader at hand (orjson
if it is installed) and a dict, over UDP. An echo by liblcm shows how long a small message takes while another client's
big one arrives, without any viewer. PYTHON is an interpreter with meshcat, viser or pydrake; see
``bench/treeviewer_peers.py`` for what is measured there. Every figure is a median (p99 after the slash) in ms; the last
lines are ratios. S bounds each job; the whole takes about 30 S. With ``--latency`` only the small message beside big
ones is measured. Binary messages are ``bench.treeviewer_binary``'s.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import gc
import json
import math
import os
import random
import socket
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import lcm
import msgspec
import uvloop

from gateway.ops.process import tune
from gateway.scene.live import LiveTree
from gateway.treeviewer import answers, wire
from gateway.treeviewer.config import TreeViewerConfig
from gateway.treeviewer.protocol import REQUEST, RESPONSE, TreeViewerProtocol, response_channel
from gateway.treeviewer.receive_buffer import ReceiveBuffer
from gateway.treeviewer.service import TreeViewerService

BOXES = 1000
VERTICES = POINTS = 100_000
FLOOD = 3000
ANSWER_SECONDS = 10.0
BIG_SECONDS = 0.1


# --- requests


def transforms(count: int) -> bytes:
    """Poses as a client's JSON writer prints them: 17 digits."""
    chance = random.Random(count)
    commands = [
        {
            "path": ["swarm", f"obj{i}"],
            "transform": {
                "translation": [chance.random() for _ in range(3)],
                "quaternion": [chance.random() for _ in range(4)],
            },
        }
        for i in range(count)
    ]
    return request(settransform=commands)


def boxes() -> bytes:
    look = {
        "color": [0.9, 0.7, 0.8, 1.0],
        "transform": {"translation": [0.0, 0.0, 0.0], "quaternion": [1.0, 0.0, 0.0, 0.0]},
    }
    commands = [
        {"path": ["swarm", f"obj{i}"], "geometries": [{"type": "box", "lengths": [0.1, 0.1, 0.1], **look}]}
        for i in range(BOXES)
    ]
    return request(setgeometry=commands)


def mesh() -> bytes:
    side = math.isqrt(VERTICES)
    vertices = [[x / side, y / side, 0.1 * math.sin(9.1 * x / side)] for y in range(side) for x in range(side)]
    faces = [
        corner
        for y in range(side - 1)
        for x in range(side - 1)
        for a in (y * side + x,)
        for corner in ([a, a + 1, a + side], [a + 1, a + side + 1, a + side])
    ]
    return request(
        setgeometry=[{"path": ["mesh"], "geometry": {"type": "mesh_data", "vertices": vertices, "faces": faces}}]
    )


def cloud() -> bytes:
    chance = random.Random(1)
    points, rgb = ([[chance.random() for _ in range(3)] for _ in range(POINTS)] for _ in range(2))
    geometry = {"type": "pointcloud", "points": points, "channels": {"rgb": rgb}}
    return request(setgeometry=[{"path": ["cloud"], "geometry": geometry}])


def request(**lists: Any) -> bytes:
    body = {"utime": 1700000000000000, "delete": [], "setgeometry": [], "settransform": [], **lists}
    return wire.encode(json.dumps(body).encode(), body["utime"])


JOBS: dict[str, Callable[[], bytes]] = {
    "create 1000 boxes": boxes,
    "1 transform": lambda: transforms(1),
    "100 transforms": lambda: transforms(100),
    "1000 transforms": lambda: transforms(1000),
    "mesh 100k": mesh,
    "cloud 100k": cloud,
}


# --- servers


async def serve(url: str, port: int) -> None:
    tune()
    service = TreeViewerService(TreeViewerConfig(lcm_url=url, tcpq_port=port), LiveTree())
    running = asyncio.create_task(service.run())
    await service.wait_ready()
    gc.collect()
    gc.freeze()
    print("ready", service.status().get("lcm", {}).get("receive_buffer_bytes"), flush=True)
    await running


def json_reader() -> str:
    """The fastest at hand that makes objects; orjson comes with the dependency group ``bench``."""
    return "orjson" if find_spec("orjson") else "msgspec"


async def floor(url: str) -> None:
    """liblcm on the loop, JSON to objects, objects into a dict, an answer of the same size."""
    if json_reader() == "orjson":
        reader = import_module("orjson")
        dumps, loads = reader.dumps, reader.loads
    else:
        dumps, loads = msgspec.json.encode, msgspec.json.decode
    tree: dict[Any, Any] = {}
    network = lcm.LCM(url)

    def handle(channel: str, data: bytes) -> None:
        comms = wire.decode(data)
        body = loads(comms.data)
        answer: dict[str, Any] = {"timestamp": comms.utime, "status": 0, "deleted_paths": [], "missing_paths": []}
        for kind, done in (("setgeometry", "added_geometries"), ("settransform", "set_transforms")):
            for command in body[kind]:
                tree[kind, *command["path"]] = command
            answer[done] = [command["path"] for command in body[kind]]
        network.publish(response_channel(channel), wire.encode(dumps(answer)))

    network.subscribe(f"{REQUEST}.*", handle).set_queue_capacity(0)
    with_large_buffer(url)
    gc.collect()
    gc.freeze()

    def readable() -> None:
        for _ in range(64):
            if network.handle_timeout(0) == 0:
                return

    asyncio.get_running_loop().add_reader(network.fileno(), readable)
    print("ready", flush=True)
    await asyncio.Event().wait()


async def echo(url: str) -> None:
    """liblcm answering as soon as it has a message, whatever is in it: what UDP and the machine alone cost."""
    network = lcm.LCM(url)
    answer = answers.encode(answers.failed(0, "echo"))
    network.subscribe(
        f"{REQUEST}.*", lambda channel, _: network.publish(response_channel(channel), answer)
    ).set_queue_capacity(0)
    with_large_buffer(url)
    asyncio.get_running_loop().add_reader(network.fileno(), network.handle)
    print("ready", flush=True)
    await asyncio.Event().wait()


def with_large_buffer(url: str) -> None:
    """Gives liblcm, which hides its socket, the receive buffer that ours has, so that big messages arrive at all."""
    if not url.startswith("udpm"):
        return
    port = int(url.split(":")[2].split("?")[0])
    for name in os.listdir("/proc/self/fd"):  # noqa: PTH208 - names are all that is wanted
        with contextlib.suppress(OSError), socket.socket(fileno=os.dup(int(name))) as sock:
            if sock.type == socket.SOCK_DGRAM and sock.getsockname()[1] == port:
                ReceiveBuffer(sock).raise_to(64 * 1024 * 1024)


# --- clients


class Client:
    """One client of the protocol, by liblcm."""

    def __init__(self, url: str, name: str) -> None:
        self._lcm = lcm.LCM(url)
        self._channel = f"{REQUEST}_<{name}>"
        answers: list[bytes] = []
        self._answers = answers
        # a handler that knew of this object would keep it for ever, liblcm's thread with it, which takes every message
        subscription = self._lcm.subscribe(f"{RESPONSE}_<{name}>", lambda _, data: answers.append(data))
        subscription.set_queue_capacity(0)
        with_large_buffer(url)
        time.sleep(0.2)  # until the network knows of the subscription

    def ask(self, message: bytes) -> float:
        """Milliseconds to the answer; infinite if there is none."""
        self._answers.clear()
        begin = time.perf_counter()
        self._lcm.publish(self._channel, message)
        while not self._answers:
            if self._lcm.handle_timeout(int(1000 * ANSWER_SECONDS)) == 0:
                return math.inf
        return 1000.0 * (time.perf_counter() - begin)

    def flood(self, message: bytes, count: int) -> tuple[int, float]:
        """Sends without waiting; returns the answers and the seconds until the last."""
        self._answers.clear()
        begin = last = time.perf_counter()
        for _ in range(count):
            self._lcm.publish(self._channel, message)
        while len(self._answers) < count and self._lcm.handle_timeout(2000):
            last = time.perf_counter()
        return len(self._answers), last - begin


@dataclass
class Figures:
    """Of one contestant."""

    name: str
    jobs: dict[str, list[float]] = field(default_factory=dict)
    """Milliseconds."""

    def median(self, job: str) -> float:
        return statistics.median(self.jobs[job]) if self.jobs.get(job) else math.nan

    def cell(self, job: str) -> str:
        times = sorted(self.jobs.get(job, ()))
        if not times:
            return "-"
        return f"{self.median(job):.3g}/{times[min(len(times) - 1, int(0.99 * len(times)))]:.3g}"


def measure(contestants: dict[str, str], messages: dict[str, bytes], seconds: float) -> list[Figures]:
    """Asks all in turn, so that whatever else the machine does meets all alike. ``contestants``: URL by name."""
    clients = [Client(url, f"bench{number}") for number, url in enumerate(contestants.values())]
    table = [Figures(name, {job: [] for job in messages}) for name in contestants]
    for job, message in messages.items():
        for client in clients:
            client.ask(message)
        end = time.monotonic() + seconds * len(clients)
        while time.monotonic() < end and len(table[0].jobs[job]) < 5000:
            for client, figures in zip(clients, table, strict=True):
                figures.jobs[job].append(client.ask(message))
    return table


@contextlib.contextmanager
def process(*arguments: str, python: str = sys.executable, stdin: int | None = None) -> Iterator[subprocess.Popen[str]]:
    """A part of this benchmark in a process of its own, ended with the block."""
    root = Path(__file__).parents[1]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    with subprocess.Popen(
        [python, *arguments],
        cwd=root,
        env=environment,
        stdin=stdin,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as child:
        try:
            yield child
        finally:
            child.kill()


def started(child: subprocess.Popen[str]) -> None:
    assert child.stdout is not None
    line = child.stdout.readline()
    if not line.startswith("ready"):
        raise SystemExit(f"a server did not start: {line!r}")


def wait_for_all() -> None:
    """Says that this process can begin, and waits until the others can."""
    print("ready", flush=True)
    sys.stdin.readline()


def disturbed(url: str, message: bytes, seconds: float) -> None:
    """Sends big messages, one after the other but not more than one in ``BIG_SECONDS``; prints how long each took."""
    client = Client(url, "big")
    client.ask(message)
    wait_for_all()
    times: list[float] = []
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        times.append(client.ask(message))
        time.sleep(max(0.0, BIG_SECONDS - times[-1] / 1000.0))
    print(json.dumps(times), flush=True)


def undisturbed(url: str, seconds: float) -> None:
    """Sends single transforms every 2 ms; prints how long each took."""
    client, single = Client(url, "small"), transforms(1)
    client.ask(single)
    wait_for_all()
    times: list[float] = []
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        times.append(client.ask(single))
        time.sleep(0.002)
    print(json.dumps(times), flush=True)


def others(url: str, kind: str, seconds: float) -> tuple[list[float], list[float]]:
    """Milliseconds of single transforms while another client sends big messages; and of those."""
    place = ("--url", url, "--seconds", str(seconds))
    with contextlib.ExitStack() as stack:
        both = [
            stack.enter_context(process("-m", "bench.treeviewer", "--part", part, *place, stdin=subprocess.PIPE))
            for part in ("small", f"big:{kind}")
        ]
        for child in both:
            started(child)
        for child in both:
            assert child.stdin is not None
            child.stdin.write("\n")
            child.stdin.flush()
        found = [json.loads(child.stdout.readline() or "[]") for child in both if child.stdout is not None]
        return found[0], found[1]


def peers_of(python: str, seconds: float) -> list[Figures]:
    with process("-m", "bench.treeviewer_peers", str(seconds), python=python) as child:
        assert child.stdout is not None
        found = [json.loads(line) for line in child.stdout if line.startswith("{")]
    return [Figures(entry["name"], entry["jobs"]) for entry in found]


def in_process(messages: dict[str, bytes], seconds: float) -> Figures:
    """Ours without a transport, for the peers that are measured in process."""
    protocol, figures = TreeViewerProtocol(LiveTree()), Figures("ours, in process")
    for job, message in messages.items():
        answers.encode(protocol.handle(message))
        times: list[float] = []
        end = time.monotonic() + seconds
        while time.monotonic() < end and len(times) < 5000:
            begin = time.perf_counter()
            answers.encode(protocol.handle(message))
            times.append(1000.0 * (time.perf_counter() - begin))
        figures.jobs[job] = times
    return figures


def percentile(times: list[float], share: float) -> float:
    ordered = sorted(times)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else math.nan


SMALL_BESIDE_BIG = "1 transform while another client sends a {kind} of 11 MB after the other, {transport}"


def latency(urls: dict[str, str], seconds: float) -> list[str]:
    """Sentences about a small message's delay beside big ones; ``urls`` by name of what serves there."""
    lines = []
    for transport, url in urls.items():
        for kind in ("mesh", "cloud"):
            times, big = others(url, kind, 2 * seconds)
            what = SMALL_BESIDE_BIG.format(kind=kind, transport=transport)
            lines.append(
                f"{what}: p50 {percentile(times, 0.5):.2f}, p99 {percentile(times, 0.99):.2f}, max {max(times):.1f} ms "
                f"({len(big)} of them, median {percentile(big, 0.5):.0f} ms)"
            )
    return lines


def compare(peers: str | None, seconds: float, only_latency: bool) -> None:
    number = random.randrange(20000, 50000)
    udp, floor_udp, echo_udp = (f"udpm://239.255.76.67:{number + k}?ttl=0" for k in (0, 1, 2))
    tcpq = f"tcpq://127.0.0.1:{number}"
    messages = {job: make() for job, make in JOBS.items()}
    lines: list[str] = []
    table: list[Figures] = []
    with (
        process("-m", "bench.treeviewer", "--part", "serve", "--url", udp, "--port", str(number)) as ours,
        process("-m", "bench.treeviewer", "--part", "floor", "--url", floor_udp) as plain,
        process("-m", "bench.treeviewer", "--part", "echo", "--url", echo_udp) as bare,
    ):
        for server in (ours, plain, bare):
            started(server)
        if not only_latency:
            floor_name = f"floor ({json_reader()}), udp"
            table = measure({"ours, udp": udp, "ours, tcpq": tcpq, floor_name: floor_udp}, messages, seconds)
            for url, transport in ((udp, "udp"), (tcpq, "tcpq")):
                for count in (1, 100):
                    answered, took = Client(url, "flood").flood(transforms(count), FLOOD)
                    lines.append(
                        f"flood {transport}, {count} transforms each: {answered} of {FLOOD} answered, "
                        f"{answered * count / took:,.0f} transforms/s"
                    )
        lines += latency({"udp": udp, "tcpq": tcpq, "udp, a bare echo by liblcm": echo_udp}, seconds)
    if only_latency:
        print(*lines, sep="\n")
        return
    table.append(in_process(messages, seconds))
    found = peers_of(peers, seconds) if peers else []
    report(table, found, lines)


def report(table: list[Figures], peers: list[Figures], lines: list[str]) -> None:
    print(f"{'ms, median/p99':<20}" + "".join(f"{figures.name:>21}" for figures in (*table, *peers)))
    for job in JOBS:
        print(f"{job:<20}" + "".join(f"{figures.cell(job):>21}" for figures in (*table, *peers)))
    print(*lines, sep="\n")
    ours, _, plain, inside = table
    for job in JOBS:
        print(f"ratio {plain.name.partition(',')[0]} / ours, {job}: {plain.median(job) / ours.median(job):.2f}")
        for peer in peers:
            if peer.jobs.get(job):
                same = ours if peer.name == "meshcat" else inside  # meshcat's server is another process, as ours is
                print(f"ratio {peer.name} / {same.name}, {job}: {peer.median(job) / same.median(job):.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peers", help="an interpreter with meshcat, viser or pydrake")
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--latency", action="store_true", help="only the delay of small messages beside big ones")
    parser.add_argument("--part", default="", help=argparse.SUPPRESS)
    parser.add_argument("--url", default="", help=argparse.SUPPRESS)
    parser.add_argument("--port", type=int, default=0, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.part == "serve":
        uvloop.run(serve(given.url, given.port))
    elif given.part == "floor":
        uvloop.run(floor(given.url))
    elif given.part == "echo":
        uvloop.run(echo(given.url))
    elif given.part == "small":
        undisturbed(given.url, given.seconds)
    elif given.part.startswith("big:"):
        disturbed(given.url, mesh() if given.part == "big:mesh" else cloud(), given.seconds)
    else:
        compare(given.peers, given.seconds, given.latency)


if __name__ == "__main__":
    main()
