"""The clients of ``bench.treeviewer``, and how they and the servers are started.

    python -m bench.treeviewer_clients small|mesh|cloud --url URL --seconds S

is a client in a process of its own, which sends single transforms, or big messages one after the other. It says when it
is ready, begins when it is told to, and prints how long each answer took.
"""

import argparse
import contextlib
import json
import math
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import lcm

from bench.running import end
from bench.treeviewer_requests import cloud, mesh, transforms
from bench.treeviewer_servers import with_large_buffer
from gateway.adapters.treeviewer.protocol import REQUEST, RESPONSE

ANSWER_SECONDS = 10.0
BIG_SECONDS = 0.1


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
    """Times of one contestant, by job."""

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


def percentile(times: list[float], share: float) -> float:
    ordered = sorted(times)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else math.nan


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
    """A part of this benchmark in a process of its own; it ends with the block, and so does what it has started."""
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
            end(child)


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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("client", choices=("small", "mesh", "cloud"))
    parser.add_argument("--url", required=True, help="of the viewer")
    parser.add_argument("--seconds", type=float, required=True, help="how long it asks")
    given = parser.parse_args()
    if given.client == "small":
        undisturbed(given.url, given.seconds)
    else:
        disturbed(given.url, {"mesh": mesh, "cloud": cloud}[given.client](), given.seconds)


if __name__ == "__main__":
    main()
