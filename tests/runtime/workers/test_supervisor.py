"""The supervisor's decisions, with processes and a clock of the test; tests/e2e/test_workers.py has real ones."""

from __future__ import annotations

import asyncio
import os
import signal
import threading
from collections.abc import Callable, Iterator
from functools import partial
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from types import SimpleNamespace

import pytest
from structlog.testing import capture_logs

from gateway.runtime.workers import supervisor
from gateway.runtime.workers.supervisor import KILL_SECONDS, READY_SECONDS, START_FAILED, Supervisor, send_heartbeats
from tests.support.waiting import until

UNRESPONSIVE_SECONDS = 5.0
STOP_SECONDS = 2.0

Story = Iterator[None]
"""Code of a test that runs in the supervisor's polls, one step each."""


class FakeProcess:
    """A process that ends when the test, SIGTERM or SIGKILL says so."""

    def __init__(self, machine: Machine, target: object, args: tuple[Connection]) -> None:
        self._machine = machine
        self._connection = args[0]
        self.pid = 100 + len(machine.processes)
        self.exitcode: int | None = None
        self.signals: list[str] = []
        self.beats = self.hangs = False
        self.sentinel = -1
        self.polls_until_end = 0
        """Polls until the system has ended it after SIGKILL; 0: it got none."""

    def start(self) -> None:
        if self._machine.refused:
            self._machine.refused -= 1
            raise OSError(11, "Resource temporarily unavailable")
        self._connection = Connection(os.dup(self._connection.fileno()), readable=False)
        self._machine.processes.append(self)

    def send(self, ready: bool) -> None:
        """Send heartbeats from now on."""
        self.beats = True
        self._connection.send(ready)

    def end(self, exit_code: int) -> None:
        self.exitcode, self.beats = exit_code, False
        self._connection.close()

    def terminate(self) -> None:
        self.signals.append("SIGTERM")
        if not self.hangs and self.exitcode is None:
            self.end(0)

    def kill(self) -> None:
        self.signals.append("SIGKILL")
        self.polls_until_end = self.polls_until_end or 3

    def close(self) -> None:
        assert self.exitcode is not None


class Machine:
    """Clock and processes of the test."""

    def __init__(self) -> None:
        self.now = 1000.0
        self.processes: list[FakeProcess] = []
        self.refused = 0
        """Number of further starts that fail."""
        self._story: Story = iter(())
        self._has_ended = False

    def poll(self, sentinels: list[int], seconds: float) -> list[int]:
        """Take the place of ``multiprocessing.connection.wait``: do the next step, and end the supervisor after all."""
        self.now += seconds
        for process in self.running():
            if process.beats:
                process.send(True)
            if process.polls_until_end == 1:
                process.end(-signal.SIGKILL)
            process.polls_until_end -= process.polls_until_end > 0
        if not self._has_ended and next(self._story, self) is self:
            self._has_ended = True
            signal.raise_signal(signal.SIGTERM)
        return []

    def sleep(self, seconds: float) -> None:
        self.now += seconds

    def running(self) -> list[FakeProcess]:
        return [process for process in self.processes if process.exitcode is None]

    def after(self, seconds: float) -> Story:
        """Do nothing for a time."""
        end = self.now + seconds
        while self.now < end:
            yield

    def all_ready(self) -> Story:
        for process in self.running():
            process.send(True)
        yield
        yield

    def supervise(self, story: Callable[[], Story], count: int = 2) -> tuple[bool, list[str]]:
        """Run the supervisor until the story ends; return its result, and the events of its log."""
        self._story = story()
        with capture_logs() as log:
            works = Supervisor(print, count, unresponsive_seconds=UNRESPONSIVE_SECONDS, stop_seconds=STOP_SECONDS).run()
        assert not self.running()
        return works, [entry["event"] for entry in log]


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Iterator[Machine]:
    machine = Machine()
    context = SimpleNamespace(Process=lambda target, args: FakeProcess(machine, target, args))
    monkeypatch.setattr("multiprocessing.get_context", lambda method: context)
    monkeypatch.setattr(supervisor, "wait", machine.poll)
    monkeypatch.setattr(supervisor, "time", SimpleNamespace(monotonic=lambda: machine.now, sleep=machine.sleep))
    handlers = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)}
    yield machine
    for number, handler in handlers.items():
        signal.signal(number, handler)


def test_a_process_that_ends_is_replaced_and_a_signal_ends_all(machine: Machine) -> None:
    def story() -> Story:
        yield from machine.all_ready()
        assert [process.pid for process in machine.running()] == [100, 101]
        machine.processes[0].end(-signal.SIGSEGV)
        yield
        yield
        assert [process.pid for process in machine.running()] == [101, 102]

    works, events = machine.supervise(story)
    assert works
    assert events == ["A process has ended"]
    assert [process.signals for process in machine.processes] == [[], ["SIGTERM"], ["SIGTERM"]]


