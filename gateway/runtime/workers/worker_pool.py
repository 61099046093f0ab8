"""Thread pool with a bounded queue: takes work off the event loop (docs/decisions/0005-work-off-the-loop.md).

Calls run first come, first served. Waiting is normal, since Drake's client never retries, so the queue is long; beyond
its limits a call is rejected at once. Each call has a ``StopFlag``, which is set at its deadline, when its caller is
cancelled, and at shutdown.

Cameras have a pool of their own, so that their calls never wait for batch renders. While a camera streams, the threads
of the other pool have a higher niceness (``give_way``): the system interrupts them, even in a call, for the time that
cameras need.
"""

from __future__ import annotations

import asyncio
import contextvars
import math
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final, ParamSpec, TypeVar

import structlog
from opentelemetry import trace

from gateway.runtime.logs import tracing
from gateway.runtime.workers.pool_errors import CallerCancelled, DeadlineExceeded, PoolClosed, QueueFull
from gateway.runtime.workers.scheduling import CAMERA_FIRST_NICENESS, raise_niceness, usable_cpus, yield_to_event_loop
from renderers.compiler.pending import KernelsPending, is_compiling
from renderers.stop import StopFlag

_log = structlog.get_logger("gateway")

P = ParamSpec("P")
T = TypeVar("T")

MAX_RETRY_AFTER: Final = 60
"""Maximum Retry-After in seconds; longer estimates are not reliable."""
MEMORY_RETRY_SECONDS: Final = 5
"""Retry-After in seconds where memory is short."""
STOPPING_SECONDS: Final = 0.5
"""Time in which a call whose stop flag was set ends."""
_POLL_SECONDS: Final = 0.1
"""Time between two looks at kernels that are being compiled."""
_SMOOTHING: Final = 0.1
"""Weight of the newest duration in the moving average behind ``Retry-After``."""


async def until_compiled(*parts: str) -> None:
    """Return once none of these parts of the kernels is being compiled."""
    while any(is_compiling(part) for part in parts):  # noqa: ASYNC110 - other threads load them
        await asyncio.sleep(_POLL_SECONDS)


@dataclass(frozen=True, slots=True)
class PoolStats:
    """Consistent snapshot of a pool."""

    running: int
    waiting: int
    waiting_bytes: int
    done: int
    """Calls that returned or failed since start."""
    rejected: int
    """Calls rejected with ``QueueFull``."""
    abandoned: int
    """Calls whose caller was cancelled before the result."""
    slow: int
    """Running calls that have used more than half of their time."""
    timed_out: int
    """Calls ended at their deadline."""


@dataclass(slots=True, eq=False)
class _Call:
    function: Callable[[], Any]
    nbytes: int
    future: asyncio.Future[Any]
    """Belongs to the event loop of the caller."""
    context: contextvars.Context = field(default_factory=contextvars.copy_context)
    stop: StopFlag = field(default_factory=partial(StopFlag, waits=False))
    queue_span: trace.Span = trace.INVALID_SPAN
    started: float = 0.0
    """Monotonic time at which the call began to run, seconds."""

    def end(self, result: Any, error: BaseException | None) -> None:
        """Give the caller the result or the error, from any thread."""
        with suppress(RuntimeError):  # its event loop has ended
            self.future.get_loop().call_soon_threadsafe(_resolve, self.future, result, error)


def _resolve(future: asyncio.Future[Any], result: Any, error: BaseException | None) -> None:
    if future.done():  # cancelled
        return
    if error is None:
        future.set_result(result)
    else:
        future.set_exception(error)


