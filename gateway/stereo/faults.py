"""Faults for test rigs: sets that are lost or late, streams that break, a clock that stands still or is wrong."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Annotated, Final

import msgspec

from renderers.stereo.noise import Stream, frame_key

CUT: Final = "the stream was cut by fault injection"


class Faults(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What goes wrong; the defaults are that nothing does."""

    drop: Annotated[float, msgspec.Meta(ge=0, le=1, description="Share of the frames that no client gets.")] = 0.0
    """Which frames these are follows from seed and frame number."""
    delay: Annotated[float, msgspec.Meta(ge=0, le=10, description="Seconds by which every image set is late.")] = 0.0
    """Image sets keep their rate and order."""
    disconnect_after: Annotated[
        float,
        msgspec.Meta(
            ge=0, le=1_000_000, multiple_of=1, description="Number of image sets after which a stream is cut; 0: never."
        ),
    ] = 0
    """A whole number; as JSON has one kind of numbers, 5.0 is one."""
    clock_frozen: Annotated[bool, msgspec.Meta(description="Timestamps do not advance.")] = False
    clock_offset: Annotated[
        float, msgspec.Meta(ge=-1e6, le=1e6, description="Seconds by which timestamps are wrong.")
    ] = 0.0


_NONE: Final = Faults()


class FaultInjector:
    """The faults in force. Without any it does nothing."""

    def __init__(self, seed: int, max_late_bytes: int) -> None:
        """
        Args:
            max_late_bytes: of sets that wait for their delay to pass; further ones are dropped.
        """
        self._seed = seed
        self._max_late_bytes = max_late_bytes
        self._late_bytes = 0
        self._last_due = 0.0
        self._frozen: int | None = None
        self.faults = _NONE
        self.changes = 0
        """How often faults were set."""
        self.dropped = 0
        """Sets that were lost on purpose or for lack of room."""

    def set(self, faults: Faults) -> None:
        """From now on."""
        self.faults = faults
        self.changes += 1
        if not faults.clock_frozen:
            self._frozen = None

    def stamp(self, true: int) -> int:
        """The timestamp that is sent for a true one, nanoseconds; never negative."""
        faults = self.faults
        if faults is _NONE:
            return true
        if faults.clock_frozen:
            self._frozen = true if self._frozen is None else self._frozen
            true = self._frozen
        return max(true + round(faults.clock_offset * 1e9), 0)

    def deliver(self, number: int, data: bytes, put: Callable[[], None]) -> None:
        """Lets a set go out: now, later or never.

        Args:
            number: of the frame.
            data: the set, for its size.
            put: leaves it with the clients.
        """
        if self._drops(number):
            self.dropped += 1
            return
        loop = asyncio.get_running_loop()
        due = max(loop.time() + self.faults.delay, self._last_due)
        if due <= loop.time():
            put()
            return
        if self._late_bytes + len(data) > self._max_late_bytes:
            self.dropped += 1
            return
        self._late_bytes += len(data)
        self._last_due = due
        loop.call_at(due, self._late, len(data), put)

    def _drops(self, number: int) -> bool:
        share = self.faults.drop
        return share > 0.0 and (int(frame_key(self._seed, number, Stream.LEFT)) >> 11) * 2.0**-53 < share

    def _late(self, size: int, put: Callable[[], None]) -> None:
        self._late_bytes -= size
        put()
