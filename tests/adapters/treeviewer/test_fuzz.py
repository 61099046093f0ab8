"""Mutated requests: no crash, no leak, and valid requests in between are served."""

import asyncio
import gc
import random

import pytest

from gateway.adapters.treeviewer.config import TreeViewerConfig
from gateway.adapters.treeviewer.dispatch import Dispatcher
from gateway.adapters.treeviewer.protocol import REQUEST, TreeViewerProtocol
from gateway.runtime.lcm.config import LcmConfig
from gateway.runtime.workers.worker_pool import WorkerPool
from gateway.scene.tree.live import LiveTree
from scenegate.lcm.transport import LcmMessage
from tests.adapters.treeviewer import recordings
from tests.adapters.treeviewer.conversation import BOX, decoded, message
from tests.adapters.treeviewer.transports import resident_bytes
from tests.support.corpus import corpus_path
from tests.support.waiting import until

LARGEST = 32 * 1024
"""Maximum bytes of the messages that are mutated: bigger ones only take longer."""
GROWTH = 96 * 1024 * 1024
"""Maximum growth of the process in bytes from the first fifth of the messages to the last. The tree is cleared in
between, so that only caches and the allocator grow."""
MESH = {"type": "mesh_data", "vertices": [[0, 0, 0]] * 300, "faces": [[0, 1, 2]] * 300}
TOKENS = (
    *(b"NaN", b"-Infinity", b"1e999", b"-1", b"null", b"true", b'"', b"[", b"]", b"{", b"}", b",", b":", b"\\ud800"),
    *(b"99999999999999999999", b"\xff", b"\x00", b"0.1", b"[[", b"]]", b'"path"', b'"type":"line"', b"[]", b"{}"),
)


def seeds() -> list[bytes]:
    """Return requests of real clients, or our own without a corpus."""
    found = [
        message(
            {"setgeometry": [{"path": ["a", 1], "geometries": [BOX, {"type": "line", "points": [[0, 0, 0]] * 9}]}]}
        ),
        message({"settransform": [{"path": ["a"], "transform": {"translation": [1, 2, 3]}}], "delete": [{"path": []}]}),
        message(
            {
                "setproperty": [{"path": ["a"], "visible": False, "opacity": 0.5}],
                "setview": {"background": [1, 0, 0], "grid": None, "home": {"eye": [1, 2, 3], "target": [0, 0, 0]}},
                "setclicks": [{"path": ["a", 1]}],
                "setcontrols": [
                    {"path": ["a"], "type": "slider", "min": 0, "max": 1, "value": 0.5},
                    {"path": ["b"], "type": "dropdown", "options": ["x", "y"]},
                    {"path": ["c"], "type": "plot", "series": ["s"]},
                    {"path": ["d"], "type": "gizmo", "node": ["a", 1]},
                ],
                "setvalues": [{"path": ["a"], "value": 1}, {"path": ["c"], "samples": [[0, 1], [1, 2]]}],
            }
        ),
        message({"setgeometry": [{"path": ["m"], "geometry": MESH}]}),
    ]
    if corpus_path() is not None:
        for name in recordings.names():
            sizes: dict[int, bytes] = {}
            for event in recordings.events(name):
                if event.channel.startswith(REQUEST) and 48 < len(event.data) <= LARGEST:
                    sizes.setdefault(len(event.data) // 16, event.data)
            found += sizes.values()
    return found


class Mutator:
    """Mutates messages; the same seed gives the same mutations."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)
        self._seeds = seeds()

    def message(self) -> bytes:
        r = self._random
        data = bytearray(r.choice(self._seeds))
        header = 48
        for _ in range(r.randint(1, 4)):
            low = header if r.random() < 0.9 and len(data) > header else 0
            at = r.randrange(low, len(data) + 1)
            match r.randrange(8):
                case 0:
                    data[at : at + 1] = bytes([r.randrange(256)])
                case 1:
                    data[at : at + 1] = bytes([data[at % len(data)] ^ (1 << r.randrange(8))] if data else b"x")
                case 2:
                    del data[at : at + r.randint(1, 30)]
                case 3:
                    data[at:at] = r.choice(TOKENS)
                case 4:
                    other = r.choice(self._seeds)
                    begin = r.randrange(len(other))
                    data[at : at + r.randint(0, 50)] = other[begin : begin + r.randint(1, 200)]
                case 5:
                    piece = data[at : at + r.randint(1, 60)]
                    data[at:at] = piece * r.randint(1, 8)
                case 6:
                    data[at : at + r.randint(1, 8)] = r.choice(TOKENS)
                case 7 if r.random() < 0.2:
                    del data[at:]
        if r.random() < 0.8 and len(data) > header:  # else the length is wrong, and the data is not read
            data[44:48] = (len(data) - header).to_bytes(4, "big")
        return bytes(data)


@pytest.mark.parametrize("count", [3000, pytest.param(100_000, marks=pytest.mark.slow)])
async def test_mutated_messages_of_real_clients(count: int) -> None:
    config = TreeViewerConfig(lcm=LcmConfig(url="off", tcpq_port=None))
    live = LiveTree()
    sent: list[bytes] = []
    dispatcher = Dispatcher(TreeViewerProtocol(live, config.limits), config, WorkerPool(1))

    def good() -> None:
        sent.clear()
        request = {
            "delete": [{"path": []}],
            "setgeometry": [{"path": ["good"], "geometry": BOX}],
            "settransform": [{"path": ["good"], "transform": {}}],
        }
        dispatcher.receive(lambda _, data: sent.append(data), LcmMessage(f"{REQUEST}_<good>", message(request)))
        answer = decoded(sent[-1])
        assert (answer["status"], answer["set_transforms"], answer["missing_paths"]) == (0, [["good"]], [])

    mutator = Mutator(count)
    statuses: dict[int, int] = {}

    def heard(_: str, data: bytes) -> None:
        status = decoded(data)["status"]
        statuses[status] = statuses.get(status, 0) + 1

    early = 0
    for number in range(count):
        if number % 200 == 0:
            good()
            await asyncio.sleep(0)
        dispatcher.receive(heard, LcmMessage(f"{REQUEST}_<bad>", mutator.message()))
        await until(lambda: dispatcher.queues.waiting_bytes == 0)
        if number == count // 5:
            gc.collect()
            early = resident_bytes()
    good()
    gc.collect()
    grown = resident_bytes() - early
    await dispatcher.close()
    counters = dispatcher.counters
    assert counters.internal_errors == 0
    assert counters.undecodable + sum(statuses.values()) == count
    assert set(statuses) >= {0, -3, -1, -2}
    assert statuses[0] + statuses.get(1, 0) > count // 20, "damage that is too heavy tests nothing"
    assert grown < GROWTH
