"""Clients that disconnect while a message is written."""

import asyncio
from typing import Any

import grpc
import pytest

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.stream.grpc_server import _decode_requests
from scenegate.camera import image_interface_pb2 as pb
from tests.adapters.stereo.conftest import SMALL, running, seen
from tests.adapters.stereo.scenes import table
from tests.support.endless import EndlessRenderer
from tests.support.waiting import until


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
