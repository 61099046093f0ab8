"""The servers of ``bench.treeviewer``, each in a process of its own.

    python -m bench.treeviewer_servers serve|floor|echo --url URL [--port PORT]

``serve`` is ours, on LCM's network and as a hub on PORT. ``floor`` is the least that any viewer of the protocol could
do; ``echo`` answers without any viewer. Each says that it is ready and serves until it is killed.
"""

import argparse
import asyncio
import contextlib
import gc
import os
import socket
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import lcm
import msgspec
import uvloop

from gateway.adapters.treeviewer import responses
from gateway.adapters.treeviewer.config import TreeViewerConfig
from gateway.adapters.treeviewer.protocol import REQUEST, response_channel
from gateway.adapters.treeviewer.service import TreeViewerService
from gateway.runtime.lcm.config import LcmConfig
from gateway.runtime.workers.process_tuning import tune
from gateway.scene.tree.live import LiveTree
from scenegate.lcm.udpm_socket import raise_receive_buffer
from scenegate.messages import wire


async def serve(url: str, port: int) -> None:
    tune()
    service = TreeViewerService(TreeViewerConfig(lcm=LcmConfig(url=url, tcpq_port=port)), LiveTree())
    running = asyncio.create_task(service.run())
    await service.wait_ready()
    gc.collect()
    gc.freeze()
    print("ready", service.status().get("lcm", {}).get("receive_buffer_bytes"), flush=True)
    await running


def json_reader() -> str:
    """The fastest at hand that makes objects; orjson comes with the dependency group ``bench``."""
    return "orjson" if find_spec("orjson") else "msgspec"


async def floor(url: str) -> None:
    """liblcm on the loop, JSON to objects, objects into a dict, an answer of the same size."""
    if json_reader() == "orjson":
        reader = import_module("orjson")
        dumps, loads = reader.dumps, reader.loads
    else:
        dumps, loads = msgspec.json.encode, msgspec.json.decode
    tree: dict[Any, Any] = {}
    network = lcm.LCM(url)

    def handle(channel: str, data: bytes) -> None:
        comms = wire.decode(data)
        body = loads(comms.data)
        answer: dict[str, Any] = {"timestamp": comms.utime, "status": 0, "deleted_paths": [], "missing_paths": []}
        for kind, done in (("setgeometry", "added_geometries"), ("settransform", "set_transforms")):
            for command in body[kind]:
                tree[kind, *command["path"]] = command
            answer[done] = [command["path"] for command in body[kind]]
        network.publish(response_channel(channel), wire.encode(dumps(answer)))

    network.subscribe(f"{REQUEST}.*", handle).set_queue_capacity(0)
    with_large_buffer(url)
    gc.collect()
    gc.freeze()

    def readable() -> None:
        for _ in range(64):
            if network.handle_timeout(0) == 0:
                return

    asyncio.get_running_loop().add_reader(network.fileno(), readable)
    print("ready", flush=True)
    await asyncio.Event().wait()


async def echo(url: str) -> None:
    """liblcm answering as soon as it has a message, whatever is in it: what UDP and the machine alone cost."""
    network = lcm.LCM(url)
    answer = responses.encode(responses.failed(0, "echo"))
    network.subscribe(
        f"{REQUEST}.*", lambda channel, _: network.publish(response_channel(channel), answer)
    ).set_queue_capacity(0)
    with_large_buffer(url)
    asyncio.get_running_loop().add_reader(network.fileno(), network.handle)
    print("ready", flush=True)
    await asyncio.Event().wait()


def with_large_buffer(url: str) -> None:
    """Gives liblcm, which hides its socket, the receive buffer that ours has, so that big messages arrive at all."""
    if not url.startswith("udpm"):
        return
    port = int(url.split(":")[2].split("?")[0])
    for name in os.listdir("/proc/self/fd"):  # noqa: PTH208 - names are all that is wanted
        with contextlib.suppress(OSError), socket.socket(fileno=os.dup(int(name))) as sock:
            if sock.type == socket.SOCK_DGRAM and sock.getsockname()[1] == port:
                raise_receive_buffer(sock, 64 * 1024 * 1024)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("server", choices=("serve", "floor", "echo"))
    parser.add_argument("--url", required=True, help="LCM's network")
    parser.add_argument("--port", type=int, default=0, help="of the hub of `serve`; 0: any free one")
    given = parser.parse_args()
    if given.server == "serve":
        uvloop.run(serve(given.url, given.port))
    else:
        uvloop.run({"floor": floor, "echo": echo}[given.server](given.url))


if __name__ == "__main__":
    main()
