"""gRPC server: health, reflection, TLS, errors."""

import asyncio
from pathlib import Path

import grpc
import pytest
from grpc_health.v1 import health_pb2, health_pb2_grpc
from grpc_reflection.v1alpha.proto_reflection_descriptor_database import ProtoReflectionDescriptorDatabase

from gateway.adapters.stereo.device.camera_config import Tls
from scenegate.camera import image_interface_pb2 as pb
from tests.adapters.stereo.conftest import Camera, Start
from tests.support.certificates import certificate
from tests.support.waiting import SECONDS


@pytest.mark.parametrize("method", ["/ImageInterface/StreamImageSets", "/ImageEventsInterface/StreamImageEvents"])
async def test_rejects_undecodable_requests(start: Start, method: str) -> None:
    camera = await start()
    with pytest.raises(grpc.aio.AioRpcError) as refusal:
        async for _ in camera.channel.unary_stream(method)(b"\xff\xff\xff", timeout=SECONDS):
            pass
    assert refusal.value.code() == grpc.StatusCode.INVALID_ARGUMENT
    assert "the 3 bytes of the request are not a message Image" in refusal.value.details()


async def test_health_and_reflection(start: Start) -> None:
    camera = await start()
    stub = health_pb2_grpc.HealthStub(camera.channel)
    for name in ("", "ImageInterface", "ImageEventsInterface"):
        response = await stub.Check(health_pb2.HealthCheckRequest(service=name))
        assert response.status == health_pb2.HealthCheckResponse.SERVING

    def look() -> tuple[list[str], list[str]]:
        with grpc.insecure_channel(f"127.0.0.1:{camera.service.port}") as channel:
            database = ProtoReflectionDescriptorDatabase(channel)
            file = database.FindFileContainingSymbol("ImageInterface")
            return list(database.get_services()), [m.name for m in file.message_type]

    services, messages = await asyncio.to_thread(look)
    assert "ImageInterface" in services
    assert "ImageSetRequest" in messages


async def test_a_taken_port_is_one_sentence(start: Start) -> None:
    camera = await start()
    with pytest.raises(OSError, match=r"^the stereo camera cannot listen on 127.0.0.1:\d+: the port is taken"):
        await start(port=camera.service.port)


async def test_tls_with_client_certificates(start: Start, tmp_path: Path) -> None:
    pem, key = certificate(tmp_path, "camera")
    client_pem, client_key = certificate(tmp_path, "client")
    camera = await start(tls=Tls(pem, key, client_pem))
    target = f"127.0.0.1:{camera.service.port}"

    async def first(credentials: grpc.ChannelCredentials) -> pb.ImageSet:
        async with grpc.aio.secure_channel(target, credentials) as channel:
            (image_set,) = await Camera(camera.service, channel, camera.task).take(left_enabled=True)
            return image_set

    trusted = grpc.ssl_channel_credentials(pem.read_bytes(), client_key.read_bytes(), client_pem.read_bytes())
    assert (await first(trusted)).HasField("left")
    with pytest.raises(grpc.aio.AioRpcError):
        await first(grpc.ssl_channel_credentials(pem.read_bytes()))
    with pytest.raises(grpc.aio.AioRpcError):
        await camera.stream(left_enabled=True).read()


async def test_a_certificate_that_cannot_be_read_is_one_sentence(start: Start, tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"the stereo camera cannot read .*missing\.key: No such file"):
        await start(tls=Tls(tmp_path / "x.pem", tmp_path / "missing.key"))
