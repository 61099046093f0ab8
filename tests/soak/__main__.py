"""Load the whole gateway with clients of every kind; check for leaks, growth and overload handling.

    python -m tests.soak [--clients 1000] [--minutes 3] [--parts churn,overload,mixed]

``churn``: so many well-behaved, slow, half-open and vanishing clients on HTTP, render, WebSocket, gRPC and TCPQ; then
the tasks, threads, descriptors and memory of the gateway beside those of before. ``overload``: the render endpoint with
its queue just full, then with ten times as many clients; p99 of what was accepted, and how soon others are refused.
``mixed``: everything at once with a state file,
for so many minutes; the slope of the memory over the second half, and the stalls of the event loop. All
on loopback, in one gateway, two processes.
"""

import argparse
import asyncio
import contextlib
import json
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from statistics import median
from typing import Any

import uvloop

from gateway.runtime.workers.process_tuning import tune
from tests.soak import clients
from tests.soak.clients import BEHAVIOURS, KINDS, Ports
from tests.soak.overload import overload

QUEUE = 32
THREADS = 2
COUNTED = ("tasks", "threads", "files")
"""Resources of the gateway that must return to their initial number."""
STARTS_SECONDS, SILENT_SECONDS, ENDS_SECONDS = 240, 120, 60
"""Seconds after which a gateway that has not started, sends no figures or has not ended is given up."""
SETTLE_SECONDS = 45
TOGETHER = 100
"""Churning clients at a time."""
Samples = list[dict[str, Any]]
"""Numbers, but for ``thread_names``."""


class Gateway:
    """The process, and what it says of itself."""

    def __init__(self, process: asyncio.subprocess.Process, ports: Ports) -> None:
        self.process = process
        self.ports = ports
        self.samples: Samples = []
        self.begin = time.monotonic()

    async def listen(self) -> None:
        """Takes its figures in."""
        assert self.process.stdout is not None
        async for line in self.process.stdout:
            self.samples.append({"t": time.monotonic() - self.begin, **json.loads(line)})

    async def next(self) -> dict[str, Any]:
        """The figures of a second that is yet to come.

        Raises:
            TimeoutError: the gateway is silent.
        """
        seen = len(self.samples)
        async with asyncio.timeout(SILENT_SECONDS):
            while len(self.samples) < seen + 2:  # noqa: ASYNC110 - once a second
                await asyncio.sleep(0.1)
        return self.samples[-1]


@asynccontextmanager
async def gateway(state: Path) -> AsyncIterator[Gateway]:
    """A gateway that has started."""
    flags = ["host=127.0.0.1", "http_port=0", "grpc_port=0", "tcpq_port=0", "lcm_url=off", f"state={state}"]
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-X", "faulthandler", "-m", "tests.soak.server", *flags),
        *(f"queue={QUEUE}", f"threads={THREADS}"),
        stdout=asyncio.subprocess.PIPE,
    )
    listening = None
    try:
        async with asyncio.timeout(STARTS_SECONDS):
            port = int(json.loads(await process.stdout.readline())["http_port"])
            running = Gateway(process, Ports(port, 0, 0))
            listening = asyncio.create_task(running.listen())
            while (health := await _health(port))["status"] not in ("ready", "degraded"):  # noqa: ASYNC110 - only asking tells
                await asyncio.sleep(0.2)
        interfaces = health["interfaces"]
        tcpq = int(interfaces["treeviewer"]["tcpq"]["url"].rpartition(":")[2])
        running.ports = Ports(port, int(interfaces["stereo"]["port"]), tcpq)
        yield running
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.send_signal(signal.SIGTERM)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(ENDS_SECONDS):
                await process.wait()
        if process.returncode is None:
            process.send_signal(signal.SIGABRT)  # it prints where each of its threads is
        print(f"the gateway ended with exit code {await process.wait()}")
        if listening is not None:
            await listening


async def _health(port: int) -> Any:
    """Return what the gateway says; it listens before it is ready."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(clients.http_request("GET", "/healthz"))
    answer = await reader.read()
    writer.close()
    return json.loads(answer.partition(b"\r\n\r\n")[2])


# --- churn


async def churn(running: Gateway, count: int) -> tuple[dict[str, float], Counter[str]]:
    """Clients of all kinds; what is left of them, by figure, and how their visits ended."""
    await _wave(running.ports, min(count, 200))  # what the first of their kind leave is made once: pools, caches
    before = await _settled(running, None)
    begin = time.monotonic()
    outcomes = await _wave(running.ports, count)
    seconds = time.monotonic() - begin
    after = await _settled(running, before)
    print(f"\nchurn: {count} clients in {seconds:.0f} s, {TOGETHER} at a time: {dict(outcomes)}")
    for name in (*COUNTED, "rss_mb"):
        print(
            f"  {name:8} before {before[name]:8.1f}   after {after[name]:8.1f}   left {after[name] - before[name]:+.1f}"
        )
    if new := set(after["thread_names"]) - set(before["thread_names"]):
        print(f"  threads that were not there before: {', '.join(sorted(new))}")
    return {name: after[name] - before[name] for name in COUNTED}, outcomes


async def _settled(running: Gateway, before: dict[str, Any] | None) -> dict[str, Any]:
    """The figures when they are as before, or else do not change: half-open clients end by the server's timeouts."""
    last = await running.next()
    for _ in range(SETTLE_SECONDS):
        now = await running.next()
        if all(now[name] <= before[name] if before else now[name] == last[name] for name in COUNTED):
            return now
        last = now
    return last


