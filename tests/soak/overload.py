"""Overload of the render endpoint: as many clients as its queue holds, then ten times as many; what the clients cost.

Clients are bare protocols, which cost some 0.1 ms of CPU a request: on a machine with as few cores as the gateway has
threads, theirs is taken from it. Their CPU time is printed beside the gateway's, and how late their own event loop is,
which is part of every time that they measure.
"""

import asyncio
import time
from dataclasses import dataclass, field
from functools import partial
from statistics import median
from typing import Any

from tests.soak.clients import http_request, render_body

TIMES = 10
"""So many clients for each place."""
ROUNDS = 3
WARM_SECONDS = 2.0
"""At the start of each run that do not count: the queue fills."""


@dataclass(slots=True)
class Answers:
    """Milliseconds from connecting to the end of the response, for all clients of a run."""

    accepted: list[float] = field(default_factory=list)
    refused: list[float] = field(default_factory=list)
    failed: int = 0
    seconds: float = 0.0
    client_cpu: float = 0.0
    """Seconds."""
    lag: list[float] = field(default_factory=list)
    """Milliseconds that the clients' own event loop was late."""


class _Ask(asyncio.Protocol):
    """One request on a connection of its own."""

    def __init__(self, request: bytes, done: asyncio.Future[bytes]) -> None:
        self._request, self._done, self._start = request, done, b""

    def connection_made(self, transport: Any) -> None:
        transport.write(self._request)

    def data_received(self, data: bytes) -> None:
        if len(self._start) < 12:
            self._start += data[:12]

    def connection_lost(self, exc: Exception | None) -> None:
        if not self._done.done():
            self._done.set_result(self._start)


async def ask(port: int, count: int, seconds: float, body: bytes) -> Answers:
    """``count`` clients, each sending the next request when the one before is answered; after 503 a second later."""
    loop = asyncio.get_running_loop()
    answers = Answers()
    request = http_request("POST", "/render", body)
    begin = loop.time()
    end = begin + WARM_SECONDS + seconds

    async def one(number: int) -> None:
        await asyncio.sleep(WARM_SECONDS / 2 * number / count)  # people do not come in the same millisecond
        while (start := loop.time()) < end:
            done: asyncio.Future[bytes] = loop.create_future()
            await loop.create_connection(partial(_Ask, request, done), "127.0.0.1", port)
            status = (await done)[9:12]
            taken = 1e3 * (loop.time() - start)
            counts = start - begin >= WARM_SECONDS
            if status == b"503":
                if counts:
                    answers.refused.append(taken)
                await asyncio.sleep(1.0)  # as Retry-After says
            elif counts:
                if status == b"200":
                    answers.accepted.append(taken)
                else:
                    answers.failed += 1

    async def watch() -> None:
        while (start := loop.time()) < end:
            await asyncio.sleep(0.005)
            answers.lag.append(1e3 * (loop.time() - start - 0.005))

    cpu = time.process_time()
    await asyncio.gather(watch(), *(one(number) for number in range(count)))
    answers.seconds, answers.client_cpu = loop.time() - begin, time.process_time() - cpu
    return answers


async def overload(running: Any, queue: int, threads: int, seconds: float) -> None:
    """Prints both kinds of runs, in turn ``ROUNDS`` times, and the ratio of the medians of their p99.

    On a machine that others use as well, the gateway gets more of it in one run than in another, and everybody's
    waiting follows: the second ratio is of p99 in units of the time that the places take to be served at its rate.
    """
    body = render_body(1600)  # some ten milliseconds, so that rendering is what is scarce
    places = queue + threads
    print(f"\noverload: a queue of {queue}, {threads} threads")
    tails: dict[int, list[float]] = {1: [], TIMES: []}
    relative: dict[int, list[float]] = {1: [], TIMES: []}
    for times in (1, TIMES) * ROUNDS:
        before = await running.next()
        answers = await ask(running.ports.http, times * places, seconds, body)
        after = await running.next()
        tail, rate = _p(answers.accepted, 0.99), len(answers.accepted) / seconds
        tails[times].append(tail)
        relative[times].append(tail * rate / (1e3 * places))
        _tell("queue just full" if times == 1 else f"{times} times overload", times * places, rate, answers)
        elapsed = after["t"] - before["t"]
        cpu, loop_cpu = after["cpu_s"] - before["cpu_s"], after["loop_cpu_s"] - before["loop_cpu_s"]
        each = 1e3 * loop_cpu / max(1, len(answers.accepted) + len(answers.refused))
        print(
            f"    CPU: gateway {cpu / elapsed:.2f} cores, its loop {loop_cpu / elapsed:.3f} ({each:.2f} ms an answer); "
            f"clients {answers.client_cpu / answers.seconds:.3f} cores, late by {_p(answers.lag, 0.99):.1f} ms (p99)"
        )
    full, over = median(tails[1]), median(tails[TIMES])
    print(f"p99, {TIMES} times overload / queue just full: {full:.0f} ms, {over:.0f} ms, ratio {over / full:.2f}")
    full, over = median(relative[1]), median(relative[TIMES])
    print(f"  in times that the places take to be served at its rate: {full:.2f}, {over:.2f}, ratio {over / full:.2f}")


def _tell(name: str, count: int, rate: float, answers: Answers) -> None:
    accepted, refused = answers.accepted, answers.refused
    line = f"  {name}, {count} clients: {len(accepted)} accepted ({rate:.1f} a second), "
    line += f"p50 {_p(accepted, 0.5):.0f} ms, p99 {_p(accepted, 0.99):.0f} ms"
    if refused:
        line += f"; {len(refused)} refused, p50 {_p(refused, 0.5):.1f} ms, p99 {_p(refused, 0.99):.0f} ms"
    print(line + f"; {answers.failed} failed")


def _p(times: list[float], share: float) -> float:
    ordered = sorted(times)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else float("nan")
