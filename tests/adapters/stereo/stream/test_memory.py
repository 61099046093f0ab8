"""Memory of clients that do not read, in a server process that sends zeros."""

import asyncio
import platform
import sys
from collections.abc import Callable
from typing import Any

import grpc
import pytest

from gateway.adapters.stereo.stream.grpc_server import RETURN_BYTES, SERVICE, UnsentMessages
from scenegate.camera import image_interface_pb2 as pb
from tests.support.waiting import SECONDS, until

SET_MB = 16
CLIENTS = 16
SERVER = f"""
import asyncio, os, sys
from scenegate.camera import image_interface_pb2 as pb
from gateway.runtime.logs import log_setup
from gateway.runtime.workers import process_tuning
from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.stream.subscriptions import EventHub
from gateway.adapters.stereo.stream.grpc_server import serving
from gateway.adapters.stereo.stream.subscriptions import ImageSetHub, MailboxState

async def publish(hub):
    number = 0
    while True:
        await asyncio.sleep(0.05)
        if hub.kinds_with_mailbox(MailboxState.EMPTY, MailboxState.WAITING):
            number += 1
            data = pb.ImageSet(left=pb.Image(data=bytes({SET_MB} << 20))).SerializeToString()
            for kind in hub.kinds:
                hub.publish(kind, number, data)

async def main():
    log_setup.configure("json", "error")
    process_tuning.tune()
    hub = ImageSetHub(64, 16)
    async with serving(hub, EventHub(64, 64), None, StereoConfig(port=0)) as port:
        publishing = asyncio.create_task(publish(hub))
        print(port, flush=True)
        loop = asyncio.get_running_loop()
        while await loop.run_in_executor(None, sys.stdin.readline):
            pages = int(open("/proc/self/statm").read().split()[1])
            print(sum(each.sent > 0 for each in hub), len(hub), pages * os.sysconf("SC_PAGE_SIZE") >> 20, flush=True)
        os._exit(0)

asyncio.run(main())
"""


@pytest.mark.slow
@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another allocator, which is not told to keep memory")
async def test_memory_of_unsent_messages_is_returned() -> None:
    child: Any = await asyncio.create_subprocess_exec(
        sys.executable, "-c", SERVER, stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE
    )
    reads, writes = child.stdout, child.stdin

    async def when(condition: Callable[[int, int, int], bool]) -> int:
        """Wait for a condition of (streams that got a set, streams, MB of memory) and return the MB."""
        while True:
            writes.write(b"\n")
            served, streams, megabytes = map(int, (await reads.readline()).split())
            if condition(served, streams, megabytes):
                return megabytes
            await asyncio.sleep(0.05)

    try:
        async with asyncio.timeout(SECONDS):
            port = int(await reads.readline())
            options = [("grpc.max_receive_message_length", -1), ("grpc.use_local_subchannel_pool", 1)]
            channels = [grpc.aio.insecure_channel(f"127.0.0.1:{port}", options) for _ in range(CLIENTS)]
            calls = [
                channel.unary_stream(
                    f"/{SERVICE}/StreamImageSets",
                    request_serializer=pb.ImageSetRequest.SerializeToString,
                    response_deserializer=pb.ImageSet.FromString,
                )
                for channel in channels
            ]
            asked = pb.ImageSetRequest(left_enabled=True)
            first = calls[0](asked)
            await first.read()
            first.cancel()
            before = await when(lambda served, streams, megabytes: streams == 0)
            stuck = [call(asked) for call in calls]
            await when(lambda served, streams, megabytes: served == CLIENTS)
            await when(lambda served, streams, megabytes: megabytes > before + CLIENTS * SET_MB // 2)
            for each in stuck:
                each.cancel()
            await when(lambda served, streams, megabytes: megabytes < before + CLIENTS * SET_MB // 4)
            for channel in channels:
                await channel.close()
    finally:
        child.kill()
        await child.wait()


async def test_memory_is_returned_once_for_simultaneous_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.adapters.stereo.stream.grpc_server.RETURN_SECONDS", 0.0)
    returned: list[int] = []
    unsent = UnsentMessages(lambda: returned.append(1))
    unsent.add(RETURN_BYTES - 1)
    for _ in range(10):
        await asyncio.sleep(0)
    assert not returned, "so little is kept"
    for _ in range(10):
        unsent.add(RETURN_BYTES)
    await until(lambda: len(returned) == 1)
    unsent.add(RETURN_BYTES - 1)
    unsent.add(1)
    await until(lambda: len(returned) == 2)
