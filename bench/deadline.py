"""Measure how long requests wait behind small requests that would render for minutes.

    python -m bench.deadline [--seconds 3] [--instances 10 100 1000]

The slow request has 10,000 triangles that each fill the image (0.5 MB, 1024 x 1024 pixels) and some instances of them;
the gateway has two threads. Four slow requests are sent at once, then a 2 x 2 image, which starts after two deadlines.
Then two slow requests whose clients disconnect after a second, and the 2 x 2 image again. Times run from the deadline,
or from the disconnection, to the small image's response.
"""

from __future__ import annotations

import argparse
import socket
import time
from concurrent.futures import ThreadPoolExecutor

from bench.gateways import Answer, Gateway, gateway, post
from bench.render_requests import CONTENT_TYPE, fields_for, request_body
from bench.table import Row, at_most, show
from tests.support.slow import slow_gltf

GOAL = 1.0
"""Seconds."""
_THREADS = 2
_ALONE = 1.0
"""Seconds before the slow clients disconnect."""


def request(side: int, instances: int) -> bytes:
    """Return the form of a slow request with ``side`` x ``side`` pixels."""
    return request_body(slow_gltf(10_000 if side > 2 else 1, instances), fields_for("color"), side, side)


def pixel(running: Gateway) -> None:
    """Render 2 x 2 pixels, which takes a millisecond."""
    answer = post(running.port, request(2, 1))
    if answer.status != 200:
        raise SystemExit(f"{answer.status}: {answer.body.decode()}")


def held(running: Gateway, slow: bytes, seconds: float) -> tuple[float, list[Answer]]:
    """Return the wait of the small image beyond two deadlines, s, and the responses of the slow requests."""
    with ThreadPoolExecutor(2 * _THREADS) as pool:
        sent = [pool.submit(post, running.port, slow) for _ in range(2 * _THREADS)]
        begin = time.perf_counter()
        time.sleep(0.5)
        pixel(running)
        waited = time.perf_counter() - begin
        return waited - 2 * seconds, [one.result() for one in sent]


def left(running: Gateway, slow: bytes) -> float:
    """Return the wait of the small image after the slow clients disconnected, s."""
    head = (
        f"POST /render HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: {CONTENT_TYPE}\r\nContent-Length: {len(slow)}\r\n"
    )
    clients = [socket.create_connection(("127.0.0.1", running.port)) for _ in range(_THREADS)]
    for client in clients:
        client.sendall(f"{head}\r\n".encode() + slow)
    time.sleep(_ALONE)
    for client in clients:
        client.close()
    begin = time.perf_counter()
    pixel(running)
    return time.perf_counter() - begin


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=3.0, help="--render-seconds")
    parser.add_argument("--instances", type=int, nargs="+", default=[10, 100, 1000])
    given = parser.parse_args()
    rows: list[Row] = []
    flags = ("--only", "render", "--threads", str(_THREADS), "--render-seconds", str(given.seconds))
    for instances in given.instances:
        slow = request(1024, instances)
        with gateway(*flags) as running:
            beyond, answers = held(running, slow, given.seconds)
            print(f"{instances} instances, {len(slow)} bytes:")
            for answer in answers:
                print(
                    f"  {answer.status} after {answer.total / 1e3:.2f} s: {answer.body.decode('utf-8', 'replace')[:80]}"
                )
            what = f"{instances} instances of 10,000 triangles of 1024² pixels"
            rows.append(at_most(f"{what}: four pixels after the deadline of those before", beyond, GOAL, "s"))
            rows.append(at_most(f"{what}: four pixels after their clients left", left(running, slow), GOAL, "s"))
    show(rows)


if __name__ == "__main__":
    main()
