"""A bounded pool of threads behind a bounded, first-come queue: how work leaves the event loop.

Waiting is the normal case (Drake's client never retries), so the queue is deep; only beyond its bounds a caller is
turned away. A caller that is cancelled frees its place, or ends its call: every call runs under a ``StopFlag`` of its
own, which also ends it at its deadline and at shutdown.
"""

from __future__ import annotations

import asyncio
import contextvars
import math
import os
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any, Final, ParamSpec, TypeVar

from gateway.runtime.scheduling import step_back
from renderers.stop import StopFlag

P = ParamSpec("P")
T = TypeVar("T")

MAX_RETRY_AFTER: Final = 60
"""Seconds; an estimate beyond a minute is a guess about other people's requests."""
STOPPING_SECONDS: Final = 0.5
"""Time in which a call ends whose flag was set."""
_SMOOTHING: Final = 0.1
"""Weight of the newest duration in the running mean that ``Retry-After`` is estimated from."""


def usable_cpus() -> int:
    """CPUs that this process may run on; a container's CPU set counts."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Busy(Exception):  # noqa: N818 - it is an answer, not a fault
    """The queue is full."""

    def __init__(self, reason: str, retry_after: int) -> None:
        super().__init__(f"{reason}; try again in {retry_after} s")
        self.retry_after = retry_after
        """Seconds after which a place is probably free, >= 1."""


class Closed(Exception):  # noqa: N818 - as above
    """The pool is shutting down: it takes no work, or the call was ended."""


class TooSlow(Exception):  # noqa: N818 - as above
    """The call was ended at its deadline."""


class Abandoned(Exception):  # noqa: N818 - as above
    """The call was ended because its caller was cancelled."""


@dataclass(frozen=True, slots=True)
class WorkersStats:
    """One consistent reading."""

    threads: int
    running: int
    waiting: int
    waiting_bytes: int
    done: int
    """Finished calls since start, failed ones included."""
    rejected: int
    """Calls answered with ``Busy``."""
    abandoned: int
    """Calls whose caller left before the result was there."""
    slow: int
    """Running calls that have used more than half of the time that they may take."""
    timed_out: int
    """Calls that were ended at their deadline."""


class _Job:
    __slots__ = ("call", "context", "future", "loop", "started", "stop", "weight")

    def __init__(
        self, call: Callable[[], Any], weight: int, loop: asyncio.AbstractEventLoop, future: asyncio.Future[Any]
    ) -> None:
        self.call = call
        self.weight = weight
        self.loop = loop
        self.future = future
        self.context = contextvars.copy_context()
        self.stop = StopFlag()
        self.started = 0.0
        """Monotonic time at which the call began to run, seconds."""


class Workers:
    """Runs functions in threads, in the order in which they were handed in.

    The threads are daemons and start on demand. Callers may live in different event loops.
    """

    def __init__(
        self,
        threads: int | None = None,
        max_waiting: int = 256,
        max_waiting_bytes: int = 1 << 30,
        *,
        name: str = "worker",
        niceness: int = 0,
        seconds: float | None = None,
        limit_name: str = "seconds",
    ) -> None:
        """
        Args:
            threads: at most this many calls run at once; None: one per CPU that this process may use.
            max_waiting: calls that may wait for a thread; each keeps a connection and its request alive.
            max_waiting_bytes: sum of the weights of the waiting calls. One that alone is heavier may still wait when
                nobody else does, so that no single request is impossible.
            name: of the threads, for debuggers.
            niceness: of the threads, beyond the process's own.
            seconds: time that a call may run, not counted while it waits; None: any.
            limit_name: of ``seconds``, for messages.
        """
        self.threads = threads if threads is not None else usable_cpus()
        if self.threads < 1 or max_waiting < 0 or max_waiting_bytes < 0 or (seconds is not None and seconds <= 0):
            raise ValueError("workers need at least one thread, bounds that are not negative, and some time")
        self.max_waiting = max_waiting
        self.max_waiting_bytes = max_waiting_bytes
        self._name = name
        self._niceness = niceness
        self.seconds = seconds
        self._limit_name = limit_name
        self._lock = threading.Lock()
        self._idle: list[SimpleQueue[None]] = []
        """Of each thread that waits, what wakes it up."""
        self._queue: deque[_Job] = deque()
        self._queue_bytes = 0
        self._jobs: set[_Job] = set()
        """Running calls."""
        self._alive = 0
        self._done = 0
        self._rejected = 0
        self._abandoned = 0
        self._timed_out = 0
        self._watching = False
        self._all_ended = threading.Event()
        self._mean_seconds = 0.0
        self._closing = False
        self._ended: list[tuple[asyncio.AbstractEventLoop, asyncio.Future[None]]] = []

    async def run(  # type: ignore[valid-type]  # PEP 612 has no place for weight
        self,
        fn: Callable[P, T],
        *args: P.args,
        weight: int = 0,
        **kwargs: P.kwargs,
    ) -> T:
        """Calls ``fn`` in a thread, with the caller's context variables, and returns what it returns.

        Args:
            weight: bytes that the call keeps alive while it waits.

        Raises:
            Busy: too much is waiting already.
            Closed: ``close`` was called.
            TooSlow: ``fn`` has looked at its flag (``renderers.stop``) after its time was over.
            Exception: whatever ``fn`` raised. When the caller is cancelled, a waiting call is forgotten at once, and
                the flag of a running one is set.
        """
        loop = asyncio.get_running_loop()
        future: asyncio.Future[T] = loop.create_future()
        job = _Job(lambda: fn(*args, **kwargs), weight, loop, future)
        with self._lock:
            if self._closing:
                raise Closed("the server is shutting down")
            # A free thread is one that no queued job has a claim on.
            if len(self._jobs) + len(self._queue) >= self.threads:
                self._check_bounds(weight)
            self._queue.append(job)
            self._queue_bytes += weight
            if self._idle:
                self._idle.pop().put(None)  # the one that has waited least
            elif self._alive < self.threads and self._alive < len(self._jobs) + len(self._queue):
                self._alive += 1
                threading.Thread(target=self._serve, name=f"{self._name}-{self._alive}", daemon=True).start()
                if self.seconds is not None and not self._watching:
                    self._watching = True
                    threading.Thread(target=self._watch, name=f"{self._name}-deadlines", daemon=True).start()
        try:
            return await future
        finally:
            if not future.done() or future.cancelled():
                self._forget(job)
            del job, future  # the traceback of a failure must not keep the request alive in a cycle

    @property
    def spare(self) -> int:
        """Threads that no call runs in or waits for: processors that those that run may use besides. Any thread."""
        return max(0, self.threads - len(self._jobs) - len(self._queue))

    @property
    def stuck(self) -> bool:
        """True while every thread runs a call that has used more than half of its time."""
        return self.stats.slow >= self.threads

    @property
    def full(self) -> bool:
        """Whether a call of any size would be refused now: as many wait as may."""
        return self.stats.waiting >= self.max_waiting and len(self._jobs) >= self.threads

    def refuse(self, coming: int) -> Busy | None:
        """Why a call would be refused if ``coming`` others were handed in before it; counted when it is. Any thread."""
        with self._lock:
            ahead = len(self._jobs) + len(self._queue) + coming
            return self._busy(ahead - self.threads, coming) if ahead >= self.threads + self.max_waiting else None

    @property
    def stats(self) -> WorkersStats:
        with self._lock:
            spare = max(0, self.threads - len(self._jobs))
            return WorkersStats(
                threads=self.threads,
                running=len(self._jobs),
                waiting=max(0, len(self._queue) - spare),
                waiting_bytes=self._queue_bytes,
                done=self._done,
                rejected=self._rejected,
                abandoned=self._abandoned,
                slow=self._slow(),
                timed_out=self._timed_out,
            )

    def _slow(self) -> int:
        if self.seconds is None:
            return 0
        begun = time.monotonic() - self.seconds / 2
        return sum([job.started < begun for job in self._jobs])

    async def close(self, limit: float = 10.0) -> bool:
        """Takes no new work, lets what was accepted finish, and ends the threads.

        Args:
            limit: seconds after which waiting calls fail with ``Closed``, and running ones are ended with it. Those
                that do not look at their flags are left behind (being daemons, they do not keep the process alive).

        Returns:
            Whether every thread ended within ``STOPPING_SECONDS`` after that.
        """
        loop = asyncio.get_running_loop()
        ended: asyncio.Future[None] = loop.create_future()
        with self._lock:
            self._closing = True
            while self._idle:
                self._idle.pop().put(None)
            if self._alive == 0:
                return True
            self._ended.append((loop, ended))
        done, _ = await asyncio.wait((ended,), timeout=limit)
        if done:
            return True
        with self._lock:
            leftovers = tuple(self._queue)
            self._queue.clear()
            self._queue_bytes = 0
            running = tuple(self._jobs)
        for job in leftovers:
            _tell(job, None, Closed("the server shut down before the request's turn came"))
        for job in running:
            job.stop.set(Closed("the server shut down before the result was ready"))
        done, _ = await asyncio.wait((ended,), timeout=STOPPING_SECONDS)
        return bool(done)

    def _check_bounds(self, weight: int) -> None:
        waiting = max(0, len(self._queue) - (self.threads - len(self._jobs)))
        if waiting >= self.max_waiting:
            raise self._busy(waiting)
        if self._queue and self._queue_bytes + weight > self.max_waiting_bytes:
            reason = (
                f"the waiting requests hold {self._queue_bytes} bytes; with {weight} more "
                f"they would exceed the limit of {self.max_waiting_bytes}"
            )
            raise self._busy(waiting, reason=reason)

    def _busy(self, waiting: int, coming: int = 0, reason: str = "") -> Busy:
        if not reason:
            arriving = f" ({coming} of them still arriving)" if coming else ""
            reason = f"{waiting} requests are waiting already{arriving}, the limit is {self.max_waiting}"
        self._rejected += 1
        seconds = math.ceil((waiting + 1) * self._mean_seconds / self.threads)
        return Busy(reason, min(max(1, seconds), MAX_RETRY_AFTER))

    def _forget(self, job: _Job) -> None:
        with self._lock:
            self._abandoned += 1
            try:
                self._queue.remove(job)
            except ValueError:  # it runs, or ran, already
                job.stop.set(Abandoned("the caller does not wait any more"))
                return
            self._queue_bytes -= job.weight

    def _watch(self) -> None:
        """Ends calls at their deadlines. A call that begins while this waits has a later one: nothing needs to wake
        it."""
        assert self.seconds is not None
        pause = self.seconds
        while not self._all_ended.wait(pause):
            now = time.monotonic()
            pause = self.seconds
            with self._lock:
                for job in self._jobs:
                    left = job.started + self.seconds - now
                    if left > 0.0:
                        pause = min(pause, left)
                    elif not job.stop.is_set:
                        self._timed_out += 1
                        job.stop.set(TooSlow(f"it took longer than {self._limit_name} = {self.seconds:g} s"))

    def _serve(self) -> None:
        step_back(self._niceness)
        calls: SimpleQueue[None] = SimpleQueue()  # waits without the interpreter, which a condition needs to go on
        while True:
            with self._lock:
                if self._queue:
                    job = self._queue.popleft()
                    self._queue_bytes -= job.weight
                    job.started = time.monotonic()
                    self._jobs.add(job)
                elif self._closing:
                    break
                else:
                    job = None
                    self._idle.append(calls)
            if job is None:
                calls.get()
                continue
            result, error = None, None
            try:
                result = job.context.run(job.stop.run, job.call)
            except BaseException as raised:  # noqa: BLE001 - the caller gets it, whatever it is
                error = raised
            seconds = time.monotonic() - job.started
            with self._lock:
                self._jobs.remove(job)
                self._done += 1
                self._mean_seconds += (seconds - self._mean_seconds) * (_SMOOTHING if self._mean_seconds else 1.0)
            _tell(job, result, error)
            del job, result, error
        with self._lock:
            self._alive -= 1
            waiters = self._ended if self._alive == 0 else []
            if self._alive == 0:
                self._all_ended.set()
        for loop, ended in waiters:
            _call_soon(loop, lambda ended=ended: None if ended.done() else ended.set_result(None))  # type: ignore[misc]  # no type for a default


def _tell(job: _Job, result: Any, error: BaseException | None) -> None:
    """Hands the outcome to the caller's loop; nobody may be there any more."""
    if isinstance(error, StopIteration):  # a future cannot carry it
        error = RuntimeError(f"StopIteration escaped: {error}")

    def settle() -> None:
        if job.future.done():
            return
        if error is not None:
            job.future.set_exception(error)
        else:
            job.future.set_result(result)

    _call_soon(job.loop, settle)


def _call_soon(loop: asyncio.AbstractEventLoop, call: Callable[[], None]) -> None:
    try:
        loop.call_soon_threadsafe(call)
    except RuntimeError:  # the loop was closed
        pass
