"""The worker pool: order, limits, deadlines, cancelled callers and shutdown."""

import asyncio
import contextvars
import gc
import os
import sys
import threading
import weakref
from functools import partial

import pytest
from structlog.testing import capture_logs

from gateway.runtime.workers.pool_errors import DeadlineExceeded, PoolClosed, QueueFull
from gateway.runtime.workers.scheduling import CAMERA_FIRST_NICENESS
from gateway.runtime.workers.worker_pool import WorkerPool
from renderers.compiler import pending
from renderers.raster.frame_threads import FrameThreads
from renderers.stop import check_stop
from tests.support.waiting import SECONDS, until


class Gate:
    """A call that says when it runs and waits until it may end."""

    def __init__(self) -> None:
        self.started = threading.Event()
        self.open = threading.Event()

    def __call__(self, value: object = None) -> object:
        self.started.set()
        assert self.open.wait(SECONDS)
        return value


async def started(gate: Gate) -> None:
    assert await asyncio.to_thread(gate.started.wait, SECONDS)


async def test_results_errors_keywords_and_context() -> None:
    variable = contextvars.ContextVar("variable", default="outside")
    workers = WorkerPool(2)
    variable.set("inside")

    def call(a: int, *, b: int) -> tuple[int, str, bool]:
        return a + b, variable.get(), threading.current_thread() is threading.main_thread()

    assert await workers.run(call, 1, b=2) == (3, "inside", False)
    with pytest.raises(ZeroDivisionError):
        await workers.run(lambda: 1 // 0)
    with pytest.raises(RuntimeError, match="StopIteration"):
        await workers.run(lambda: next(iter(())))
    assert await workers.close()
    assert workers.stats.done == 3


async def test_a_call_without_enough_memory_may_be_tried_again() -> None:
    def allocate() -> None:
        raise MemoryError("Unable to allocate 9 GiB")

    workers = WorkerPool(1)
    with capture_logs() as log, pytest.raises(QueueFull, match=r"^the memory is full; try again in 5 s$"):
        await workers.run(allocate)
    assert log[0]["reason"] == "Unable to allocate 9 GiB"
    assert await workers.run(lambda: 7) == 7


async def test_first_come_first_served_with_limited_threads() -> None:
    workers, order, lock, running, most = WorkerPool(2), [], threading.Lock(), 0, 0
    gates = Gate(), Gate()
    held = [asyncio.create_task(workers.run(gate)) for gate in gates]
    for gate in gates:
        await started(gate)

    def call(number: int) -> None:
        nonlocal running, most
        with lock:
            running += 1
            most = max(most, running)
            order.append(number)
        with lock:
            running -= 1

    waiting = [asyncio.create_task(workers.run(call, number)) for number in range(20)]
    await until(lambda: workers.stats.waiting == 20)
    assert workers.calls == 22
    gates[0].open.set()  # one thread works through the queue, in order, while the other is held
    await asyncio.gather(*waiting)
    assert order == list(range(20))
    assert most == 1
    gates[1].open.set()
    await asyncio.gather(*held)
    assert workers.calls == 0
    assert await workers.close()


@pytest.mark.parametrize(("threads", "max_waiting"), [(1, 2), (2, 0)])
async def test_rejects_beyond_the_number_of_waiting_calls(threads: int, max_waiting: int) -> None:
    workers, gate = WorkerPool(threads, max_waiting=max_waiting), Gate()
    tasks = [asyncio.create_task(workers.run(gate)) for _ in range(threads + max_waiting)]
    await started(gate)
    await until(lambda: workers.stats.waiting == max_waiting)
    with pytest.raises(QueueFull, match=f"the limit is {max_waiting}") as busy:
        await workers.run(gate)
    assert busy.value.retry_after >= 1
    assert workers.stats.rejected == 1
    gate.open.set()
    await asyncio.gather(*tasks)
    await workers.run(gate)
    assert await workers.close()


async def test_rejects_beyond_the_bytes_except_for_a_single_call() -> None:
    workers, gate = WorkerPool(1, max_waiting_bytes=100), Gate()
    tasks = [asyncio.create_task(workers.run(gate))]
    await started(gate)
    tasks.append(asyncio.create_task(workers.run(gate, nbytes=1000)))
    await until(lambda: workers.stats.waiting == 1)
    with pytest.raises(QueueFull, match="hold 1000 bytes; with 1 more they would exceed the limit of 100"):
        await workers.run(gate, nbytes=1)
    tasks[1].cancel()
    await until(lambda: workers.stats.waiting_bytes == 0)
    tasks.append(asyncio.create_task(workers.run(gate, nbytes=60)))
    tasks.append(asyncio.create_task(workers.run(gate, nbytes=40)))
    await until(lambda: workers.stats.waiting_bytes == 100)
    gate.open.set()
    await asyncio.gather(*tasks, return_exceptions=True)
    assert workers.stats.waiting_bytes == 0
    assert await workers.close()


async def test_cancelled_waiting_call_never_runs() -> None:
    workers, gate, calls = WorkerPool(1, max_waiting=1), Gate(), list[str]()
    held = asyncio.create_task(workers.run(gate))
    await started(gate)
    leaver = asyncio.create_task(workers.run(calls.append, "left", nbytes=7))
    await until(lambda: workers.stats.waiting == 1)
    leaver.cancel()
    with pytest.raises(asyncio.CancelledError):
        await leaver
    assert workers.stats.waiting == 0
    assert workers.stats.abandoned == 1
    stayer = asyncio.create_task(workers.run(calls.append, "stayed"))
    gate.open.set()
    await asyncio.gather(held, stayer)
    assert calls == ["stayed"]
    assert await workers.close()


async def test_thread_continues_after_a_cancelled_call() -> None:
    workers, gate = WorkerPool(1), Gate()
    leaver = asyncio.create_task(workers.run(gate))
    await started(gate)
    leaver.cancel()
    with pytest.raises(asyncio.CancelledError):
        await leaver
    assert workers.stats.running == 1
    gate.open.set()
    assert await workers.run(lambda: "next") == "next"
    assert workers.stats.done == 2
    assert await workers.close()


async def test_close_finishes_accepted_calls_and_ends_the_threads() -> None:
    before = set(threading.enumerate())
    workers, gate = WorkerPool(2, name="ending"), Gate()
    tasks = [asyncio.create_task(workers.run(gate, number)) for number in range(5)]
    await started(gate)
    closing = asyncio.create_task(workers.close(SECONDS))
    await asyncio.sleep(0)
    with pytest.raises(PoolClosed):
        await workers.run(gate)
    gate.open.set()
    assert await closing
    assert await asyncio.gather(*tasks) == list(range(5))
    for thread in set(threading.enumerate()) - before:
        if thread.name.startswith("ending"):
            thread.join(SECONDS)
            assert not thread.is_alive()
    assert await workers.close()


async def test_close_returns_false_at_its_limit() -> None:
    workers, gate = WorkerPool(1), Gate()
    running, waiting = (asyncio.create_task(workers.run(gate)) for _ in range(2))
    await started(gate)
    assert not await workers.close(0.0)
    with pytest.raises(PoolClosed, match="before the request's turn came"):
        await waiting
    gate.open.set()
    await running


class Endless:
    """A call that does nothing but look at its flag, until that is set."""

    def __init__(self) -> None:
        self.started = threading.Event()
        self.ended = threading.Event()

    def __call__(self) -> None:
        self.started.set()
        try:
            while True:
                check_stop()
        finally:
            self.ended.set()


async def test_deadline_excludes_waiting_time() -> None:
    workers = WorkerPool(1, seconds=0.2, limit_name="--render-seconds")
    calls = [asyncio.create_task(workers.run(Endless())) for _ in range(3)]
    last = asyncio.create_task(workers.run(lambda: "drawn"))  # it has waited for three deadlines
    for call in calls:
        with pytest.raises(DeadlineExceeded, match=r"--render-seconds = 0\.2 s"):
            await call
    assert await last == "drawn"
    assert (workers.stats.timed_out, workers.stats.done) == (3, 4)
    assert await workers.close()


def draw_normals() -> str:
    pending.wait_for_kernel("normals.first")
    return "drawn"


async def test_a_call_waits_for_kernels_without_a_thread_and_beyond_its_deadline() -> None:
    workers = WorkerPool(1, seconds=0.2)
    with pending.announced({"normals": lambda name: name.startswith("normals.")}):
        drawing = asyncio.create_task(workers.run(draw_normals))
        with pytest.raises(DeadlineExceeded):
            await workers.run(Endless())
        assert await workers.run(lambda: 7) == 7
        assert not drawing.done()
        pending.finish("normals")
        assert await drawing == "drawn"
    assert workers.stats.timed_out == 1
    assert await workers.close()


async def test_a_call_that_waits_for_kernels_ends_with_the_pool() -> None:
    workers = WorkerPool(1)
    with pending.announced({"normals": lambda name: name.startswith("normals.")}):
        drawing = asyncio.create_task(workers.run(draw_normals))
        await until(lambda: workers.stats.done == 1)
        assert await workers.close()
        with pytest.raises(PoolClosed):
            await drawing
        assert pending.is_pending("normals")


async def test_calls_that_wait_for_kernels_count_as_waiting() -> None:
    workers = WorkerPool(1, max_waiting=2)
    with pending.announced({"normals": lambda name: name.startswith("normals.")}):
        drawings = [asyncio.create_task(workers.run(draw_normals)) for _ in range(3)]
        await until(lambda: workers.stats.done == 3 and workers.stats.waiting == 2)
        with pytest.raises(QueueFull):
            await workers.run(draw_normals)
        pending.finish("normals")
        assert await asyncio.gather(*drawings) == ["drawn"] * 3
    assert await workers.run(draw_normals) == "drawn"
    assert await workers.close()


async def test_running_call_stops_when_its_caller_is_cancelled() -> None:
    workers, call = WorkerPool(1), Endless()
    leaver = asyncio.create_task(workers.run(call))
    assert await asyncio.to_thread(call.started.wait, SECONDS)
    leaver.cancel()
    with pytest.raises(asyncio.CancelledError):
        await leaver
    assert await asyncio.to_thread(call.ended.wait, SECONDS)
    assert await workers.run(lambda: "next") == "next"
    assert await workers.close()


async def test_close_stops_running_calls_at_its_limit() -> None:
    workers, call = WorkerPool(1, seconds=1000.0), Endless()
    running, waiting = (asyncio.create_task(workers.run(call)) for _ in range(2))
    assert await asyncio.to_thread(call.started.wait, SECONDS)
    assert await workers.close(0.1)
    for task in (running, waiting):
        with pytest.raises(PoolClosed, match="shut down"):
            await task


async def test_slow_calls_are_counted() -> None:
    workers, gate = WorkerPool(2, seconds=0.02), Gate()  # which does not look at its flag
    patient = WorkerPool(1)  # without a deadline, no call is slow
    calls = [asyncio.create_task(workers.run(gate, 1)), asyncio.create_task(patient.run(gate))]
    await until(lambda: workers.stats.slow == 1)
    assert not workers.busy
    calls.append(asyncio.create_task(workers.run(gate, 2)))
    await until(lambda: workers.busy)
    assert (patient.stats.slow, patient.busy) == (0, False)
    gate.open.set()
    assert await asyncio.gather(*calls) == [1, None, 2]
    assert workers.stats.slow == 0
    assert not workers.busy
    assert await workers.close()
    assert await patient.close()


async def test_finished_calls_are_released() -> None:
    class Body:
        pass

    def fail(body: object) -> None:
        raise ValueError("no")

    workers = WorkerPool(1)
    body = Body()
    watched = weakref.ref(body)
    await workers.run(lambda _: None, body)
    try:
        await workers.run(fail, body)
    except ValueError:
        pass
    del body
    gc.collect()
    await workers.run(lambda: None)  # the thread has let go of the job before when it takes the next
    assert watched() is None
    assert await workers.close()


def test_pool_outlives_event_loops() -> None:
    workers = WorkerPool(1)
    for _ in range(2):
        assert asyncio.run(workers.run(lambda: 5)) == 5
    gate = Gate()

    async def leave() -> None:
        task = asyncio.create_task(workers.run(gate))
        await started(gate)
        task.cancel()

    asyncio.run(leave())
    gate.open.set()  # the result has no loop to go to any more
    assert asyncio.run(workers.run(lambda: 6)) == 6
    assert asyncio.run(workers.close())


def test_arguments_are_validated() -> None:
    for arguments in ({"threads": 0}, {"max_waiting": -1}, {"seconds": 0.0}):
        with pytest.raises(ValueError, match="at least one thread"):
            WorkerPool(**arguments)
    assert WorkerPool().threads >= 1


def own_niceness() -> int:
    return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux gives every thread a priority")
async def test_niceness_of_workers_and_frame_threads() -> None:
    def draw() -> set[int]:
        crew, seen, meeting = FrameThreads(2), set[int](), threading.Barrier(2)

        def work(_: int) -> None:
            seen.add(own_niceness())
            meeting.wait(SECONDS)

        crew.run(2, work)
        crew.close()
        return seen

    own = own_niceness()
    workers = WorkerPool(1, niceness=3)
    assert await workers.run(draw) == {min(19, own + 3)}
    assert own_niceness() == own
    assert await workers.close()


async def test_what_a_failed_call_used_is_freed_while_its_error_is_kept() -> None:
    """A stopped request may have gigabytes in its frames, and errors stay alive in tracebacks and futures."""

    class Body:
        pass

    used: list[weakref.ref[Body]] = []

    def fail() -> None:
        body = Body()
        used.append(weakref.ref(body))
        raise ValueError("the body is wrong")

    pool = WorkerPool(1)
    with pytest.raises(ValueError, match="is wrong") as kept:
        await pool.run(fail)
    assert used[0]() is None
    assert kept.value.__traceback__ is not None
    await pool.close()


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux gives every thread a priority")
async def test_threads_give_way_while_a_camera_streams() -> None:
    own = own_niceness()
    workers, gate, threads = WorkerPool(1), Gate(), list[int]()

    def running() -> object:
        threads.append(threading.get_native_id())
        return gate()

    call = asyncio.create_task(workers.run(running))
    await started(gate)
    niceness, lower = partial(os.getpriority, os.PRIO_PROCESS), min(19, own + CAMERA_FIRST_NICENESS)
    assert niceness(threads[0]) == own
    for key in ("left", "left", "right"):
        workers.give_way(key, active=True)
    assert niceness(threads[0]) == lower, "in the middle of a call"
    workers.give_way("left", active=False)
    assert niceness(threads[0]) == lower, "one still streams"
    workers.give_way("right", active=False)
    assert await workers.run(own_niceness) == own, "another thread, while the old one is in its call"
    gate.open.set()
    await call
    assert await workers.run(own_niceness) == own
    workers.give_way("left", active=True)
    assert await workers.run(own_niceness) == lower, "an idle thread"
    workers.give_way("left", active=False)
    assert [await workers.run(own_niceness) for _ in range(3)] == [own] * 3
    assert await workers.close()


async def test_no_call_is_lost_or_run_twice_while_priorities_change() -> None:
    workers, done = WorkerPool(2), list[int]()
    calls = [asyncio.create_task(workers.run(done.append, number)) for number in range(200)]
    for turn in range(200):
        workers.give_way("camera", active=turn % 2 == 0)
        await asyncio.sleep(0)
    await asyncio.gather(*calls)
    assert sorted(done) == list(range(200))
    assert await workers.close()
