"""Queues of the IMU's clients, and recording of poses."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import numpy as np
import pytest

from gateway.adapters.stereo.imu.imu_sampler import ImuSamples
from gateway.adapters.stereo.imu.imu_service import PoseLog, json_lines, next_lines
from gateway.adapters.stereo.stream.client_queues import MessageHub
from gateway.adapters.stereo.stream.subscriptions import LimitError, StreamError
from gateway.scene.tree.live import LiveTree, Snapshot


def samples(first: int, count: int) -> ImuSamples:
    numbers = np.arange(first, first + count)
    vectors = np.stack((numbers, -numbers, np.zeros(count)), axis=1).astype(np.float64)
    return ImuSamples(1_700_000_000_000_000_000 + numbers, vectors, -vectors)


def parsed(lines: bytes) -> list[Any]:
    assert lines.endswith(b"\n")
    return [json.loads(line) for line in lines.splitlines()]


def test_lines_have_the_fields_of_the_device() -> None:
    first, second = parsed(json_lines(samples(7, 2)))
    assert first == {
        "timestamp": {"sec": 1_700_000_000, "nsec": 7},
        "linear_acceleration": {"x": 7.0, "y": -7.0, "z": 0.0},
        "angular_velocity": {"x": -7.0, "y": 7.0, "z": 0.0},
    }
    assert second["timestamp"]["nsec"] == 8
    assert b"-0.0," not in json_lines(samples(0, 1))


async def test_every_client_gets_every_sample() -> None:
    hub = MessageHub("IMU", 2, 100)
    assert not hub.has_clients.is_set()
    with hub.subscribe() as first, hub.subscribe() as second:
        assert hub.has_clients.is_set()
        waiting = asyncio.ensure_future(next_lines(first))
        hub.put(json_lines(samples(0, 10)), 10)
        hub.put(json_lines(samples(10, 10)), 10)
        assert [line["timestamp"]["nsec"] for line in parsed(await waiting)] == list(range(20))
        assert [line["timestamp"]["nsec"] for line in parsed(await next_lines(second))] == list(range(20))
        limit = r"2 IMU streams are open already, the limit \(max_clients\)"
        with pytest.raises(LimitError, match=limit), hub.subscribe():
            pass
    assert len(hub) == 0
    assert not hub.has_clients.is_set()


async def test_slow_clients_lose_the_oldest_samples_and_are_told_how_many() -> None:
    hub = MessageHub("IMU", 1, 25)
    with hub.subscribe() as queue:
        for batch in range(6):
            hub.put(json_lines(samples(10 * batch, 10)), 10)
        lost, *lines = parsed(await next_lines(queue))
        assert lost == {"lost": 40}
        assert [line["timestamp"]["nsec"] for line in lines] == list(range(40, 60))
        hub.put(json_lines(samples(60, 1)), 1)
        assert len(parsed(await next_lines(queue))) == 1
        hub.put(json_lines(samples(100, 30)), 30)
        assert parsed(await next_lines(queue)) == [{"lost": 30}]


async def test_streams_end_when_the_hub_closes() -> None:
    hub = MessageHub("IMU", 2, 100)
    with hub.subscribe() as queue, hub.subscribe() as other:
        waiting = asyncio.ensure_future(next_lines(other))
        hub.put(json_lines(samples(0, 1)), 1)
        hub.close("the end")
        assert len(parsed(await next_lines(queue))) == 1
        assert len(parsed(await waiting)) == 1
        for each in (queue, other):
            with pytest.raises(StreamError, match="the end"):
                await next_lines(each)
    with pytest.raises(StreamError, match="the end"), hub.subscribe():
        pass


def test_poses_are_recorded_between_start_and_stop_only() -> None:
    times = iter(range(1, 100))
    tree = LiveTree(lambda: next(times))

    def pose_in(snapshot: Snapshot) -> Any:
        return np.eye(4) * snapshot.revision

    log = PoseLog(tree, pose_in, lambda: next(times))

    def move() -> None:
        with tree.edit() as edit:
            edit.set_matrix(("camera",), np.eye(4))

    move()
    assert log.take() == []
    log.start()
    move()
    move()
    assert [(time, pose[0, 0]) for time, pose in log.take()] == [(2, 1), (3, 2), (4, 3)]
    assert log.take() == []
    move()
    log.stop()
    move()
    assert log.take() == []
