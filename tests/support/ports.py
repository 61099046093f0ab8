"""Free TCP ports for servers that cannot choose one."""

import random
import socket
from contextlib import ExitStack

LOWEST, END = 10_000, 32_000
"""Below the ephemeral ports, which systems give to connections, and to servers on port 0, of tests that run beside."""


def free_ports(count: int) -> list[int]:
    """Return different ports of 127.0.0.1 that were free a moment ago."""
    chance = random.SystemRandom()
    with ExitStack() as held:
        found: list[int] = []
        while len(found) < count:
            sock = held.enter_context(socket.socket())
            try:
                sock.bind(("127.0.0.1", chance.randrange(LOWEST, END)))
            except OSError:
                continue
            found.append(sock.getsockname()[1])
        return found
