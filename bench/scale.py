"""Render replicas behind HAProxy: throughput of 1, 2 and 4, and what clients see when one is killed under load.

    python -m bench.scale [--renders N]

HAProxy (`apt install haproxy`) runs with deploy/haproxy/haproxy.cfg, but for its ports and the addresses of the
replicas. Each replica has one thread; the scene has 40,000 triangles, 1.6 MB, and other poses in every request. CPU
time is that of the replicas alone, from /proc: it holds on a busy machine, where the rate does not.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import hashlib
import io
import os
import re
import shutil
import signal
import statistics
import subprocess
import tempfile
import threading
import time
import urllib.request
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from bench.gateways import Answer, Gateway, gateway, post
from bench.render_requests import textured
from bench.table import Row, at_least, show, skipped

CONFIG = Path(__file__).parents[1] / "deploy" / "haproxy" / "haproxy.cfg"
FLAGS = ("--only", "render", "--threads", "1", "--queue", "16")
CLIENTS = 8
WIDTH, HEIGHT = 640, 480


@dataclass(frozen=True, slots=True)
class Balancer:
    """A running HAProxy."""

    port: int
    stats_port: int
    process: subprocess.Popen[bytes]

    def stats(self) -> list[dict[str, str]]:
        """A row for each replica."""
        with urllib.request.urlopen(f"http://127.0.0.1:{self.stats_port}/;csv") as answer:
            rows = csv.DictReader(io.StringIO(answer.read().decode().removeprefix("# ")))
            return [row for row in rows if row["pxname"] == "replicas" and row["svname"].startswith("replica")]


@contextmanager
def haproxy(ports: Sequence[int]) -> Iterator[Balancer]:
    """HAProxy in front of replicas on these ports, which it has found ready."""
    front, stats = 20000 + os.getpid() % 20000, 20001 + os.getpid() % 20000
    text = CONFIG.read_text().replace("bind :8080", f"bind 127.0.0.1:{front}")
    text = text.replace("bind :8405", f"bind 127.0.0.1:{stats}")
    servers = "\n".join(f"    server replica{n} 127.0.0.1:{port}" for n, port in enumerate(ports))
    text = re.sub(r"^ +server-template .*$", servers, text, flags=re.MULTILINE)
    with tempfile.NamedTemporaryFile("w", suffix=".cfg") as file:
        file.write(text)
        file.flush()
        with subprocess.Popen(["haproxy", "-q", "-db", "-f", file.name], stdout=subprocess.DEVNULL) as process:
            balancer = Balancer(front, stats, process)
            try:
                while not _all_up(balancer):
                    assert process.poll() is None, f"haproxy ended with {process.returncode}"
                    time.sleep(0.1)
                yield balancer
            finally:
                process.terminate()


def _all_up(balancer: Balancer) -> bool:
    with contextlib.suppress(OSError):
        return all(row["status"].startswith("UP") for row in balancer.stats())
    return False


def load(port: int, bodies: Sequence[bytes], after: dict[int, threading.Event]) -> list[Answer | OSError]:
    """Every body, by ``CLIENTS`` clients; sets the event of ``after`` when so many were answered."""
    done: list[Answer | OSError] = []

    def one(body: bytes) -> Answer | OSError:
        try:
            answer: Answer | OSError = post(port, body)
        except (OSError, IndexError) as error:  # IndexError: the connection ended without an answer
            answer = OSError(str(error))
        done.append(answer)
        if (event := after.get(len(done))) is not None:
            event.set()
        return answer

    with ThreadPoolExecutor(CLIENTS) as pool:
        return list(pool.map(one, bodies))


def cpu_seconds(replica: Gateway) -> float:
    """User and system time of a process."""
    fields = Path(f"/proc/{replica.process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def throughput(bodies: Sequence[bytes]) -> Iterator[Row]:
    """Rows for 1, 2 and 4 replicas, and for one process with as many threads."""
    first = 0.0
    for count in (1, 2, 4):
        with ExitStack() as stack:
            replicas = [stack.enter_context(gateway(*FLAGS)) for _ in range(count)]
            balancer = stack.enter_context(haproxy([replica.port for replica in replicas]))
            rate, cpu = _measure(balancer.port, replicas, bodies)
        first = first or rate
        yield _rate(f"{count} replica{'s' * (count > 1)} of one thread behind HAProxy", rate, cpu, first)
        with gateway("--only", "render", "--threads", str(count)) as single:
            rate, cpu = _measure(single.port, [single], bodies)
        yield _rate(f"one process of {count} thread{'s' * (count > 1)}, no HAProxy", rate, cpu, first)


def _rate(what: str, rate: float, cpu: float, first: float) -> Row:
    return Row(what, f"{rate:.1f} renders/s, {cpu:.1f} ms of CPU each", "", f"{rate / first:.2f}× one replica's rate")


def _measure(port: int, replicas: Sequence[Gateway], bodies: Sequence[bytes]) -> tuple[float, float]:
    """Renders per second, and ms of CPU time a render."""
    load(port, bodies[: 2 * CLIENTS], {})
    before, begin = sum(map(cpu_seconds, replicas)), time.perf_counter()
    answers = load(port, bodies, {})
    seconds = time.perf_counter() - begin
    assert all(isinstance(answer, Answer) and answer.status == 200 for answer in answers)
    return len(bodies) / seconds, 1e3 * (sum(map(cpu_seconds, replicas)) - before) / len(bodies)


def killed(bodies: Sequence[bytes]) -> Iterator[Row]:
    """One of three replicas is killed after a third of the requests, another one told to end after two thirds."""
    third = len(bodies) // 3
    events = {third: threading.Event(), 2 * third: threading.Event()}
    with ExitStack() as stack:
        replicas = [stack.enter_context(gateway(*FLAGS)) for _ in range(3)]
        expected = [hashlib.sha256(post(replicas[0].port, body).body).digest() for body in bodies]
        balancer = stack.enter_context(haproxy([replica.port for replica in replicas]))

        def strike() -> None:
            for event, replica, number in zip(
                events.values(), replicas[1:], (signal.SIGKILL, signal.SIGTERM), strict=True
            ):
                event.wait()
                replica.process.send_signal(number)

        striker = threading.Thread(target=strike)
        striker.start()
        answers = load(balancer.port, bodies, events)
        striker.join()
        rows = balancer.stats()
    good = [a for a in answers if isinstance(a, Answer) and a.status == 200]
    same = sum(
        isinstance(a, Answer) and hashlib.sha256(a.body).digest() == digest
        for a, digest in zip(answers, expected, strict=True)
    )
    others = Counter(a.status if isinstance(a, Answer) else str(a) for a in answers if a not in good)
    times = sorted(a.total for a in good)
    retried = sum(int(row["wretr"] or 0) for row in rows), sum(int(row["wredis"] or 0) for row in rows)
    what = "renders answered while one of three replicas is killed (-9), and later another one ended (TERM)"
    yield at_least(what, f"{len(good)} of {len(answers)}", "", 100 * len(good) / len(answers), 100.0, " %")
    yield at_least(
        "of them the same bytes as without that",
        f"{same} of {len(answers)}",
        "",
        100 * same / len(answers),
        100.0,
        " %",
    )
    yield Row("HAProxy sent a request again to the same replica, to another one", f"{retried[0]}, {retried[1]} times")
    yield Row("answers other than a picture", ", ".join(f"{n} × {what}" for what, n in others.items()) or "none")
    longest = f"{statistics.median(times):.0f} ms, {times[int(0.99 * len(times))]:.0f} ms, {times[-1]:.0f} ms"
    yield Row(f"time of an answer, {CLIENTS} clients at once: median, 99 %, longest", longest)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else None)
    parser.add_argument("--renders", type=int, default=300, help="of each measurement")
    count: int = parser.parse_args().renders
    if shutil.which("haproxy") is None:
        show([skipped("replicas behind HAProxy", "there is no haproxy")])
        return
    scene = textured("color", copies=2, unique=2, side=256)
    bodies = [scene.next_body(WIDTH, HEIGHT) for _ in range(count)]
    print(
        f"{count} renders of {WIDTH}x{HEIGHT} a row, {len(bodies[0]) / 1e6:.2f} MB a request, {CLIENTS} clients, "
        f"{os.cpu_count()} cores. On a busy machine compare the CPU times, not the rates.",
        flush=True,
    )
    show([*killed(bodies), *throughput(bodies)])


if __name__ == "__main__":
    main()
