"""Image events: sent when the images of a depth frame are captured."""

import asyncio
from typing import TypeAlias

import grpc
import pytest

from gateway.adapters.stereo.stream.image_messages import depth_acquisition_done
from gateway.adapters.stereo.stream.subscriptions import EventHub
from scenegate.camera import image_interface_pb2 as pb
from tests.adapters.stereo.conftest import Camera, Start, nanoseconds
from tests.support.waiting import SECONDS, until

Call: TypeAlias = "grpc.aio.UnaryStreamCall[pb.ImageEventsRequest, pb.ImageEvents]"


async def listen(camera: Camera, *, enabled: bool = True) -> Call:
    call: Call = camera.channel.unary_stream(
        "/ImageEventsInterface/StreamImageEvents",
        request_serializer=pb.ImageEventsRequest.SerializeToString,
        response_deserializer=pb.ImageEvents.FromString,
    )(pb.ImageEventsRequest(depth_acquisition_done_enabled=enabled), timeout=SECONDS)
    await call.initial_metadata()
    return call


async def test_an_event_for_every_depth_set(start: Start) -> None:
    camera = await start(rate="max", depth_mode="matched")
    events = await listen(camera)
    sets = camera.stream(disparity_enabled=True)
    for _ in range(3):
        image_set, event = await sets.read(), await events.read()
        while nanoseconds(event.imageset_timestamp) < nanoseconds(image_set.timestamp):
            event = await events.read()
        assert event.HasField("depth_acquisition_done")
        assert image_set.timestamp == event.imageset_timestamp
        assert nanoseconds(event.depth_acquisition_done.timestamp) >= nanoseconds(event.imageset_timestamp)


async def test_no_event_for_camera_images(start: Start) -> None:
    camera = await start(simulated_clock=True, rate="max")
    events, silent = await listen(camera), await listen(camera, enabled=False)
    pending = asyncio.ensure_future(events.read())
    await camera.take(5, left_enabled=True)
    assert not pending.done()
    (image_set,) = await camera.take(disparity_enabled=True)
    assert (await pending).imageset_timestamp == image_set.timestamp
    assert camera.service.status()["event_clients"] == 2
    silent.cancel()


async def test_alternate_exposure_and_triggers_have_events(start: Start) -> None:
    camera = await start(simulated_clock=True, rate="max")
    parameters = camera.service.parameters
    parameters.set("rc_iocontrol", [("out1_mode", "ExposureAlternateActive")])
    parameters.set("rc_stereomatching", [("acquisition_mode", "SingleFrame")])
    events, sets = await listen(camera), camera.stream(disparity_enabled=True, left_enabled=True)
    pending = asyncio.ensure_future(events.read())
    await camera.take(2, left_enabled=True)
    assert camera.service.fire_trigger()[0] == 0
    event, image_set = await pending, await sets.read()
    assert event.imageset_timestamp == image_set.timestamp == image_set.disparity.timestamp


async def test_static_scenes_are_done_after_the_last_of_eight_images(start: Start) -> None:
    camera = await start(simulated_clock=True, rate="max")
    camera.service.parameters.set("rc_stereomatching", [("static_scene", True)])
    events = await listen(camera)
    sets = camera.stream(disparity_enabled=True)
    event = await events.read()
    await sets.read()
    done, taken = event.depth_acquisition_done.timestamp, event.imageset_timestamp
    assert nanoseconds(done) - nanoseconds(taken) == 7 * 40_000_000


async def test_slow_clients_get_the_newest_events_and_clients_are_limited(start: Start) -> None:
    hub = EventHub(1, 3)
    with hub.subscribe() as queue:
        for number in range(10):
            hub.put(depth_acquisition_done(number, number))
        events = await queue.get()
        stamps = [pb.ImageEvents.FromString(event).imageset_timestamp.nsec for event in events]
        assert stamps == [7, 8, 9]
    assert len(hub) == 0
    camera = await start(max_clients=1)
    first = await listen(camera)
    second = await listen(camera)
    with pytest.raises(grpc.aio.AioRpcError, match="1 event streams are open already") as refusal:
        await second.read()
    assert not first.done()  # this reference also keeps the call from being cancelled as garbage
    assert refusal.value.code() == grpc.StatusCode.RESOURCE_EXHAUSTED


async def test_disconnected_clients_are_removed(start: Start) -> None:
    camera = await start(rate="max")
    await camera.take(disparity_enabled=True)
    calls = [await listen(camera) for _ in range(20)]
    assert len(camera.service.events) == 20
    for call in calls:
        call.cancel()
    await until(lambda: len(camera.service.events) == 0)


async def test_streams_of_events_end_with_the_reason_when_the_camera_shuts_down(start: Start) -> None:
    camera = await start()
    events = await listen(camera)
    await until(lambda: len(camera.service.events) == 1)
    camera.task.cancel()
    with pytest.raises(grpc.aio.AioRpcError, match="the stereo camera is shutting down") as ended:
        await events.read()
    assert ended.value.code() == grpc.StatusCode.UNAVAILABLE
    await asyncio.gather(camera.task, return_exceptions=True)
