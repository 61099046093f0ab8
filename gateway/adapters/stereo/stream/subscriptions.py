"""Open streams: a mailbox for the newest image set of each client, and a queue of image events. Slow clients delay no
others: they miss image sets, and lose their oldest events."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum
from typing import Generic, TypeVar

from gateway.adapters.stereo.stream.set_kind import SetKind


class LimitError(RuntimeError):
    """A new client is refused because of a limit, which the message names."""


class StreamError(RuntimeError):
    """The stream has ended; the message is the reason."""


class MailboxState(Enum):
    """State of a client's mailbox."""

    EMPTY = "empty"
    """No set is stored, and the client does not wait for one: it has just subscribed, or is sent the previous set."""
    WAITING = "waiting"
    """The previous set has been sent, and the stream waits for the next one."""
    FULL = "full"
    """A set is stored."""
    CLOSED = "closed"
    """The stream has ended."""


class Subscription:
    """One client's mailbox."""

    def __init__(self, kind: SetKind, hub: ImageSetHub) -> None:
        """Subscribe to sets of a kind from a hub, which counts them."""
        self.kind = kind
        self.generation = hub.generation
        """Generation of the hub at subscription."""
        self.state = MailboxState.EMPTY
        self.sent = 0
        """Number of sets taken by the client."""
        self._hub = hub
        self._frame_number = -1
        """Frame of the newest set."""
        self._data = b""
        self._close_reason = ""
        self._ready = asyncio.Event()

    def put(self, frame_number: int, data: bytes) -> None:
        """Store the set of a frame, unless a set of this frame or of a later one was stored before."""
        if frame_number == self._frame_number or self.state is MailboxState.CLOSED:
            return
        if frame_number < self._frame_number:
            self._hub.skipped += 1
            return
        if self.state is MailboxState.FULL:
            self._hub.skipped += 1  # the stored set, which this one replaces
        self.state, self._frame_number, self._data = MailboxState.FULL, frame_number, data
        self._ready.set()

    def close(self, reason: str) -> None:
        """End the stream."""
        self.state, self._data, self._close_reason = MailboxState.CLOSED, b"", reason
        self._ready.set()

    async def get(self) -> bytes:
        """Wait for a set not taken yet. Cancelling loses none. Raises StreamError when the stream has ended."""
        if self.state is MailboxState.EMPTY:
            self.state = MailboxState.WAITING
            self._hub.notify_demand()
            try:
                await self._ready.wait()
            finally:
                if self.state is MailboxState.WAITING:  # cancelled
                    self.state = MailboxState.EMPTY
        if self.state is MailboxState.CLOSED:
            raise StreamError(self._close_reason)
        data, self._data = self._data, b""
        self.state = MailboxState.EMPTY
        self._ready.clear()
        self.sent += 1
        self._hub.sent += 1
        self._hub.notify_demand()
        return data


class EventQueue:
    """Serialised events that wait for one client."""

    def __init__(self, max_events: int) -> None:
        """Keep the newest ``max_events``."""
        self._events: deque[bytes] = deque(maxlen=max_events)
        self._close_reason = ""
        self._changed = asyncio.Event()

    def put(self, event: bytes) -> None:
        """Add an event."""
        self._events.append(event)
        self._changed.set()

    def close(self, reason: str) -> None:
        """End the stream when the queue is empty."""
        self._close_reason = reason
        self._changed.set()

    async def get(self) -> list[bytes]:
        """Wait for events; return all, oldest first. Raises StreamError when the stream has ended and the queue is
        empty."""
        while not self._events:
            if self._close_reason:
                raise StreamError(self._close_reason)
            self._changed.clear()
            await self._changed.wait()
        events = list(self._events)
        self._events.clear()
        return events


Stream = TypeVar("Stream", Subscription, EventQueue)


class _Hub(Generic[Stream]):
    """Open streams of one kind, at most ``max_clients``."""

    def __init__(self, max_clients: int, name: str) -> None:
        self._max_clients, self._name = max_clients, name
        self._streams: set[Stream] = set()
        self._close_reason = ""
        """Reason for refusing new streams; empty while the hub is open."""

    def __iter__(self) -> Iterator[Stream]:
        return iter(tuple(self._streams))

    def __len__(self) -> int:
        return len(self._streams)

    @contextmanager
    def _opened(self, stream: Stream) -> Iterator[None]:
        """Have a stream for the duration of the block. Raises LimitError if there are too many, or StreamError."""
        if self._close_reason:
            raise StreamError(self._close_reason)
        if len(self._streams) >= self._max_clients:
            raise LimitError(f"{self._max_clients} {self._name} are open already, the limit (max_clients)")
        self._streams.add(stream)
        try:
            yield
        finally:
            self._streams.discard(stream)

    def close(self, reason: str) -> None:
        """End all streams and refuse new ones."""
        self._close_reason = reason
        for stream in self._streams:
            stream.close(reason)