async def _wave(ports: Ports, count: int) -> Counter[str]:
    outcomes: Counter[str] = Counter()
    room = asyncio.Semaphore(TOGETHER)

    async def one(number: int) -> None:
        kind, behaviour = KINDS[number % len(KINDS)], list(BEHAVIOURS)[number // len(KINDS) % len(BEHAVIOURS)]
        async with room:
            try:
                async with asyncio.timeout(60.0):
                    await BEHAVIOURS[behaviour](kind, ports)
                outcomes[behaviour] += 1
            except Exception as error:  # noqa: BLE001 - told in the sum
                outcomes[f"{behaviour} {kind}: {type(error).__name__}"] += 1

    await asyncio.gather(*(one(number) for number in range(count)))
    return outcomes


# --- mixed load


async def mixed(running: Gateway, minutes: float) -> None:
    """Run all kinds of load at once; print memory and stalls."""
    counts: Counter[str] = Counter()

    def count(what: str) -> None:
        counts[what] += 1

    first = len(running.samples)
    ports = running.ports
    work = [
        *(clients.publisher(ports, count, f"robot {k}") for k in range(2)),
        *(clients.browser(ports, count) for _ in range(2)),
        *(clients.camera(ports, count) for _ in range(2)),
        *(clients.asker(ports, count, 0.1) for _ in range(2)),
        _churning(ports, count),
    ]
    tasks = [asyncio.create_task(each) for each in work]
    done, _ = await asyncio.wait(tasks, timeout=60.0 * minutes, return_when=asyncio.FIRST_EXCEPTION)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    for task in done:
        print(f"a client ended: {task.exception()!r}")
    samples = running.samples[first:]
    half = samples[len(samples) // 2 :]
    slope = _slope([s["t"] / 60.0 for s in half], [s["rss_mb"] for s in half])
    stalls = [s["stall_p99_ms"] for s in samples]
    cpu = (samples[-1]["cpu_s"] - samples[0]["cpu_s"]) / (samples[-1]["t"] - samples[0]["t"])
    print(f"\nmixed: {minutes:g} minutes, {dict(counts)}, CPU {cpu:.2f} cores")
    print(f"  memory {samples[0]['rss_mb']:.0f} MB at the start, {samples[-1]['rss_mb']:.0f} MB at the end")
    print(f"  memory slope of the second half: {slope:+.2f} MB a minute")
    print(f"  loop stall of each second: p99 median {median(stalls):.1f} ms, largest {max(stalls):.1f} ms")
    print(f"  longest stall: {max(s['stall_max_ms'] for s in samples):.0f} ms")
    turns, load = [s["turn_max_ms"] for s in samples], median(s["load"] for s in samples)
    print(
        f"  CPU time of the loop between two ticks: p99 median {median(s['turn_p99_ms'] for s in samples):.1f} ms, "
        f"longest of a second {median(turns):.1f} ms, largest {max(turns):.1f} ms; the machine's load {load:.1f}"
    )


async def _churning(ports: Ports, count: Any) -> None:
    number = 0
    while True:
        number += 1
        behaviour = BEHAVIOURS[list(BEHAVIOURS)[number % len(BEHAVIOURS)]]
        with contextlib.suppress(OSError, asyncio.IncompleteReadError, TimeoutError):
            async with asyncio.timeout(20.0):
                await behaviour(KINDS[number % len(KINDS)], ports)
        count("churned clients")
        await asyncio.sleep(0.2)


def _slope(x: list[float], y: list[float]) -> float:
    """Return the slope of the least-squares line."""
    mx, my = sum(x) / len(x), sum(y) / len(y)
    return sum((a - mx) * (b - my) for a, b in zip(x, y, strict=True)) / sum((a - mx) ** 2 for a in x)


async def run(given: argparse.Namespace) -> None:
    """The parts in turn, on one gateway."""
    with tempfile.TemporaryDirectory() as folder:
        async with gateway(Path(folder) / "soak.state") as running:
            for part in given.parts.split(","):
                if part == "churn":
                    await churn(running, given.clients)
                elif part == "overload":
                    await overload(running.ports.http, QUEUE + THREADS, given.overload_seconds)
                elif part == "mixed":
                    await mixed(running, given.minutes)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clients", type=int, default=1000)
    parser.add_argument("--minutes", type=float, default=3.0)
    parser.add_argument("--overload-seconds", type=float, default=10.0)
    parser.add_argument("--parts", default="churn,overload,mixed")
    tune()
    uvloop.run(run(parser.parse_args()))


if __name__ == "__main__":
    main()
