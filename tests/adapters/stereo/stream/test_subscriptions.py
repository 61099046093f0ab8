"""Mailboxes of subscriptions, without a server."""

import asyncio
import weakref
from contextlib import ExitStack

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.adapters.stereo.stream.set_kind import SetKind
from gateway.adapters.stereo.stream.subscriptions import (
    ImageSetHub,
    LimitError,
    MailboxState,
    StreamError,
    Subscription,
)

LEFT = SetKind(left=True)
DEPTH = SetKind(disparity=True)


async def test_mailbox_holds_the_newest_set_and_counts_replaced_and_overtaken_ones() -> None:
    hub = ImageSetHub(4, 4)
    with hub.subscribe(LEFT) as subscription:
        for number in (1, 3, 2, 3):
            hub.publish(LEFT, number, b"%d" % number)
        assert await subscription.get() == b"3"
        assert subscription.state is MailboxState.EMPTY
        assert (hub.sent, hub.skipped) == (1, 2)
    assert (hub.sent, hub.skipped) == (1, 2)


async def test_a_cancelled_get_ends_the_waiting_state() -> None:
    hub = ImageSetHub(4, 4)
    with hub.subscribe(LEFT) as subscription:
        waiting = asyncio.create_task(subscription.get())
        await asyncio.sleep(0)
        assert hub.kinds_with_mailbox(MailboxState.WAITING) == {LEFT}
        waiting.cancel()
        await asyncio.gather(waiting, return_exceptions=True)
        assert hub.kinds_with_mailbox(MailboxState.WAITING) == set()
        assert hub.kinds_with_mailbox(MailboxState.EMPTY) == {LEFT}


STEPS = st.lists(
    st.tuples(
        st.sampled_from(["subscribe", "unsubscribe", "publish", "take", "fail"]),
        st.integers(0, 7),
        st.sampled_from([LEFT, DEPTH]),
    ),
    max_size=60,
)


@settings(deadline=None, max_examples=100)
@given(STEPS)
def test_random_subscriptions_leave_no_state(steps: list[tuple[str, int, SetKind]]) -> None:
    asyncio.run(_churn(steps))


async def _churn(steps: list[tuple[str, int, SetKind]]) -> None:
    hub = ImageSetHub(5, 2)
    open_: list[tuple[ExitStack, Subscription]] = []
    traces: list[weakref.ref[object]] = []
    full: set[int] = set()
    ended: set[int] = set()
    taken = replaced = number = 0
    for step, client, kind in steps:
        chosen = open_[client % len(open_)] if open_ else None
        if step == "subscribe":
            block = ExitStack()
            try:
                open_.append((block, block.enter_context(hub.subscribe(kind))))
            except LimitError:
                assert len(open_) == 5
            else:
                traces.append(weakref.ref(open_[-1][1]))
        elif step == "publish":
            number += 1
            receiving = {id(s) for _, s in open_ if s.kind == kind} - ended
            replaced += len(receiving & full)
            full |= receiving
            hub.publish(kind, number, b"set %d" % number)
        elif step == "fail":
            hub.end_streams(kind, "broken")
            ended |= {id(s) for _, s in open_ if s.kind == kind}
            full -= ended
        elif chosen is not None and step == "take" and chosen[1].state in (MailboxState.FULL, MailboxState.CLOSED):
            if id(chosen[1]) in ended:
                with pytest.raises(StreamError, match="broken"):
                    await chosen[1].get()
            else:
                await chosen[1].get()
                full.discard(id(chosen[1]))
                taken += 1
        elif chosen is not None and step == "unsubscribe":
            hub.scheduler_wakeup.clear()
            chosen[0].close()
            open_.remove(chosen)
            full.discard(id(chosen[1]))
            ended.discard(id(chosen[1]))
            assert hub.scheduler_wakeup.is_set()
        assert len(hub) == len(open_)
        assert {id(s) for _, s in open_ if s.state in (MailboxState.FULL, MailboxState.CLOSED)} == full | ended
        assert hub.kinds == {s.kind for _, s in open_}
        assert (hub.sent, hub.skipped) == (taken, replaced)
    chosen = None
    while open_:
        open_.pop()[0].close()
    assert len(hub) == 0
    assert not hub.kinds
    assert (hub.sent, hub.skipped) == (taken, replaced)
    assert [trace for trace in traces if trace() is not None] == []


async def test_later_subscriptions_do_not_get_outdated_sets() -> None:
    hub = ImageSetHub(4, 4)
    hub.start_generation()
    with hub.subscribe(LEFT) as early:
        hub.scheduler_wakeup.clear()
        hub.start_generation()
        assert hub.scheduler_wakeup.is_set()
        with hub.subscribe(LEFT) as late:
            hub.publish(LEFT, 1, b"old", 1)
            assert (early.state, late.state) == (MailboxState.FULL, MailboxState.EMPTY)
            hub.publish(LEFT, 2, b"new", 2)
            assert await late.get() == await early.get() == b"new"


def test_limits_are_named_and_reached_exactly() -> None:
    hub = ImageSetHub(3, 2)
    with hub.subscribe(LEFT), hub.subscribe(DEPTH):
        with (
            pytest.raises(LimitError, match=r"^2 different requests are served already, the limit \(max_kinds\)$"),
            hub.subscribe(SetKind(right=True)),
        ):
            pass
        with (
            hub.subscribe(LEFT),
            pytest.raises(LimitError, match=r"^3 streams are open already, the limit \(max_clients\)$"),
            hub.subscribe(LEFT),
        ):
            pass
    assert len(hub) == 0
    with hub.subscribe(SetKind(right=True)):
        assert hub.kinds == {SetKind(right=True)}


async def test_sets_go_to_their_kind_and_not_to_later_generations() -> None:
    hub = ImageSetHub(4, 4)
    for _ in range(5):
        hub.start_generation()
    with hub.subscribe(LEFT) as left, hub.subscribe(DEPTH) as depth:
        assert (hub.camera_kinds, hub.depth_kinds) == ((LEFT,), (DEPTH,))
        hub.publish(LEFT, 1, b"old", 4)
        assert left.state is MailboxState.EMPTY
        hub.publish(LEFT, 1, b"now", 5)
        assert (left.state, depth.state) == (MailboxState.FULL, MailboxState.EMPTY)
        assert await left.get() == b"now"
        hub.publish(LEFT, 1, b"again", 6)
        assert left.state is MailboxState.EMPTY, "the same frame once"
        hub.end_streams(DEPTH, "broken")
        assert (left.state, depth.state) == (MailboxState.EMPTY, MailboxState.CLOSED)
        hub.publish(DEPTH, 2, b"late", 6)
        with pytest.raises(StreamError, match=r"^broken$"):
            await depth.get()
        assert (hub.sent, hub.skipped) == (1, 0)


async def test_a_closed_hub_refuses_subscriptions() -> None:
    hub = ImageSetHub(4, 4)
    with hub.subscribe(LEFT) as subscription:
        hub.close("shutting down")
        with pytest.raises(StreamError, match=r"^shutting down$"):
            await subscription.get()
    with pytest.raises(StreamError, match=r"^shutting down$"), hub.subscribe(LEFT):
        pass
    assert len(hub) == 0
