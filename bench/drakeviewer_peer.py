"""Meldis' side of ``bench.drakeviewer``, run by an interpreter with pydrake: ``drakeviewer_peer.py LOG SECONDS``.

Prints milliseconds of CPU time per message: decoding, and the calls and threads of its Meshcat, which has no browser.
"""

import logging
import struct
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

Event = tuple[int, str, bytes]
"""Time, channel and message."""


def read_log(path: Path) -> list[Event]:
    """Return the events of an LCM log."""
    data, events, position = path.read_bytes(), [], 0
    while position < len(data):
        _, _, when, name, size = struct.unpack_from(">IqqII", data, position)
        position += 28
        events.append((when, data[position : position + name].decode(), data[position + name : position + name + size]))
        position += name + size
    return events


def play(
    handle: Callable[[str, bytes], None], finish: Callable[[], None], events: list[Event], seconds: float
) -> float:
    """Handle all events once, then those after time 0 again and again; return milliseconds of CPU time for each."""
    for _, channel, message in events:
        handle(channel, message)
    finish()
    measured = [(channel, message) for when, channel, message in events if when]
    handled, end, begin = 0, time.perf_counter() + seconds, time.process_time()
    while time.perf_counter() < end or handled % len(measured):
        handle(*measured[handled % len(measured)])
        handled += 1
    finish()
    return 1000.0 * (time.process_time() - begin) / handled


def main() -> None:
    from pydrake.visualization import Meldis, _meldis

    logging.getLogger("drake").setLevel(logging.WARNING)
    server: Any = Meldis()
    # Meldis adds the channels of clouds and frames when their first message arrives by LCM.
    clouds = _meldis._PointCloudApplet(meshcat=server.meshcat)  # noqa: SLF001 - Meldis has no public way
    frames = _meldis._DrawFrameApplet(meshcat=server.meshcat)  # noqa: SLF001 - Meldis has no public way
    for channel, kind, show in (
        ("DRAKE_POINT_CLOUD", _meldis.lcmt_point_cloud, clouds.on_point_cloud),
        ("DRAKE_DRAW_FRAMES", _meldis.lcmt_viewer_draw, frames.on_frame_update),
    ):
        server._message_types[channel], server._message_handlers[channel] = kind, [show]  # noqa: SLF001 - as above

    def handle(channel: str, message: bytes) -> None:
        server._message_pending_data[channel] = message  # noqa: SLF001 - as its LCM handler does
        server._invoke_subscriptions()  # noqa: SLF001 - as its loop does

    print(play(handle, server.meshcat.Flush, read_log(Path(sys.argv[1])), float(sys.argv[2])))


if __name__ == "__main__":
    main()