class WorkerPool:
    """Runs functions in daemon threads, which start on demand. Callers may live in different event loops."""

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
            threads: maximum number of running calls; None: one per CPU that this process may use.
            max_waiting: maximum number of calls that wait for a thread; each keeps its request in memory.
            max_waiting_bytes: maximum of the sum of their ``nbytes``. A call with more may wait if no other does, so
                that no request is impossible.
            name: name of the threads, for debuggers.
            niceness: niceness of the threads, relative to the process.
            seconds: time limit of a running call, without its time in the queue and in ``StopFlag.waiting``; None: no
                limit.
            limit_name: name of ``seconds`` in error messages.
        """
        self.threads = threads if threads is not None else usable_cpus()
        if self.threads < 1 or max_waiting < 0 or max_waiting_bytes < 0 or (seconds is not None and seconds <= 0):
            raise ValueError("a worker pool needs at least one thread, no negative limits, and positive seconds")
        self.max_waiting = max_waiting
        self.max_waiting_bytes = max_waiting_bytes
        self.seconds = seconds
        self._name = name
        self._niceness = self._own_niceness = niceness
        """Niceness of the threads now, and while they give way to nothing."""
        self._priorities: set[object] = set()
        """Keys of ``give_way``."""
        self._threads: dict[threading.Thread, int] = {}
        """Niceness of each thread that has not ended. One whose niceness is too high ends after its current call."""
        self._limit_name = limit_name
        self._lock = threading.Lock()
        self._wakeup = threading.Condition(self._lock)
        """Notified when there is a call to run, or the pool is closing."""
        self._waiting: deque[_Call] = deque()
        self._waiting_bytes = 0
        self._deferred = 0
        """Number of calls that wait for kernels."""
        self._running: set[_Call] = set()
        self._all_ended = threading.Event()
        self._closing = self._watching = False
        self._done = self._rejected = self._abandoned = self._timed_out = 0
        self._mean_seconds = 0.0

    async def run(  # type: ignore[valid-type]  # PEP 612 has no place for nbytes
        self, fn: Callable[P, T], *args: P.args, nbytes: int = 0, **kwargs: P.kwargs
    ) -> T:
        """Call ``fn`` in a thread, with the caller's context variables, and return its result, or raise its error.

        When the caller is cancelled, a waiting call is dropped, and a running one gets its stop flag set. A call that
        needs kernels that are being compiled ends, and is repeated afterwards: it must not occupy a thread meanwhile.
        ``nbytes`` is the memory that the call keeps in use while it waits.

        Raises QueueFull if too many calls are waiting, or memory was short; PoolClosed after ``close``;
        DeadlineExceeded if ``fn`` checked its stop flag (``renderers.stop``) after its time was over.
        """
        function = partial(fn, *args, **kwargs)
        while True:
            call = _Call(function, nbytes, asyncio.get_running_loop().create_future())
            if (
                tracing.provider() is not None and trace.get_current_span().is_recording()
            ):  # the span of the queue would be alone otherwise
                call.queue_span = tracing.tracer.start_span("queue")
            self._submit(call)
            try:
                result: T = await call.future
                return result
            except asyncio.CancelledError:
                self._abandon(call)
                raise
            except KernelsPending as pending:
                part = pending.part
            finally:
                del call  # a traceback must not keep the request alive in a reference cycle
            self._deferred += 1
            try:
                while is_compiling(part) and not self._closing:  # then ``_submit`` raises PoolClosed  # noqa: ASYNC110
                    await asyncio.sleep(_POLL_SECONDS)
            finally:
                self._deferred -= 1

    def _submit(self, call: _Call) -> None:
        """Queue a call. Raises PoolClosed or QueueFull."""
        with self._lock:
            if self._closing:
                raise PoolClosed("the server is shutting down")
            if self.calls + self._deferred >= self.threads:
                waiting = self._queue_length()
                if waiting >= self.max_waiting:
                    raise self._queue_full(waiting)
                if self._waiting and self._waiting_bytes + call.nbytes > self.max_waiting_bytes:
                    reason = (
                        f"the waiting requests hold {self._waiting_bytes} bytes; with {call.nbytes} more "
                        f"they would exceed the limit of {self.max_waiting_bytes}"
                    )
                    raise self._queue_full(waiting, reason=reason)
            self._waiting.append(call)
            self._waiting_bytes += call.nbytes
            self._start_threads()
            self._wakeup.notify()

    def give_way(self, key: object, *, active: bool) -> None:
        """Let other threads of the process run first, from now until a call with the same key and ``active=False``.

        Running calls give way at once. Afterwards the threads end with their call, and new ones start: lowering the
        niceness of a thread needs privileges. Called on the event loop, whose niceness new threads inherit.
        """
        if active == (key in self._priorities):
            return
        with self._lock:
            self._priorities ^= {key}
            self._niceness = max(self._own_niceness, CAMERA_FIRST_NICENESS if self._priorities else 0)
            for thread, niceness in self._threads.items():
                if niceness < self._niceness:
                    raise_niceness(thread.native_id or 0, self._niceness)
                    self._threads[thread] = self._niceness
            self._start_threads()
            self._wakeup.notify_all()

    @property
    def calls(self) -> int:
        """Number of running and waiting calls."""
        return len(self._running) + len(self._waiting)

    def spare_threads(self, cameras: WorkerPool, frame_threads: int) -> int:
        """Return the number of threads that no call needs, of this pool and those for one image beyond.

        Calls of ``cameras`` come first. ``frame_threads``: maximum for one image; 0: the threads of this pool.
        """
        return max(0, self.threads - self.calls - cameras.calls) + max(0, frame_threads - self.threads)

    @property
    def busy(self) -> bool:
        """True while a further call would be rejected, or all threads run calls that have used half of their time."""
        stats = self.stats
        is_full = stats.waiting >= self.max_waiting and stats.running >= self.threads
        return is_full or stats.slow >= self.threads

    def check_capacity(self, arriving: int) -> None:
        """Raise QueueFull, counted as a rejected call, if no call could be queued behind ``arriving`` others not
        submitted yet."""
        with self._lock:
            waiting = self.calls + self._deferred + arriving - self.threads
            if waiting >= self.max_waiting:
                raise self._queue_full(waiting, arriving)

    @property
    def stats(self) -> PoolStats:
        """Snapshot of the counters."""
        with self._lock:
            now, slow_seconds = time.monotonic(), self.seconds / 2 if self.seconds is not None else math.inf
            return PoolStats(
                running=len(self._running),
                waiting=self._queue_length(),
                waiting_bytes=self._waiting_bytes,
                done=self._done,
                rejected=self._rejected,
                abandoned=self._abandoned,
                slow=sum([now - call.started > slow_seconds for call in self._running]),
                timed_out=self._timed_out,
            )

    async def close(self, limit: float = 10.0) -> bool:
        """Reject new calls, finish the accepted ones, end the threads; return True if all ended within the limits.

        ``limit`` seconds later, waiting calls fail with ``PoolClosed`` and running ones are stopped with it. Threads
        whose calls do not check their stop flag within ``STOPPING_SECONDS`` more are left running.
        """
        with self._lock:
            self._closing = True
            self._wakeup.notify_all()
            if not self._threads:
                self._all_ended.set()
        if await asyncio.to_thread(self._all_ended.wait, limit):
            return True
        with self._lock:
            waiting, running = tuple(self._waiting), tuple(self._running)
            self._waiting.clear()
            self._waiting_bytes = 0
        for call in waiting:
            call.end(None, PoolClosed("the server shut down before the request's turn came"))
        for call in running:
            call.stop.set(PoolClosed("the server shut down before the result was ready"))
        return await asyncio.to_thread(self._all_ended.wait, STOPPING_SECONDS)

    def _queue_length(self) -> int:
        """Return the number of calls that no idle thread is about to take."""
        return max(0, len(self._waiting) + self._deferred - (self.threads - len(self._running)))

    def _queue_full(self, waiting: int, arriving: int = 0, reason: str = "") -> QueueFull:
        if not reason:
            part = f" ({arriving} of them still arriving)" if arriving else ""
            reason = f"{waiting} requests are waiting already{part}, the limit is {self.max_waiting}"
        self._rejected += 1
        seconds = math.ceil((waiting + 1) * self._mean_seconds / self.threads)
        return QueueFull(reason, min(max(1, seconds), MAX_RETRY_AFTER))

    def _abandon(self, call: _Call) -> None:
        with self._lock:
            self._abandoned += 1
            if call in self._waiting:
                self._waiting.remove(call)
                self._waiting_bytes -= call.nbytes
            else:
                call.stop.set(CallerCancelled("the caller was cancelled"))

    def _start_threads(self) -> None:
        usable = [thread for thread, niceness in self._threads.items() if niceness <= self._niceness]
        for _ in range(len(usable), min(self.threads, self.calls)):
            thread = threading.Thread(target=self._work, name=f"{self._name}-{len(self._threads) + 1}", daemon=True)
            thread.start()
            self._threads[thread] = self._niceness
        if self.seconds is not None and not self._watching:
            self._watching = True
            name = f"{self._name}-deadlines"
            threading.Thread(target=self._enforce_deadlines, args=(self.seconds,), name=name, daemon=True).start()

    def _work(self) -> None:
        """Body of a worker thread."""
        thread = threading.current_thread()
        with self._lock:
            yield_to_event_loop(self._threads[thread])
        while (call := self._next_call(thread)) is not None:
            result: Any = None
            error: BaseException | None = None
            try:
                result = call.context.run(call.stop.run, call.function)
            except StopIteration as raised:  # a future cannot carry it
                error = RuntimeError(f"StopIteration escaped: {raised}")
            except MemoryError as raised:
                error = QueueFull("the memory is full", MEMORY_RETRY_SECONDS)
                _log.warning("A call ran out of memory", reason=str(raised))
            except BaseException as raised:  # noqa: BLE001 - the caller gets it
                error = raised
                traceback.clear_frames(raised.__traceback__)  # their arrays would live as long as the exception
            seconds = time.monotonic() - call.started
            with self._lock:
                self._running.remove(call)
                self._done += 1
                self._mean_seconds += (seconds - self._mean_seconds) * (_SMOOTHING if self._mean_seconds else 1.0)
            call.end(result, error)
            del call, result, error

    def _next_call(self, thread: threading.Thread) -> _Call | None:
        """Wait for a call and mark it as running; None: the thread must end, or no call of a closing pool is left."""
        with self._wakeup:
            while True:
                while not self._waiting and self._threads[thread] <= self._niceness:
                    if self._closing:
                        self._remove(thread)
                        return None
                    self._wakeup.wait()
                if self._threads[thread] > self._niceness:
                    self._remove(thread)
                    return None
                call = self._waiting.popleft()
                self._waiting_bytes -= call.nbytes
                call.queue_span.end()
                call.started = time.monotonic()
                self._running.add(call)
                return call

    def _remove(self, thread: threading.Thread) -> None:
        """Count a thread as ended. The lock is held since the decision: ``give_way`` must not count on the thread."""
        del self._threads[thread]
        if not self._threads and self._closing:
            self._all_ended.set()

    def _enforce_deadlines(self, seconds: float) -> None:
        """Body of the thread that sets the stop flags of calls that have run for ``seconds``.

        It sleeps until the earliest deadline. A call that starts meanwhile has a later one.
        """
        pause = seconds
        while not self._all_ended.wait(pause):
            now, pause = time.monotonic(), seconds
            with self._lock:
                for call in self._running:
                    left = seconds - (now - call.started)
                    if left > 0.0:
                        pause = min(pause, left)
                    elif not call.stop.is_set:
                        self._timed_out += 1
                        call.stop.set(DeadlineExceeded(f"it took longer than {self._limit_name} = {seconds:g} s"))
