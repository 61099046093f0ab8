"""Clients and their mailboxes: each holds the newest set only, so that a slow client costs the others nothing."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from gateway.stereo.request import Kind


class FullError(RuntimeError):
    """No further client is taken; the message names the limit."""


class StreamError(RuntimeError):
    """No sets can be made; the message says why."""


class Subscription:
    """One client's mailbox."""

    def __init__(self, kind: Kind, changed: asyncio.Event, epoch: int) -> None:
        """
        Args:
            changed: set when this client has taken a set or waits for one.
            epoch: of the hub when the client came.
        """
        self.kind = kind
        self.epoch = epoch
        self._changed = changed
        self.sent = 0
        """Sets taken out."""
        self.skipped = 0
        """Sets that a newer one has replaced."""
        self._number = -1
        self._data: bytes | None = None
        self._over = ""
        """Why the stream is over; empty: it is not."""
        self._filled = asyncio.Event()
        self.starving = False
        """Whether the client has sent everything and waits."""

    @property
    def hungry(self) -> bool:
        """Whether the mailbox is empty, and the stream is not over."""
        return self._data is None and not self._over

    def put(self, number: int, data: bytes) -> None:
        """Leaves a set unless a newer one, or this one, was here before."""
        if number <= self._number or self._over:
            return
        self.skipped += self._data is not None
        self._number, self._data = number, data
        self._filled.set()

    def fail(self, message: str) -> None:
        """Ends the stream with a sentence."""
        self._over, self._data = message, None
        self._filled.set()

    async def get(self) -> bytes:
        """The newest set that was not taken yet.

        Raises:
            StreamError: the stream is over.
        """
        if not self._filled.is_set():
            self.starving = True
            self._changed.set()
            try:
                await self._filled.wait()
            finally:
                self.starving = False
        if self._over:
            # A new one: a kept one would hold this frame, and so the mailbox, in a cycle.
            raise StreamError(self._over)
        data, self._data = self._data, None
        assert data is not None
        self._filled.clear()
        self._changed.set()
        self.sent += 1
        return data


class Hub:
    """All subscriptions."""

    def __init__(self, max_clients: int, max_kinds: int, epoch: Callable[[], int] = lambda: 0) -> None:
        """
        Args:
            epoch: a number that grows when the camera is told to make other sets.
        """
        self.epoch = epoch
        self._max_clients = max_clients
        self._max_kinds = max_kinds
        self._subscriptions: set[Subscription] = set()
        self._newcomers: set[Subscription] = set()
        self._gone_sent = 0
        self._gone_skipped = 0
        self._closed = ""
        self.changed = asyncio.Event()
        """Set when somebody came, left, took a set or waits for one."""

    @property
    def sent(self) -> int:
        """Sets taken out by all clients since start."""
        return self._gone_sent + sum(s.sent for s in self._subscriptions)

    @property
    def skipped(self) -> int:
        """Sets that were replaced by newer ones before their clients took them, since start."""
        return self._gone_skipped + sum(s.skipped for s in self._subscriptions)

    def __iter__(self) -> Iterator[Subscription]:
        return iter(tuple(self._subscriptions))

    def __len__(self) -> int:
        return len(self._subscriptions)

    @contextmanager
    def subscribe(self, kind: Kind) -> Iterator[Subscription]:
        """A mailbox for the time of the block.

        Raises:
            FullError: there are too many clients, or too many different requests.
            StreamError: the hub is closed.
        """
        if self._closed:
            raise StreamError(self._closed)
        if len(self._subscriptions) >= self._max_clients:
            raise FullError(f"{self._max_clients} streams are open already, the limit (max_clients)")
        kinds = self.kinds()
        if kind not in kinds and len(kinds) >= self._max_kinds:
            raise FullError(f"{self._max_kinds} different requests are served already, the limit (max_kinds)")
        subscription = Subscription(kind, self.changed, self.epoch())
        self._subscriptions.add(subscription)
        self._newcomers.add(subscription)
        self.changed.set()
        try:
            yield subscription
        finally:
            self._subscriptions.discard(subscription)
            self._newcomers.discard(subscription)
            self.changed.set()
            self._gone_sent += subscription.sent
            self._gone_skipped += subscription.skipped

    def kinds(self) -> set[Kind]:
        """What is wanted at all."""
        return {s.kind for s in self._subscriptions}

    def urgent_kinds(self, *, starving: bool) -> set[Kind]:
        """What is wanted now.

        Args:
            starving: only by clients that wait; False: by those whose mailbox is empty, too.
        """
        return {s.kind for s in self._subscriptions if s.starving or (s.hungry and not starving)}

    def take_newcomers(self) -> set[Kind]:
        """Kinds of those that came since the last call."""
        newcomers, self._newcomers = self._newcomers, set()
        return {s.kind for s in newcomers}

    def publish(self, kind: Kind, number: int, data: bytes, epoch: int = 0) -> None:
        """Leaves a set with everybody who wants this kind.

        Args:
            epoch: in which the set was taken. Who came in a later one does not get it: a client that sets a parameter
                or a fault and then opens a stream means the stream.
        """
        for subscription in self._subscriptions:
            if subscription.kind == kind and subscription.epoch <= epoch:
                subscription.put(number, data)

    def fail(self, kind: Kind, message: str) -> None:
        """Ends the streams of this kind."""
        for subscription in tuple(self._subscriptions):
            if subscription.kind == kind:
                subscription.fail(message)

    def close(self, message: str) -> None:
        """Ends all streams and takes no new ones."""
        self._closed = message
        for subscription in tuple(self._subscriptions):
            subscription.fail(message)