class EventHub(_Hub[EventQueue]):
    """Queues of all clients of the image events."""

    def __init__(self, max_clients: int, max_events: int) -> None:
        super().__init__(max_clients, "event streams")
        self._max_events = max_events

    @contextmanager
    def subscribe(self) -> Iterator[EventQueue]:
        """Return a queue for the duration of the block. Raises LimitError or StreamError."""
        queue = EventQueue(self._max_events)
        with self._opened(queue):
            yield queue

    def put(self, event: bytes) -> None:
        """Add an event to every client's queue."""
        for queue in self._streams:
            queue.put(event)

    def end_streams(self, reason: str) -> None:
        """End all streams."""
        for queue in self._streams:
            queue.close(reason)


class ImageSetHub(_Hub[Subscription]):
    """All subscriptions of one camera."""

    def __init__(self, max_clients: int, max_kinds: int, *, follows_demand: bool = False) -> None:
        """``follows_demand``: frames are made when clients want them, so ``notify_demand`` wakes the scheduler."""
        super().__init__(max_clients, "streams")
        self.generation = 0
        """Number of changes of parameters, faults or image source."""
        self.scheduler_wakeup = asyncio.Event()
        """Set when a client subscribes or disconnects, parameters or the image source change, or depth is triggered."""
        self._follows_demand = follows_demand
        self._max_kinds = max_kinds
        self.kinds: frozenset[SetKind] = frozenset()
        """Kinds of all subscriptions."""
        self.camera_kinds: tuple[SetKind, ...] = ()
        """Kinds without depth images."""
        self.depth_kinds: tuple[SetKind, ...] = ()
        """Kinds with depth images."""
        self.sent = 0
        """Number of sets taken by all clients since start."""
        self.skipped = 0
        """Number of sets that clients did not get since start, because a set of a later frame was there."""

    @contextmanager
    def subscribe(self, kind: SetKind) -> Iterator[Subscription]:
        """Return a subscription for the duration of the block. Raises LimitError, or StreamError if closed."""
        subscription = Subscription(kind, self)
        try:
            with self._opened(subscription):
                if kind not in self.kinds and len(self.kinds) >= self._max_kinds:
                    raise LimitError(f"{self._max_kinds} different requests are served already, the limit (max_kinds)")
                self._update_kinds()
                yield subscription
        finally:
            self._update_kinds()

    def _update_kinds(self) -> None:
        """Compute the kinds of the current subscriptions, and wake the scheduler."""
        self.kinds = frozenset(s.kind for s in self._streams)
        self.camera_kinds = tuple(kind for kind in self.kinds if not kind.has_depth)
        self.depth_kinds = tuple(kind for kind in self.kinds if kind.has_depth)
        self.scheduler_wakeup.set()

    def start_generation(self) -> None:
        """Count a change of parameters, faults or image source: later subscriptions get no sets from before it."""
        self.generation += 1
        self.scheduler_wakeup.set()

    def notify_demand(self) -> None:
        """Report that a client takes a set or starts to wait for one, or that a frame is finished."""
        if self._follows_demand:
            self.scheduler_wakeup.set()

    def kinds_with_mailbox(self, *states: MailboxState) -> set[SetKind]:
        """Return the kinds of subscriptions whose mailbox is in one of these states."""
        return {s.kind for s in self._streams if s.state in states}

    def publish(self, kind: SetKind, frame_number: int, data: bytes, generation: int = 0) -> None:
        """Store a serialised set in every mailbox of this kind; sets of later frames replace those of earlier ones.

        ``generation`` is that of the hub when the frame was captured. Subscriptions of a later generation do not get
        the set: a client that sets a parameter and then opens a stream expects sets with that parameter.
        """
        for subscription in self._streams:
            if subscription.kind == kind and subscription.generation <= generation:
                subscription.put(frame_number, data)

    def end_streams(self, kind: SetKind, reason: str) -> None:
        """End the streams of this kind."""
        for subscription in self._streams:
            if subscription.kind == kind:
                subscription.close(reason)
