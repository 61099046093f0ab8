"""Alarms: they ring in time, unless they were called off, and one timer does for all."""

from __future__ import annotations

import asyncio
import gc
import weakref
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from gateway.server.alarms import Alarms, alarms_of


class Loop:
    """An event loop's clock and timers, moved by hand."""

    def __init__(self) -> None:
        self.now = 100.0
        self.timers: list[Timer] = []
        self.made = 0

    def time(self) -> float:
        return self.now

    def call_at(self, when: float, call: Callable[..., object], *args: Any) -> Timer:
        self.made += 1
        self.timers.append(Timer(self, when, call, args))
        return self.timers[-1]

    def call_later(self, seconds: float, call: Callable[..., object], *args: Any) -> Timer:
        return self.call_at(self.now + seconds, call, *args)

    def call_soon(self, call: Callable[..., object], *args: Any) -> None:
        call(*args)

    def until(self, when: float) -> None:
        while due := [timer for timer in self.timers if timer.when <= when]:
            first = min(due, key=lambda timer: timer.when)
            self.timers.remove(first)
            self.now = max(self.now, first.when)
            first.call(*first.args)
        self.now = when


class Timer:
    def __init__(self, loop: Loop, when: float, call: Callable[..., object], args: tuple[Any, ...]) -> None:
        self.loop, self.when, self.call, self.args = loop, when, call, args

    def cancel(self) -> None:
        self.loop.timers.remove(self)


@pytest.fixture
def loop() -> Loop:
    return Loop()


@pytest.fixture
def alarms(loop: Loop) -> Alarms:
    return Alarms(loop)  # type: ignore[arg-type]  # as much of one as is asked for


def test_they_ring_in_order_never_early_and_hardly_late(loop: Loop, alarms: Alarms) -> None:
    rung: list[tuple[str, float]] = []

    def ring(name: str) -> None:
        rung.append((name, loop.now))

    for name, seconds in (("late", 90.0), ("soon", 10.1), ("between", 30.0), ("with soon", 10.1), ("at once", 0.5)):
        alarms.later(seconds, ring, name)
    loop.until(300.0)
    assert [name for name, _ in rung] == ["at once", "soon", "with soon", "between", "late"]
    for (_, when), seconds in zip(rung, (0.5, 10.1, 10.1, 30.0, 90.0), strict=True):
        assert 0.0 <= when - 100.0 - seconds <= 0.25
    assert loop.timers == []


def test_those_that_were_called_off_do_not_ring(loop: Loop, alarms: Alarms) -> None:
    rung: list[int] = []
    handles = [alarms.later(seconds, rung.append, number) for number, seconds in enumerate((5.0, 5.0, 1.0, 1.0))]
    handles[0].cancel()
    handles[0].cancel()
    handles[2].cancel()
    loop.until(200.0)
    assert rung == [3, 1]
    handles[1].cancel()


def test_one_timer_does_for_all(loop: Loop, alarms: Alarms) -> None:
    for _ in range(1000):
        alarms.later(30.0, pytest.fail).cancel()
        alarms.later(90.0, pytest.fail).cancel()
    assert len(loop.timers) == loop.made == 1
    loop.until(300.0)
    assert loop.timers == []


def test_an_earlier_one_and_one_that_an_alarm_sets(loop: Loop, alarms: Alarms) -> None:
    rung: list[float] = []

    def again() -> None:
        rung.append(loop.now)
        if len(rung) < 3:
            alarms.later(10.0, again)

    alarms.later(90.0, rung.append, -1.0)
    alarms.later(10.0, again)
    loop.until(400.0)
    assert len(rung) == 4
    assert rung[3] == -1.0
    assert rung[2] - 100.0 <= 30.75


def test_a_loop_has_one() -> None:
    async def mine() -> Alarms:
        found = alarms_of(asyncio.get_running_loop())
        assert alarms_of(asyncio.get_running_loop()) is found
        return found

    assert asyncio.run(mine()) is not asyncio.run(mine())


def test_closed_loops_are_not_kept_once_there_is_another() -> None:
    async def mine() -> weakref.ref[asyncio.AbstractEventLoop]:
        alarms_of(asyncio.get_running_loop()).later(30.0, pytest.fail)
        return weakref.ref(asyncio.get_running_loop())

    loops = [asyncio.run(mine()) for _ in range(3)]
    gc.collect()
    assert [loop() is None for loop in loops[:2]] == [True, True]


def test_one_that_is_called_off_in_the_step_that_rings_it_is_silent(
    loop: Loop, alarms: Alarms, monkeypatch: pytest.MonkeyPatch
) -> None:
    soon: list[Callable[[], object]] = []
    monkeypatch.setattr(loop, "call_soon", lambda call, *args: soon.append(partial(call, *args)))
    rung: list[int] = []
    handles = [alarms.later(5.0, rung.append, number) for number in range(2)]
    loop.until(200.0)
    handles[0].cancel()
    for call in soon:
        call()
    assert rung == [1]
