"""Fault injection over REST, if the operator permits it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from functools import partial
from typing import Any

import grpc
import httpx2 as httpx
import pytest
from fastapi import FastAPI

from gateway.stereo.clock import SimulatedClock
from gateway.stereo.fault_routes import fault_router
from gateway.stereo.faults import FaultInjector, Faults
from tests.stereo.conftest import Camera, Start


@pytest.fixture
async def camera(start: Start) -> Camera:
    return await start(faults=True, rate="max", clock=SimulatedClock())


@pytest.fixture
async def rest(camera: Camera) -> AsyncIterator[httpx.AsyncClient]:
    async with client_of(camera) as client:
        yield client


def client_of(camera: Camera) -> httpx.AsyncClient:
    app = FastAPI()
    app.include_router(fault_router(camera.service))
    return httpx.AsyncClient(transport=httpx.ASGITransport(app=app), base_url="http://camera")


def stamp(one: Any) -> int:
    return int(one.timestamp.sec * 10**9 + one.timestamp.nsec)


async def test_disabled_by_default(start: Start) -> None:
    camera = await start()
    async with client_of(camera) as rest:
        for method, path in (("GET", ""), ("PUT", ""), ("DELETE", ""), ("POST", "/disconnect")):
            answer = await rest.request(method, f"/stereo/faults{path}", json={})
            assert answer.status_code == 403
            assert answer.json()["message"] == "fault injection is off; start the gateway with --stereo-faults"
    assert camera.service.injector.faults == Faults()


async def test_the_seed_determines_dropped_frames(camera: Camera, rest: httpx.AsyncClient) -> None:
    answer = await rest.put("/stereo/faults", json={"drop": 0.5})
    assert answer.json()["drop"] == 0.5
    sets = await camera.take(12, left_enabled=True)
    frames = [(stamp(one) - 1_000_000_000) // 40_000_000 + 1 for one in sets]
    twin, kept = FaultInjector(0, 0), list[int]()
    twin.set(Faults(drop=0.5))
    for number in range(1, frames[-1] + 1):
        twin.deliver(number, b"", partial(kept.append, number))
    assert frames == kept
    assert frames[-1] > 12
    assert (await rest.get("/stereo/faults")).json()["dropped"] >= frames[-1] - 12
    assert (await rest.delete("/stereo/faults")).json()["drop"] == 0


async def test_delayed_sets_keep_their_order_within_the_limit() -> None:
    injector, came, loop = FaultInjector(0, 100), list[int](), asyncio.get_running_loop()
    injector.set(Faults(delay=0.05))
    begin = loop.time()
    done = asyncio.Event()

    def last() -> None:
        came.append(7)
        done.set()

    for number in range(3):
        injector.deliver(number, bytes(40), partial(came.append, number))
    assert (came, injector.dropped) == ([], 1)
    injector.set(Faults())
    # Later sets do not overtake those that are late.
    injector.deliver(7, bytes(10), last)
    await done.wait()
    assert came == [0, 1, 7]
    assert loop.time() - begin >= 0.05
    injector.deliver(8, bytes(1000), lambda: came.append(8))
    assert came[-1] == 8


async def test_a_delay_in_the_stream(camera: Camera, rest: httpx.AsyncClient) -> None:
    await rest.put("/stereo/faults", json={"delay": 0.2})
    begin = asyncio.get_running_loop().time()
    await camera.take(1, left_enabled=True)
    assert asyncio.get_running_loop().time() - begin >= 0.2


async def read_all(camera: Camera, begun: asyncio.Event) -> int:
    """Return the sets until the stream is cut."""
    count = 0
    try:
        async for _ in camera.stream(left_enabled=True):
            count += 1
            begun.set()
    except grpc.aio.AioRpcError as error:
        assert error.code() == grpc.StatusCode.UNAVAILABLE
        assert error.details() == "the stream was cut by fault injection"
    return count


async def test_streams_are_cut(camera: Camera, rest: httpx.AsyncClient) -> None:
    await rest.put("/stereo/faults", json={"disconnect_after": 3})
    assert await read_all(camera, asyncio.Event()) == 3
    await rest.delete("/stereo/faults")
    begun = asyncio.Event()
    reading = asyncio.create_task(read_all(camera, begun))
    await begun.wait()
    assert (await rest.post("/stereo/faults/disconnect")).json() == {"streams": 1}
    assert await reading >= 1
    await camera.take(1, left_enabled=True)


async def test_frozen_and_wrong_clocks(camera: Camera, rest: httpx.AsyncClient) -> None:
    await rest.put("/stereo/faults", json={"clock_frozen": True})
    call = camera.stream(disparity_enabled=True, left_enabled=True)
    sets = [await call.read() for _ in range(3)]
    assert len({stamp(one) for one in sets}) == 1
    assert len({one.left.data for one in sets}) == 3
    call.cancel()
    await rest.put("/stereo/faults", json={"clock_offset": -1.0})
    call = camera.stream(left_enabled=True)
    one = stamp(await call.read())
    assert one != stamp(sets[0])
    assert 0 <= one < 5 * 10**9
    assert one % 40_000_000 == 0


@pytest.mark.parametrize(
    ("body", "sentence"),
    [
        ('{"drop": 2}', "`float` <= 1.0 - at `$.drop`"),
        ('{"delay": -1}', "at `$.delay`"),
        ('{"fire": 1}', "unknown field `fire`"),
        ("[", "the body is not like"),
    ],
)
async def test_invalid_requests_are_rejected_without_effect(rest: httpx.AsyncClient, body: str, sentence: str) -> None:
    answer = await rest.put("/stereo/faults", content=body)
    assert answer.status_code == 400
    assert sentence in answer.json()["message"]
    assert (await rest.get("/stereo/faults")).json()["drop"] == 0
    assert (await rest.put("/stereo/faults", content=" " * 5000)).status_code == 413
    assert (await rest.get("/stereo/faults?pipeline=3")).status_code == 404
