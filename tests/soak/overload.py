"""Overload of the render endpoint: as many clients as its queue holds, then ten times as many."""

import asyncio
from dataclasses import dataclass, field
from statistics import median

from tests.soak.clients import http_request, render_body

TIMES = 10
"""Clients for each place."""
ROUNDS = 3
WARM_SECONDS = 2.0
"""Seconds at the start of each run that do not count: the queue fills."""


@dataclass(slots=True)
class Answers:
    """Milliseconds from connecting to the end of the response, for all clients of a run."""

    accepted: list[float] = field(default_factory=list)
    refused: list[float] = field(default_factory=list)
    failed: int = 0


async def ask(port: int, count: int, seconds: float, body: bytes) -> Answers:
    """``count`` clients, each sending the next request when the one before is answered; after 503 a second later."""
    loop = asyncio.get_running_loop()
    answers = Answers()
    request = http_request("POST", "/render", body)
    begin = loop.time() + WARM_SECONDS
    end = begin + seconds

    async def one(number: int) -> None:
        await asyncio.sleep(WARM_SECONDS / 2 * number / count)  # people do not come in the same millisecond
        while (start := loop.time()) < end:
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(request)
            status = (await reader.read())[9:12]
            writer.close()
            taken = 1e3 * (loop.time() - start)
            if start >= begin:
                if status in (b"200", b"503"):
                    (answers.accepted if status == b"200" else answers.refused).append(taken)
                else:
                    answers.failed += 1
            if status == b"503":
                await asyncio.sleep(1.0)  # as Retry-After says

    await asyncio.gather(*(one(number) for number in range(count)))
    return answers


async def overload(port: int, places: int, seconds: float) -> None:
    """Print both kinds of runs, in turn ``ROUNDS`` times, and the ratio of the medians of their p99."""
    body = render_body(1600)  # some ten milliseconds, so that rendering is what is scarce
    print(f"\noverload: a queue and threads for {places} renders")
    tails: dict[int, list[float]] = {1: [], TIMES: []}
    for times in (1, TIMES) * ROUNDS:
        answers = await ask(port, times * places, seconds, body)
        tails[times].append(_p(answers.accepted, 0.99))
        print(f"  {times * places} clients, {answers.failed} requests failed")
        for name, taken in (("accepted", answers.accepted), ("refused", answers.refused)):
            print(f"    {len(taken)} {name}, p50 {_p(taken, 0.5):.1f} ms, p99 {_p(taken, 0.99):.1f} ms")
    full, over = median(tails[1]), median(tails[TIMES])
    print(f"p99, {TIMES} times overload / queue just full: {full:.0f} ms, {over:.0f} ms, ratio {over / full:.2f}")


def _p(times: list[float], share: float) -> float:
    ordered = sorted(times)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else float("nan")
