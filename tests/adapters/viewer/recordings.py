"""Recordings as a page reads them, and timelines of a few states."""

from __future__ import annotations

import gzip
import struct
from bisect import bisect_right
from dataclasses import dataclass
from typing import Any

from gateway.scene.tree.live import Snapshot
from gateway.scene.tree.timeline import Timeline
from tests.support.view_frames import parse_frame

SECOND = 1_000_000_000


@dataclass
class States(Timeline):
    """A timeline of given states."""

    snapshots: list[Snapshot]

    @property
    def span(self) -> tuple[int, int]:
        return self.snapshots[0].timestamp, self.snapshots[-1].timestamp

    async def snapshot_at(self, time: int) -> Snapshot:
        return self.snapshots[max(0, bisect_right(self.snapshots, time, key=lambda each: each.timestamp) - 1)]

    def simulation_seconds_at(self, time: int) -> float | None:
        return None

    def held(self) -> States:
        return self


def frames_of(recording: bytes) -> list[tuple[float, bytes]]:
    """Return the frames of a recording with their times, seconds since the epoch."""
    data = gzip.decompress(recording)
    frames, at = [], 0
    while at < len(data):
        time, size, zero = struct.unpack_from("<dII", data, at)
        assert zero == 0
        frames.append((time, data[at + 16 : at + 16 + size]))
        at += 16 + size + -size % 8
    return frames


def headers_of(recording: bytes, kind: str) -> list[dict[str, Any]]:
    """Return the headers of the frames of a kind."""
    headers = (parse_frame(frame)[0] for _, frame in frames_of(recording))
    return [header for header in headers if header["kind"] == kind]
