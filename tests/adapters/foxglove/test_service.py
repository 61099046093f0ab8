"""Foxglove's WebSocket with an independent client of its protocol."""

import asyncio
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from structlog.testing import capture_logs
from websockets.asyncio.client import connect

pytest.importorskip("foxglove", reason="needs the extra foxglove")
pytest.importorskip("foxglove_schemas_protobuf", reason="needs the extra foxglove")

from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion

from gateway.adapters.foxglove import front as foxglove_front
from gateway.adapters.foxglove import service as foxglove_service
from gateway.adapters.foxglove.channels import BACKLOG_MESSAGES, MAX_CLIENTS, Channels
from gateway.adapters.foxglove.front import Front
from gateway.adapters.foxglove.service import FoxgloveService
from gateway.adapters.stereo.service import StereoService
from gateway.adapters.stereo.stream.subscriptions import ImageSetHub
from gateway.adapters.viewer.encoder import SnapshotFrames
from gateway.scene.tree.geometry import Part, PointCloud
from gateway.scene.tree.live import LiveTree
from gateway.wiring.foxglove import FoxgloveCamera
from renderers.drawlist import Material
from scenegate.messages.geometry import Box
from tests.adapters.foxglove.client import SUBPROTOCOL, FoxgloveClient
from tests.adapters.stereo.conftest import Start, renderer, start
from tests.support.waiting import SECONDS, until

__all__ = ["renderer", "start"]


@asynccontextmanager
async def running(service: FoxgloveService) -> AsyncIterator[FoxgloveService]:
    task = asyncio.create_task(service.run())
    try:
        await until(lambda: service.ready or task.done())
        assert service.ready, task.exception()
        yield service
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


@asynccontextmanager
async def client_of(service: FoxgloveService) -> AsyncIterator[FoxgloveClient]:
    url = f"ws://127.0.0.1:{service.port}"
    async with connect(url, subprotocols=[SUBPROTOCOL], max_size=None, open_timeout=SECONDS) as socket:
        async with asyncio.timeout(SECONDS):
            yield FoxgloveClient(socket)


@asynccontextmanager
async def connected(tree: LiveTree, camera: Any = None) -> AsyncIterator[tuple[FoxgloveService, FoxgloveClient]]:
    """Run the service of a tree and, if there is one, a camera; connect a client."""
    service = FoxgloveService(0, tree, SnapshotFrames, None if camera is None else FoxgloveCamera(camera))
    async with running(service), client_of(service) as client:
        yield service, client


def tree_with_box() -> LiveTree:
    tree = LiveTree()
    with tree.edit() as edit:
        edit.set_parts(("robot", "link"), (Part(Box((2, 2, 2)), Material(base_color=(1, 0, 0, 1))),))
        edit.set_pose(("robot",), (1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0))
    return tree


async def test_a_late_client_gets_the_whole_scene_and_then_changes() -> None:
    tree = tree_with_box()
    async with connected(tree) as (service, first):
        await first.subscribe("/tf", "/scene")
        assert set(first.channels) == {"/tf", "/scene"}  # there is no camera
        found = await first.messages_of("/tf", "/scene")
        (entity,) = found["/scene"].entities
        assert (entity.id, entity.frame_id) == ("scene/robot/link", "scene/robot/link")
        points = np.array([(p.x, p.y, p.z) for p in entity.triangles[0].points])
        np.testing.assert_array_equal(np.abs(points), 1.0)
        assert entity.triangles[0].color.r == pytest.approx(1.0)
        async with client_of(service) as second:
            await second.subscribe("/tf", "/scene")
            late = await second.messages_of("/tf", "/scene")
            assert late["/scene"].entities == found["/scene"].entities or len(late["/scene"].entities) == 1
            poses = {each.child_frame_id: each for each in late["/tf"].transforms}
            assert poses["scene/robot"].translation.z == 3.0
            with tree.edit() as edit:
                edit.set_pose(("robot",), (5.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0))
                edit.delete(("robot", "link"))
            for client in (first, second):
                while True:
                    topic, time, message = await client.next_message()
                    if topic == "/scene" and message.deletions:
                        assert [each.id for each in message.deletions] == ["scene/robot/link"]
                        assert time == tree.snapshot.timestamp
                        break