def test_a_process_without_heartbeats_is_killed_once_and_replaced(machine: Machine) -> None:
    def story() -> Story:
        yield from machine.all_ready()
        hung = machine.processes[0]
        hung.beats = False
        yield from machine.after(UNRESPONSIVE_SECONDS - 1.0)
        assert not hung.signals
        yield from machine.after(2.0)
        assert hung.signals == ["SIGKILL"]
        assert [process.pid for process in machine.running()] == [101, 102]

    works, events = machine.supervise(story)
    assert works
    assert events == ["A process does not respond and is killed", "A process has ended"]


def test_a_process_has_longer_for_its_first_heartbeat(machine: Machine) -> None:
    def story() -> Story:
        (process,) = machine.processes
        yield from machine.after(READY_SECONDS + UNRESPONSIVE_SECONDS - 1.0)
        assert not process.signals
        yield from machine.after(2.0)
        assert process.signals == ["SIGKILL"]

    assert machine.supervise(story, count=1)[0]


def test_all_end_if_none_can_start(machine: Machine) -> None:
    def story() -> Story:
        machine.processes[0].end(START_FAILED)
        yield from machine.after(1.0)

    works, events = machine.supervise(story)
    assert not works
    assert events == ["A process has ended", "No process can start, so all end"]
    assert len(machine.processes) == 2


def test_a_process_that_cannot_start_beside_a_ready_one_is_tried_again(machine: Machine) -> None:
    def story() -> Story:
        machine.processes[1].send(True)
        yield
        yield
        machine.processes[0].end(START_FAILED)
        yield
        yield
        assert [process.pid for process in machine.running()] == [101, 102]

    assert machine.supervise(story)[0]


def test_a_start_without_resources_is_tried_again(machine: Machine) -> None:
    machine.refused = 2

    def story() -> Story:
        yield
        yield
        assert len(machine.running()) == 2

    works, events = machine.supervise(story)
    assert works
    assert events == ["A process could not be started, which is tried again"] * 2


def test_sighup_replaces_processes_one_after_the_other(machine: Machine) -> None:
    def story() -> Story:
        yield from machine.all_ready()
        signal.raise_signal(signal.SIGHUP)
        for new in (102, 103):
            yield from machine.after(0.5)
            assert machine.processes[-1].pid == new
            assert len(machine.running()) == 3, "the old ones serve until the new one is ready"
            machine.processes[-1].send(True)
            yield
            yield
            assert len(machine.running()) >= 2
        yield from machine.after(0.5)
        assert [process.pid for process in machine.running()] == [102, 103]

    works, events = machine.supervise(story)
    assert works
    assert events == ["All processes are replaced"]


@pytest.mark.parametrize("handler", [signal.SIG_IGN, signal.SIG_DFL])
def test_the_end_of_the_terminal_ends_all_except_under_nohup(
    machine: Machine, monkeypatch: pytest.MonkeyPatch, handler: signal.Handlers
) -> None:
    has_ended = threading.Event()
    monkeypatch.setattr(supervisor, "_is_terminal_open", lambda: not has_ended.is_set())
    signal.signal(signal.SIGHUP, handler)

    def story() -> Story:
        yield from machine.all_ready()
        has_ended.set()
        signal.raise_signal(signal.SIGHUP)
        yield from machine.after(1.0)

    works, events = machine.supervise(story)
    assert works
    assert events == (["All processes are replaced"] if handler is signal.SIG_IGN else [])


@pytest.mark.parametrize("ends", [True, False])
def test_the_old_processes_stay_if_a_new_one_ends_or_is_late(machine: Machine, ends: bool) -> None:
    def story() -> Story:
        yield from machine.all_ready()
        signal.raise_signal(signal.SIGHUP)
        yield from machine.after(0.5)
        new = machine.processes[2]
        if ends:
            new.end(1)
        yield from machine.after(0.5 if ends else READY_SECONDS)
        assert new.exitcode is not None
        assert [process.pid for process in machine.running()] == [100, 101]
        assert not machine.processes[0].signals

    works, events = machine.supervise(story)
    assert works
    assert events == ["All processes are replaced", "A new process is not ready; the old ones stay"] + (
        ["A process has ended"] if ends else []
    )


def test_a_process_that_does_not_end_in_time_is_killed(machine: Machine) -> None:
    def story() -> Story:
        machine.processes[0].hangs = True
        yield

    works, events = machine.supervise(story)
    assert works
    assert events == ["A process has not ended in time and is killed"]
    assert machine.processes[0].signals == ["SIGTERM", "SIGKILL"]
    assert machine.now >= 1000.0 + STOP_SECONDS + KILL_SECONDS


async def test_heartbeats_tell_whether_the_process_is_ready(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervisor, "BEAT_SECONDS", 0.0)
    ready: list[bool] = []
    ours, theirs = Pipe(duplex=False)
    with ours, theirs:
        beats = asyncio.create_task(send_heartbeats(theirs, partial(bool, ready)))
        await until(ours.poll)
        assert ours.recv() is False
        ready.append(True)
        await until(lambda: ours.poll() and ours.recv())
        ours.close()  # the supervisor ends, and the process goes on
        for _ in range(3):
            await asyncio.sleep(0)
        assert not beats.done()
        beats.cancel()
