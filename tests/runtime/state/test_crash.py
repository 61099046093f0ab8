"""kill -9 during a flood of requests: every acknowledged request is stored, and no request in part."""

from __future__ import annotations

import asyncio
import json
import os
import random
import re
import signal
import sys
from pathlib import Path
from typing import Any

import pytest

from gateway.adapters.treeviewer.protocol import REQUEST, RESPONSE, TreeViewerProtocol
from gateway.runtime.state.service import PersistentState
from gateway.runtime.state.tree_store import TreeStore
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.nodes import Node
from tests.adapters.treeviewer.conversation import decoded, message
from tests.adapters.treeviewer.transports import HubClient
from tests.runtime.state import trees
from tests.support.waiting import SECONDS

ROUNDS = 20
CLIENTS = 3
IN_FLIGHT = 16
"""Number of requests that a client sends ahead of their responses."""
ROOT = Path(__file__).parents[3]


def request(client: int, number: int) -> bytes:
    """Return a client's request with a number, which it writes into the tree. Deterministic."""
    chance = random.Random(f"{client} {number}")
    mine = f"client {client}"

    def pose() -> dict[str, Any]:
        return {"translation": [chance.random() for _ in range(3)], "quaternion": [chance.random() for _ in range(4)]}

    geometry: list[Any] = []
    kind = chance.randrange(10)
    if kind < 4:
        box = {"type": "box", "lengths": [chance.random() for _ in range(3)], "color": [1, 0, 0, chance.random()]}
        geometry = [{"path": [mine, f"box {chance.randrange(20)}", "deep"], "geometries": [box, box]}]
    elif kind == 4:
        points = [[chance.random() for _ in range(3)] for _ in range(chance.choice((5, 500)))]
        cloud = {"type": "pointcloud", "points": points, "channels": {"intensity": [p[0] for p in points]}}
        geometry = [{"path": [mine, "cloud"], "geometry": cloud}]
    elif kind == 5:
        geometry = [{"path": [mine, "bad"], "geometry": {"type": "box", "lengths": "no"}}]
    deletes = [{"path": [mine, f"box {chance.randrange(20)}"]}] if kind == 6 else []
    transforms = [
        {"path": [mine, f"box {chance.randrange(20)}"], "transform": pose()} for _ in range(chance.randrange(9))
    ]
    transforms.append(
        {"path": [mine, "number"], "transform": {"translation": [number, 0, 0], "quaternion": [1, 0, 0, 0]}}
    )
    return message({"delete": deletes, "setgeometry": geometry, "settransform": transforms}, utime=number)


class Model:
    """One client's subtree after its first requests, computed by the protocol without a state."""

    def __init__(self, client: int) -> None:
        self.client = client
        self.number = 0
        self._live = LiveTree()
        self._protocol = TreeViewerProtocol(self._live)

    def advance(self, number: int) -> Node | None:
        while self.number < number:
            self.number += 1
            self._protocol.handle(request(self.client, self.number))
        return self._live.snapshot.root.find((f"client {self.client}",))


async def flood(port: int, client: int, first: int, progress: dict[int, int], heard: asyncio.Event, enough: int) -> int:
    """Send requests until the connection breaks; return the number of the last one sent."""
    connection = await HubClient.connect(port)
    await connection.subscribe(re.escape(f"{RESPONSE}_<{client}>"))
    number = first
    try:
        while True:
            while number < progress[client] + IN_FLIGHT:
                number += 1
                await connection.publish(f"{REQUEST}_<{client}>", request(client, number))
            _, data = await connection.next()
            response = decoded(data)
            assert response["timestamp"] == progress[client] + 1, "responses come in order"
            assert "stored" not in json.dumps(response)
            progress[client] += 1
            if progress[client] >= first + enough:
                heard.set()
    except (ConnectionError, asyncio.IncompleteReadError):
        return number
    finally:
        connection.writer.close()


class ServerFactory:
    """Starts servers on one file, one after the other."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process

    @classmethod
    async def open(cls, path: Path) -> ServerFactory:
        pipe = asyncio.subprocess.PIPE
        command = (sys.executable, "-m", "tests.runtime.state.crash_server", str(path))
        return cls(await asyncio.create_subprocess_exec(*command, cwd=ROOT, stdin=pipe, stdout=pipe))

    async def start(self) -> tuple[int, int]:
        """Start the next server; return its process id and port."""
        self._process.stdin.write(b"\n")
        while not (line := await self._process.stdout.readline()).startswith(b"server"):
            assert line, "the servers' parent has ended"
        _, process, port = line.split()
        return int(process), int(port)

    async def close(self) -> None:
        self._process.kill()
        await self._process.wait()


async def crash(servers: ServerFactory, chance: random.Random, at: list[int]) -> list[tuple[int, int]]:
    """Start a server, flood it and kill it.

    Args:
        at: Number of each client's last request in the tree.

    Returns:
        For each client, the numbers of the last request that was acknowledged and of the last that was sent.
    """
    process, port = await servers.start()
    progress, heard = dict(enumerate(at)), asyncio.Event()
    clients = [
        asyncio.create_task(flood(port, client, first, progress, heard, chance.randrange(5, 60)))
        for client, first in enumerate(at)
    ]
    try:
        await heard.wait()
        await asyncio.sleep(0.02 * chance.random())  # short: every step of a commit is hit
    finally:
        os.kill(process, signal.SIGKILL)
    sent = await asyncio.gather(*clients)
    return [(progress[client], sent[client]) for client in range(CLIENTS)]


@pytest.mark.slow
async def test_acknowledged_requests_survive_kill_9(tmp_path: Path) -> None:
    path = tmp_path / "state"
    chance = random.Random(7)
    models = [Model(client) for client in range(CLIENTS)]
    at = [0] * CLIENTS
    servers = await ServerFactory.open(path)
    async with asyncio.timeout(SECONDS):
        for _ in range(ROUNDS):
            results = await crash(servers, chance, at)
            live = LiveTree()
            state = PersistentState(path)
            state.add(TreeStore(live))
            for client, (acknowledged, sent) in enumerate(results):
                mine = live.snapshot.root.find((f"client {client}",))
                pose = mine.children["number"].pose
                at[client] = int(pose[0])
                assert acknowledged <= at[client] <= sent
                expected = models[client].advance(at[client])
                assert expected is not None
                assert trees.tree(mine) == trees.tree(expected)
            await state.close()
    await servers.close()