async def test_clouds_have_channels_of_their_own_which_are_withdrawn_with_them() -> None:
    """And there again with the cloud, without a number in its name."""
    tree, topic = LiveTree(), "/scene/points/scan"

    def publish() -> None:
        with tree.edit() as edit:
            edit.set_parts(("scan",), (Part(PointCloud(np.ones((5, 3), np.float32)), Material()),))

    publish()
    async with connected(tree) as (service, client):
        await client.subscribe("/tf")
        for number in range(2):
            await client.subscribe(topic)
            cloud = (await client.messages_of(topic))[topic]
            assert cloud.frame_id == "scene/scan"
            assert number or len(cloud.data) == 5 * cloud.point_stride  # an empty one may still have been on its way
            with tree.edit() as edit:
                edit.delete(("scan",))
            await client.until_withdrawn(topic)
            assert service.status()["topics"] == ["/tf"]
            publish()


async def test_what_the_sdk_reports_of_clients_is_a_sentence_of_ours() -> None:
    with capture_logs() as log:
        async with running(FoxgloveService(0, LiveTree(), SnapshotFrames, None)) as service:
            _, writer = await asyncio.open_connection("127.0.0.1", service.port)
            writer.write(b"GET / HTTP/1.1\r\nUpgrade: websocket\r\n\r\n")
            await writer.drain()
            writer.close()
            await until(lambda: any("reason" in entry for entry in log))
    (entry,) = [entry for entry in log if "reason" in entry]
    assert entry["log_level"] == "info"
    assert "handshake failed" in entry["reason"]


