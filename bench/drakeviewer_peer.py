"""Meldis' side of ``bench.drakeviewer``, run by an interpreter with pydrake: ``drakeviewer_peer.py SECONDS``.

Reads the load message and the draw messages from the standard input, one a line in base64. Prints milliseconds for each
draw message: decoding, and the calls of its Meshcat, which has no browser.
"""

from __future__ import annotations

import base64
import logging
import sys
import time
from typing import Any


def main() -> None:
    from pydrake.visualization import Meldis

    logging.getLogger("drake").setLevel(logging.WARNING)
    load, *draws = [base64.b64decode(line) for line in sys.stdin.read().split()]
    server: Any = Meldis()

    def show(channel: str, message: bytes) -> None:
        server._message_pending_data[channel] = message  # noqa: SLF001 - as its LCM handler does
        server._invoke_subscriptions()  # noqa: SLF001 - as its loop does

    show("DRAKE_VIEWER_LOAD_ROBOT", load)
    show("DRAKE_VIEWER_DRAW", draws[0])
    server.meshcat.Flush()
    times: list[float] = []
    end = time.perf_counter() + float(sys.argv[1])
    while time.perf_counter() < end:
        message = draws[len(times) % len(draws)]
        begin = time.perf_counter()
        show("DRAKE_VIEWER_DRAW", message)
        times.append(1000.0 * (time.perf_counter() - begin))
    server.meshcat.Flush()
    print(*times)


main()
