"""Fault injection for test rigs: lost or late sets, broken streams, a frozen or wrong clock."""

import asyncio
from collections.abc import Callable
from random import Random
from typing import Annotated, Final

import msgspec

CUT_REASON: Final = "the stream was cut by fault injection"


class Faults(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Faults to inject. By default there are none."""

    drop: Annotated[float, msgspec.Meta(ge=0, le=1, description="Share of the frames that no client gets.")] = 0.0
    """Seed and frame number determine which frames are dropped."""
    delay: Annotated[float, msgspec.Meta(ge=0, le=10, description="Seconds by which every image set is late.")] = 0.0
    """Image sets keep their rate and order."""
    disconnect_after: Annotated[
        float,
        msgspec.Meta(
            ge=0, le=1_000_000, multiple_of=1, description="Number of image sets after which a stream is cut; 0: never."
        ),
    ] = 0
    """A whole number; JSON has one number type, so 5.0 is valid."""
    clock_frozen: Annotated[bool, msgspec.Meta(description="Timestamps do not advance.")] = False
    clock_offset: Annotated[
        float, msgspec.Meta(ge=-1e6, le=1e6, description="Seconds by which timestamps are wrong.")
    ] = 0.0


class FaultInjector:
    """Applies the current faults to timestamps and image sets."""

    def __init__(self, seed: int, max_late_bytes: int, on_change: Callable[[], object] = lambda: None) -> None:
        """Delay at most ``max_late_bytes``, and drop further sets; call ``on_change`` after faults were set."""
        self.faults = Faults()
        """Current faults."""
        self.dropped = 0
        """Number of sets dropped, either by the fault ``drop`` or because of ``max_late_bytes``."""
        self._on_change = on_change
        self._seed = seed
        self._max_late_bytes = max_late_bytes
        self._late_bytes = 0
        """Bytes of the delayed sets that are not delivered yet."""
        self._last_due = 0.0
        """Time at which the last delayed set is delivered, seconds of the event loop's clock."""
        self._frozen_timestamp: int | None = None

    def set(self, faults: Faults) -> None:
        """Replace the current faults."""
        self.faults = faults
        if not faults.clock_frozen:
            self._frozen_timestamp = None
        self._on_change()

    def timestamp(self, true_timestamp: int) -> int:
        """Return the timestamp to send for a true one, nanoseconds, not negative."""
        if self.faults.clock_frozen:
            if self._frozen_timestamp is None:
                self._frozen_timestamp = true_timestamp
            true_timestamp = self._frozen_timestamp
        return max(true_timestamp + round(self.faults.clock_offset * 1e9), 0)

    def deliver(self, frame_number: int, data: bytes, publish: Callable[[], None]) -> None:
        """Deliver a serialised set now, later or never: ``publish`` delivers it. Seed and frame number determine what
        is dropped."""
        if Random(f"{self._seed} {frame_number}").random() < self.faults.drop:  # noqa: S311 - no secret
            self.dropped += 1
            return
        loop = asyncio.get_running_loop()
        due = max(loop.time() + self.faults.delay, self._last_due)
        if due <= loop.time():
            publish()
            return
        if self._late_bytes + len(data) > self._max_late_bytes:
            self.dropped += 1
            return
        self._late_bytes += len(data)
        self._last_due = due
        loop.call_at(due, self._publish_late, len(data), publish)

    def _publish_late(self, nbytes: int, publish: Callable[[], None]) -> None:
        self._late_bytes -= nbytes
        publish()