async def test_nothing_is_made_without_subscribers(monkeypatch: pytest.MonkeyPatch, start: Start) -> None:
    """No image, and no change of the scene is encoded, before the first subscription and after the last."""
    camera, tree, advanced = (await start(rate="max")).service, tree_with_box(), []
    advance = SnapshotFrames.advance

    async def counting(self: SnapshotFrames, *arguments: object) -> list[bytes]:
        advanced.append(arguments)
        return await advance(self, *arguments)  # type: ignore[arg-type]  # passed on unchanged

    monkeypatch.setattr(SnapshotFrames, "advance", counting)

    async def move() -> None:
        with tree.edit() as edit:
            edit.set_pose(("robot",), (float(len(advanced)), 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
        for _ in range(100):
            await asyncio.sleep(0)

    async with connected(tree, camera) as (service, client):
        await client.get_parameters()  # connected
        await move()
        assert not advanced
        assert not len(camera.hub)
        await client.subscribe("/tf", "/stereo/left/image_rect")
        await client.messages_of("/tf", "/stereo/left/image_rect")
        (kind,) = camera.hub.kinds
        assert (kind.left, kind.right, kind.has_depth) == (True, False, False)
        assert advanced
        await client.unsubscribe("/tf", "/stereo/left/image_rect")
        await until(lambda: not service.status()["topics"] and not len(camera.hub))
        count = len(advanced)
        await move()
        assert len(advanced) == count


async def test_images_intrinsics_depth_and_points(start: Start) -> None:
    camera = (await start(rate="max")).service
    topics = [f"/stereo/{name}" for name in ("left/image_rect", "left/camera_info", "right/camera_info", "points2")]
    topics += ["/stereo/depth/image_rect", "/stereo/disparity"]
    async with connected(LiveTree(), camera) as (_, client):
        await client.subscribe(*topics)
        found = await client.messages_of(*topics)
    model = camera.config.model
    left, info = found["/stereo/left/image_rect"], found["/stereo/left/camera_info"]
    assert (left.encoding, left.width, left.height, len(left.data)) == ("rgb8", 320, 240, 3 * 320 * 240)
    np.testing.assert_allclose(info.K[2], model.width / 2 - 0.5)
    right = found["/stereo/right/camera_info"]
    np.testing.assert_allclose(right.P[3], -right.P[0] * model.baseline, rtol=1e-6)
    depth = found["/stereo/depth/image_rect"]
    values = np.frombuffer(depth.data, "<f4").reshape(depth.height, depth.width)
    points = np.frombuffer(found["/stereo/points2"].data, np.dtype([("xyz", "<f4", 3), ("rgba", "u1", 4)]))
    assert 0 < len(points) <= values.size
    assert np.nanmin(values) > 0.0
    assert found["/stereo/disparity"].encoding == "32FC1"


async def test_the_camera_is_left_at_once_without_images() -> None:
    """The camera makes none while the clock is stopped."""
    hub = ImageSetHub(max_clients=1, max_kinds=1)
    camera: Any = SimpleNamespace(hub=hub, config=SimpleNamespace(color=False, model=SimpleNamespace(baseline=0.1)))
    left, right = "/stereo/left/image_rect", "/stereo/right/image_rect"
    async with connected(LiveTree(), camera) as (_, client):
        await client.subscribe(left)
        await until(lambda: any(kind.left for kind in hub.kinds))
        await client.subscribe(right)
        await until(lambda: any(kind.left and kind.right for kind in hub.kinds))
        await client.unsubscribe(left, right)
        await until(lambda: not hub.kinds)


@pytest.mark.slow
async def test_a_client_that_does_not_read_delays_no_other(start: Start) -> None:
    camera = (await start(rate="max")).service
    topic = "/stereo/left/image_rect"
    service = FoxgloveService(0, LiveTree(), SnapshotFrames, FoxgloveCamera(camera))
    async with running(service), client_of(service) as silent, client_of(service) as reading:
        await silent.subscribe(topic)
        await reading.subscribe(topic)
        times = [(await reading.next_message())[1] for _ in range(2 * BACKLOG_MESSAGES)]
        assert sorted(times) == times
        assert service.status()["clients"] == 2


async def test_parameters_are_read_only(start: Start) -> None:
    camera: StereoService = (await start()).service
    async with connected(LiveTree(), camera) as (_, client):
        values = await client.get_parameters()
        assert values["rc_camera.fps"] == camera.parameters.values("rc_camera")["fps"]
        assert {name.partition(".")[0] for name in values} == {"rc_camera", "rc_stereomatching", "rc_iocontrol"}
        await client.set_parameter("rc_camera.fps", 3.0)
        assert (await client.get_parameters())["rc_camera.fps"] == values["rc_camera.fps"]
        assert camera.parameters.values("rc_camera")["fps"] == values["rc_camera.fps"]


async def test_a_taken_port() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        service = FoxgloveService(taken.getsockname()[1], LiveTree(), SnapshotFrames, None)
        with pytest.raises(OSError, match=r"Foxglove's server cannot listen on 127.0.0.1 port \d+: "):
            await service.run()


@pytest.mark.parametrize(
    ("headers", "is_refused"),
    [
        ({}, False),
        ({"Origin": "https://app.foxglove.dev"}, False),
        ({"Origin": "file://"}, False),
        ({"Origin": "https://own.example.org"}, False),
        ({"Host": "robot.example.org:8765"}, False),
        ({"Origin": "https://evil.example"}, True),
        ({"Origin": "http://127.0.0.1:9000"}, True),
        ({"Origin": "null"}, True),
        ({"Host": "evil.example"}, True),
        ({"X": "x" * 9000}, True),
    ],
)
async def test_pages_of_other_sites_are_refused(headers: dict[str, str], is_refused: bool) -> None:
    front = Front(("robot.example.org",), ("https://own.example.org",))
    async with running(FoxgloveService(0, LiveTree(), SnapshotFrames, None, front)) as service:
        lines = {"Host": f"127.0.0.1:{service.port}", "Upgrade": "websocket", "Connection": "Upgrade"}
        lines |= {"Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==", "Sec-WebSocket-Version": "13"}
        lines |= {"Sec-WebSocket-Protocol": SUBPROTOCOL, **headers}
        reader, writer = await asyncio.open_connection("127.0.0.1", service.port)
        head = "".join(f"{name}: {value}\r\n" for name, value in lines.items())
        writer.write(f"GET / HTTP/1.1\r\n{head}\r\n".encode())
        status = b""
        with suppress(ConnectionResetError):
            status = await reader.readline()
        assert status.startswith(b"HTTP/1.1 101 ") is not is_refused, status
        writer.close()


async def test_a_plain_request_is_refused() -> None:
    """Images of pages have no origin."""
    async with running(FoxgloveService(0, LiveTree(), SnapshotFrames, None)) as service:
        reader, writer = await asyncio.open_connection("127.0.0.1", service.port)
        writer.write(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        assert (await reader.read()).startswith(b"HTTP/1.1 403 ")
        writer.close()


async def test_silent_connections_end_and_are_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(foxglove_front, "MAX_SOCKETS", 2)
    async with running(FoxgloveService(0, LiveTree(), SnapshotFrames, None)) as service:
        silent = [await asyncio.open_connection("127.0.0.1", service.port) for _ in range(2)]
        await until(lambda: len(service.front.sockets) == 2)
        reader, writer = await asyncio.open_connection("127.0.0.1", service.port)
        assert await reader.read() == b""
        for each in (writer, *(writer for _, writer in silent)):
            each.close()
        monkeypatch.setattr(foxglove_front, "HEAD_SECONDS", 0.01)
        await until(lambda: not service.front.sockets)
        reader, writer = await asyncio.open_connection("127.0.0.1", service.port)
        assert await reader.read() == b""
        writer.close()


def client(number: int) -> Any:
    return SimpleNamespace(id=number)


SCENE: Any = SimpleNamespace(topic="/scene")


def test_only_clients_that_still_subscribe_are_new() -> None:
    """A client that subscribes often, or has disconnected, costs no more than another one."""
    found = Channels(lambda topic: None, dict)
    for _ in range(100):
        found.on_subscribe(client(1), SCENE)
        found.on_unsubscribe(client(1), SCENE)
    found.on_subscribe(client(2), SCENE)
    assert found.take_new_subscribers() == {"/scene": {2}}
    assert found.take_new_subscribers() == {}
    assert found.topics == {"/scene"}


def test_the_number_of_clients_is_limited() -> None:
    found = Channels(lambda topic: None, dict)
    for number in range(MAX_CLIENTS + 1):
        found.on_subscribe(client(number), SCENE)
    assert found.clients == MAX_CLIENTS
    assert found.take_new_subscribers() == {"/scene": set(range(MAX_CLIENTS))}
    found.on_unsubscribe(client(0), SCENE)
    found.on_subscribe(client(MAX_CLIENTS), SCENE)
    assert found.take_new_subscribers() == {"/scene": {MAX_CLIENTS}}


async def test_repetitions_delete_what_slow_clients_have_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(foxglove_service, "WHOLE_SCENE_SECONDS", 0.0)
    tree = tree_with_box()
    with tree.edit() as edit:
        edit.set_parts(("scan",), (Part(PointCloud(np.ones((5, 3), np.float32)), Material()),))
    async with connected(tree) as (_, client):
        for each in ("/scene", "/scene/points/scan"):
            await client.subscribe(each)
            await client.messages_of(each)
        with tree.edit() as edit:
            edit.delete(("scan",))
        updates: list[Any] = []
        points = None
        while not (points == 0 and len(updates) > 1 and updates[-2].deletions):
            topic, _, message = await client.next_message()
            if topic == "/scene":
                updates.append(message)
            else:
                points = len(message.data)
        assert [each.type for each in updates[-2].deletions] == [SceneEntityDeletion.ALL]
        assert [each.id for each in updates[-1].entities] == ["scene/robot/link"]
