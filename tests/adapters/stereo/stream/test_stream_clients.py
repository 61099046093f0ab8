"""Image stream of several clients: disconnects, slow clients, new clients, limits."""

import asyncio
import random
import threading
from dataclasses import replace
from typing import Any

import grpc
import pytest

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.stream.grpc_server import _decode_requests
from renderers.drawlist import DrawList
from scenegate.camera import image_interface_pb2 as pb
from tests.adapters.stereo.conftest import EVERYTHING, SMALL, Start, running, seen
from tests.adapters.stereo.scenes import table
from tests.support.endless import EndlessRenderer
from tests.support.waiting import SECONDS, until


def seconds(timestamp: pb.Time) -> float:
    return timestamp.sec + timestamp.nsec * 1e-9


async def test_disconnected_clients_leave_no_state(start: Start) -> None:
    camera = await start(rate="max")
    await camera.take(disparity_enabled=True)
    order = random.Random(4)
    tasks, threads = len(asyncio.all_tasks()), threading.active_count()

    async def visit() -> None:
        request = {name: order.random() < 0.4 for name in EVERYTHING}
        call = camera.stream(**request, timeout=order.choice((0.05, SECONDS)))
        try:
            for _ in range(order.randrange(4)):
                await call.read()
        except grpc.aio.AioRpcError as error:
            assert error.code() == grpc.StatusCode.DEADLINE_EXCEEDED
        call.cancel()

    for _ in range(6):
        await asyncio.gather(*(visit() for _ in range(8)))
    await until(lambda: len(camera.service.hub) == 0 and camera.service.workers.stats.running == 0)
    await until(lambda: len(asyncio.all_tasks()) <= tasks)
    assert threading.active_count() <= threads + 1


async def test_a_slow_client_does_not_delay_others(start: Start) -> None:
    camera = await start(rate="max", model=SMALL)
    slow, fast = camera.stream(left_enabled=True, color=True), camera.stream(left_enabled=True, color=True)
    await slow.read()
    stamps = [(await fast.read()).timestamp for _ in range(150)]
    assert len({(t.sec, t.nsec) for t in stamps}) == 150
    stuck = min(camera.service.hub, key=lambda s: s.sent)
    assert stuck.sent < 150
    assert camera.service.hub.skipped > 0


async def test_a_client_that_resumes_reading_gets_the_newest_set(start: Start) -> None:
    camera = await start(rate="max", model=SMALL)
    options = [("grpc.http2.bdp_probe", 0), ("grpc.use_local_subchannel_pool", 1)]
    async with grpc.aio.insecure_channel(f"127.0.0.1:{camera.service.port}", options=options) as channel:
        paused = replace(camera, channel=channel).stream(left_enabled=True)
        await paused.read()
        fast = camera.stream(left_enabled=True)
        newest = [(await fast.read()).timestamp for _ in range(60)][-1]
        old = 0
        while seconds((await paused.read()).timestamp) < seconds(newest):
            old += 1
    assert old <= 2, "one in the window, and one that was being sent"


async def test_limits_of_clients_and_kinds(start: Start) -> None:
    camera = await start(max_clients=2, max_kinds=1)
    first = camera.stream(left_enabled=True)
    await first.read()
    with pytest.raises(grpc.aio.AioRpcError, match="max_kinds"):
        await camera.stream(right_enabled=True).read()
    second = camera.stream(left_enabled=True)
    await second.read()
    with pytest.raises(grpc.aio.AioRpcError, match="max_clients"):
        await camera.stream(left_enabled=True).read()
    first.cancel()
    await until(lambda: len(camera.service.hub) == 1)
    await camera.take(left_enabled=True)


async def test_streams_opened_after_a_parameter_change_get_no_older_set(start: Start) -> None:
    taking, go = threading.Event(), threading.Event()
    drawn = table()

    def scene() -> tuple[DrawList, int]:
        taking.set()
        go.wait(SECONDS)
        return drawn, 1

    camera = await start(scene=scene)
    first = camera.stream(disparity_enabled=True)
    pending = asyncio.ensure_future(first.read())
    assert await asyncio.to_thread(taking.wait, SECONDS)
    # A frame is in work with the quality of before, for the same request.
    camera.service.parameters.set("rc_stereomatching", [("quality", "Low")])
    second = camera.stream(disparity_enabled=True)
    later = asyncio.ensure_future(second.read())
    await until(lambda: len(camera.service.hub) == 2)
    go.set()
    assert (await pending).disparity.image.width in (160, 54), "the next, smaller frame may overtake it"
    assert (await later).disparity.image.width == 54
    assert (await first.read()).disparity.image.width == 54


async def test_a_connection_broken_while_writing_cancels_the_call() -> None:
    async def response(request: pb.ImageSetRequest, context: Any) -> None:
        assert request.left_enabled
        raise grpc.aio.InternalError('Failed "execute_batch"')

    with pytest.raises(asyncio.CancelledError):
        await _decode_requests(pb.ImageSetRequest, response)(b"\x08\x01", None)


async def test_frames_are_cancelled_without_clients() -> None:
    renderer, drawn = EndlessRenderer(), table()
    config = StereoConfig(port=0, model=SMALL, look="phong")
    async with running(renderer, config, seen(lambda: (drawn, 1))) as camera:
        call = camera.stream(left_enabled=True, disparity_enabled=True)
        reading = asyncio.create_task(call.read())
        await until(lambda: renderer.begun > renderer.ended)
        call.cancel()
        await asyncio.gather(reading, return_exceptions=True)
        await until(lambda: renderer.begun == renderer.ended and camera.service.workers.stats.running == 0)


@pytest.mark.parametrize("rate", ["max", "device"])
async def test_a_slow_frame_ends_its_streams_with_the_limit(rate: Any) -> None:
    drawn = table()
    config = StereoConfig(port=0, model=SMALL, look="phong", rate=rate)
    async with running(EndlessRenderer(), config, seen(lambda: (drawn, 1)), seconds=0.1) as camera:
        with pytest.raises(grpc.aio.AioRpcError) as caught:
            await camera.stream(left_enabled=True).read()
    assert "--render-seconds = 0.1 s" in str(caught.value.details())
