"""Clients for tests, with the time limit of all waits: httpx2 alone gives up after 5 s, websockets after 10."""

from functools import partial

import httpx2
from websockets.sync.client import connect

from tests.support.waiting import SECONDS

Client = partial(httpx2.Client, timeout=SECONDS)
get = partial(httpx2.get, timeout=SECONDS)
post = partial(httpx2.post, timeout=SECONDS)
put = partial(httpx2.put, timeout=SECONDS)
# Without pings: a server that cannot answer them within 20 s is slow, not gone. Closing has its own 10 s, at whose end
# nothing fails.
websocket = partial(connect, open_timeout=SECONDS, ping_interval=None)


def figures(url: str) -> dict[str, float]:
    """Return all metrics of a gateway, by name and labels."""
    lines = get(f"{url}/metrics").text.splitlines()
    return {name: float(value) for name, _, value in (line.rpartition(" ") for line in lines) if name[:1] != "#"}
