"""Fault injection over REST, if the operator permits it."""

import asyncio
from functools import partial

import grpc
import httpx2 as httpx
import pytest

from gateway.adapters.stereo.routes.fault_routes import fault_router
from gateway.adapters.stereo.stream.faults import FaultInjector, Faults
from tests.adapters.stereo.conftest import Camera, Start, http_client, nanoseconds


@pytest.fixture
async def camera(start: Start) -> Camera:
    return await start(faults=True, rate="max", simulated_clock=True)


async def test_disabled_by_default(start: Start) -> None:
    camera = await start()
    async with http_client(fault_router(camera.service)) as rest_client:
        for method, path in (("GET", ""), ("PUT", ""), ("DELETE", ""), ("POST", "/disconnect")):
            response = await rest_client.request(method, f"/stereo/faults{path}", json={})
            assert response.status_code == 403
            assert response.json()["message"] == "fault injection is off; start the gateway with --stereo-faults"
    assert camera.service.injector is None


async def test_the_seed_determines_dropped_frames(camera: Camera, rest_client: httpx.AsyncClient) -> None:
    response = await rest_client.put("/stereo/faults", json={"drop": 0.5})
    assert response.json()["drop"] == 0.5
    sets = await camera.take(12, left_enabled=True)
    frames = [(nanoseconds(image_set.timestamp) - 1_000_000_000) // 40_000_000 + 1 for image_set in sets]
    other_injector, delivered = FaultInjector(0, 0), list[int]()
    other_injector.set(Faults(drop=0.5))
    for number in range(1, frames[-1] + 1):
        other_injector.deliver(number, b"", partial(delivered.append, number))
    assert frames == delivered
    assert frames[-1] > 12
    assert (await rest_client.get("/stereo/faults")).json()["dropped"] >= frames[-1] - 12
    assert (await rest_client.delete("/stereo/faults")).json()["drop"] == 0


async def test_delayed_sets_keep_their_order_within_the_limit() -> None:
    injector, delivered, loop = FaultInjector(0, 100), list[int](), asyncio.get_running_loop()
    injector.set(Faults(delay=0.05))
    start = loop.time()
    done = asyncio.Event()

    def last() -> None:
        delivered.append(7)
        done.set()

    for number, size in enumerate((50, 40, 11)):  # the last is beyond the limit
        injector.deliver(number, bytes(size), partial(delivered.append, number))
    assert (delivered, injector.dropped) == ([], 1)
    injector.set(Faults())
    # Later sets do not overtake those that are late.
    injector.deliver(7, bytes(10), last)
    await done.wait()
    assert delivered == [0, 1, 7]
    assert loop.time() - start >= 0.05
    injector.deliver(8, bytes(1000), lambda: delivered.append(8))
    assert delivered[-1] == 8
    injector.set(Faults(delay=0.01))
    injector.deliver(9, bytes(100), lambda: delivered.append(9))
    assert injector.dropped == 1, "delivered sets do not count"


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


async def test_streams_are_cut(camera: Camera, rest_client: httpx.AsyncClient) -> None:
    await rest_client.put("/stereo/faults", json={"disconnect_after": 3})
    assert await read_all(camera, asyncio.Event()) == 3
    await rest_client.delete("/stereo/faults")
    begun = asyncio.Event()
    reading = asyncio.create_task(read_all(camera, begun))
    await begun.wait()
    assert (await rest_client.post("/stereo/faults/disconnect")).json() == {"streams": 1}
    assert await reading >= 1
    await camera.take(1, left_enabled=True)


async def test_a_frozen_clock(camera: Camera, rest_client: httpx.AsyncClient) -> None:
    await rest_client.put("/stereo/faults", json={"clock_frozen": True})
    call = camera.stream(disparity_enabled=True, left_enabled=True)
    sets = [await call.read() for _ in range(3)]
    assert len({nanoseconds(image_set.timestamp) for image_set in sets}) == 1
    assert len({image_set.left.data for image_set in sets}) == 3


@pytest.mark.parametrize(
    ("body", "sentence"),
    [
        ('{"drop": 2}', "`float` <= 1.0 - at `$.drop`"),
        ('{"delay": -1}', "at `$.delay`"),
        ('{"fire": 1}', "unknown field `fire`"),
        ("[", "the body is not like"),
        (b'{"\xff": 1}', "the body is not like"),
    ],
)
async def test_invalid_requests_are_rejected_without_effect(
    rest_client: httpx.AsyncClient, body: str | bytes, sentence: str
) -> None:
    response = await rest_client.put("/stereo/faults", content=body)
    assert response.status_code == 400
    assert sentence in response.json()["message"]
    assert (await rest_client.get("/stereo/faults")).json()["drop"] == 0
    assert (await rest_client.put("/stereo/faults", content=" " * 5000)).status_code == 413
    assert (await rest_client.get("/stereo/faults?pipeline=3")).status_code == 404
