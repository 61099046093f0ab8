"""The service on the event loop: threads, the newest message, channels that are not shown."""

import asyncio
import contextlib
import threading
from collections.abc import AsyncIterator, Coroutine
from pathlib import Path
from typing import Any

import pytest
from structlog.testing import capture_logs

from gateway.adapters.drakeviewer.channels import PREFIXES
from gateway.adapters.drakeviewer.config import DrakeViewerConfig
from gateway.adapters.drakeviewer.service import DrakeViewerService
from gateway.adapters.treeviewer.config import TreeViewerConfig
from gateway.adapters.treeviewer.service import TreeViewerService
from gateway.files.assets.mesh_files import MeshFiles
from gateway.runtime.lcm.config import LcmConfig
from gateway.runtime.lcm.listener import ChannelListener
from gateway.runtime.logs.warning_list import MAX_LISTED
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.nodes import Path as TreePath
from renderers.stop import check_stop
from scenegate.lcm.transport import LcmMessage
from tests.adapters.drakeviewer.encoding import IDENTITY, MESH, SPHERE, draw, geometry, link, load
from tests.adapters.treeviewer.transports import free_url, join
from tests.support.liblcm import liblcm
from tests.support.waiting import SECONDS, until

LOAD, DRAW = "DRAKE_VIEWER_LOAD_ROBOT", "DRAKE_VIEWER_DRAW"
TCPQ = LcmConfig(url="off", tcpq_port=0)
ROBOT = load(link("a", 1, geometry(SPHERE, [1.0])))


class Running:
    def __init__(
        self,
        config: DrakeViewerConfig | None = None,
        files: MeshFiles | None = None,
        local_files: MeshFiles | None = None,
    ) -> None:
        self.live = LiveTree()
        self.service = DrakeViewerService(self.live, files or MeshFiles(()), config, local_files)

    def receive(self, channel: str, data: bytes, is_local: bool = False, arrival: int = 1) -> None:
        self.service.receive(LcmMessage(channel, data, is_local, arrival))

    def x(self) -> float | None:
        node = self.live.snapshot.root.find(("drake", "illustration", "a"))
        return None if node is None or node.pose is None else node.pose[0]


@contextlib.asynccontextmanager
async def background(work: Coroutine[Any, Any, None]) -> AsyncIterator[None]:
    task = asyncio.create_task(work)
    try:
        yield
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


@contextlib.asynccontextmanager
async def running(
    config: DrakeViewerConfig | None = None, files: MeshFiles | None = None, local_files: MeshFiles | None = None
) -> AsyncIterator[Running]:
    found = Running(config, files, local_files)
    async with background(found.service.run()):
        await until(lambda: found.service.ready)
        yield found


class SlowFiles(MeshFiles):
    """Files that are read until ``released`` is set, or the call is stopped."""

    def __init__(self) -> None:
        super().__init__(())
        self.reading, self.released, self.ended = threading.Event(), threading.Event(), threading.Event()

    def load(
        self, filename: str, scale: tuple[float, float, float] = (1.0, 1.0, 1.0), warnings: list[str] | None = None
    ) -> tuple[Part, ...]:
        self.reading.set()
        try:
            while not self.released.wait(0.01):  # short: between two checks
                check_stop()
        finally:
            self.ended.set()
        return super().load(filename, scale, warnings)


def at(x: float) -> bytes:
    return draw({(1, "a"): (x, *IDENTITY[1:])})


async def test_draws_wait_for_their_load_and_the_newest_is_shown() -> None:
    async with running() as found:
        found.receive(LOAD, ROBOT)
        for x in range(10):
            found.receive(DRAW, at(x))
        assert found.x() is None
        await until(lambda: found.x() == 9.0)
        status = found.service.status()
        assert status["superseded"] == 9
        assert status["families"]["illustration"]["stale"] == 0
        assert status["channels"] == {LOAD: 1, DRAW: 10}
        assert status["simulation_seconds"] == 1.0
        found.receive(DRAW, at(10))
        assert found.x() == 10.0, "small messages are shown at once"


async def test_big_messages_are_read_in_a_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    async with running(DrakeViewerConfig(offload_bytes=10)) as found:
        threads = []
        read = found.service.viewer.read

        def watched(*arguments: Any) -> Any:
            threads.append(threading.current_thread().name)
            return read(*arguments)

        monkeypatch.setattr(found.service.viewer, "read", watched)
        found.receive(LOAD, ROBOT)
        found.receive(DRAW, at(1))
        await until(lambda: found.x() == 1.0)
        assert all(name.startswith("drakeviewer") for name in threads)


async def test_unshown_channels_are_said_once() -> None:
    with capture_logs() as log:
        async with running() as found:
            for _ in range(3):
                found.receive("DRAKE_VIEWER_STATUS", b"")
                found.receive("CONTACT_RESULTS_OTHER", b"")
            status = found.service.status()
    assert status["unshown_channels"] == {"DRAKE_VIEWER_STATUS": 3, "CONTACT_RESULTS_OTHER": 3}
    assert status["warnings"] == ["received, but not shown: DRAKE_VIEWER_STATUS, CONTACT_RESULTS_OTHER"]
    assert [entry["channel"] for entry in log] == ["DRAKE_VIEWER_STATUS", "CONTACT_RESULTS_OTHER"]


async def test_damage_is_counted_and_logged_once() -> None:
    with capture_logs() as log:
        async with running() as found:
            for _ in range(3):
                found.receive(DRAW, b"damaged!")
            found.receive(LOAD, b"damaged!")
            await until(lambda: found.service.viewer.counters.undecodable == 4)
            status = found.service.status()
    assert [warning.partition(":")[0] for warning in status["warnings"]] == [LOAD, DRAW]
    assert [entry["channel"] for entry in log] == [DRAW, LOAD]


async def test_stale_draws_are_logged_once() -> None:
    with capture_logs() as log:
        async with running() as found:
            found.receive(LOAD, ROBOT)
            found.receive(DRAW, at(1))
            await until(lambda: found.x() == 1.0)
            for _ in range(3):
                found.receive(DRAW, draw({(1, "other"): IDENTITY}))
            assert found.service.status()["families"]["illustration"]["stale"] == 3
            found.receive(DRAW, at(2))
            assert found.x() == 2.0
    assert [entry["reason"] for entry in log] == ["its 1 links are not the 1 that are loaded"]


async def test_a_slow_file_delays_only_its_family_and_ends_at_shutdown() -> None:
    files = SlowFiles()
    async with running(files=files) as found:
        found.receive(LOAD, load(link("slow", 1, geometry(MESH, [], string="endless.obj"))))
        found.receive(DRAW, at(1.0))
        await until(files.reading.is_set)
        found.receive(f"{LOAD}_PROXIMITY", ROBOT)
        found.receive(f"{DRAW}_PROXIMITY", at(2.0))
        await until(lambda: found.live.snapshot.root.find(("drake", "proximity", "a")))
        assert found.live.snapshot.root.find(("drake", "illustration")) is None
        assert not files.ended.is_set()
    assert files.ended.wait(SECONDS)


async def test_limits_on_channels_and_waiting_bytes() -> None:
    async with running(DrakeViewerConfig(channels=1, waiting_bytes=len(ROBOT) + 1)) as found:
        found.receive(DRAW, at(1))
        found.receive("DRAKE_DRAW_FRAMES", at(1))
        assert found.service.status()["dropped"] == 1
        found.receive(DRAW + "_PROXIMITY", at(1))  # the limit is for channels of any name only
        assert found.service.status()["dropped"] == 1
        found = Running(DrakeViewerConfig(shown_bytes=2 * len(at(1))))
        found.service.ready = True
        for channel in (DRAW, DRAW, "DRAKE_DRAW_FRAMES", "DRAKE_DRAW_FRAMES_B"):
            found.receive(channel, at(1))
        assert found.service.status()["dropped"] == 1
        assert "DRAKE_DRAW_FRAMES_B: 58 bytes are too many" in found.service.status()["warnings"][0]
        found = Running(DrakeViewerConfig(waiting_bytes=1))
        found.service.ready = True
        found.receive(LOAD, ROBOT)
        assert found.service.status()["dropped"] == 1
        assert "waiting" in found.service.status()["warnings"][0]


@pytest.mark.parametrize("prefix", ["DRAKE_POINT_CLOUD_", "DRAKE_DRAW_FRAMES_"])
async def test_damaged_messages_take_up_no_channels(prefix: str) -> None:
    async with running(DrakeViewerConfig(channels=2)) as found:
        for number in range(20):
            found.receive(f"{prefix}{number}", b"damaged")
        status = found.service.status()
        assert (status["undecodable"], status["dropped"], status["channels"]) == (20, 0, {})
        for number in range(3):
            found.receive(f"DRAKE_DRAW_FRAMES_{number}", at(1))
        status = found.service.status()
        assert status["channels"] == {"DRAKE_DRAW_FRAMES_0": 1, "DRAKE_DRAW_FRAMES_1": 1}
        assert status["dropped"] == 1
        assert "DRAKE_DRAW_FRAMES_2: 2 channels are shown or wait" in status["warnings"][0]


async def test_channels_of_an_earlier_simulation_take_up_no_channels() -> None:
    async with running(DrakeViewerConfig(channels=3)) as found:
        for simulation in range(3):
            names = [f"DRAKE_DRAW_FRAMES_{simulation}{end}" for end in "ab"]
            for name in names:
                found.receive(name, at(1))
            assert set(found.service.status()["channels"]) == {*names, *([LOAD] if simulation else [])}
            found.receive(LOAD, load(link(f"robot {simulation}", 1)))
            await until(lambda: found.service.status()["loads"] == simulation + 1)  # noqa: B023 - used at once
        assert found.service.status()["dropped"] == 0
        assert set(found.service.status()["channels"]) == {LOAD}


async def test_frames_received_before_a_thread_reads_the_load_message_are_kept() -> None:
    files = SlowFiles()
    async with running(DrakeViewerConfig(threads=1), files) as found:
        try:
            found.receive(LOAD, load(link("a", 1, geometry(MESH, [1.0, 1.0, 1.0], string="slow.obj"))))
            await until(files.reading.is_set)
            found.receive(f"{LOAD}_PROXIMITY", ROBOT)  # waits for the one thread
            for milliseconds in (0, 1000):
                found.receive(f"{DRAW}_PROXIMITY", draw({(1, "a"): IDENTITY}, milliseconds))
                found.receive("DRAKE_DRAW_FRAMES", draw({(0, "f"): IDENTITY}))
        finally:
            files.released.set()
        await until(lambda: found.service.status()["loads"] == 2)
        await until(lambda: not found.live.unapplied_arrivals)
        assert found.live.snapshot.root.find(("drake", "frames", "default", "f")) is not None


async def test_waiting_messages_of_new_channels_are_limited() -> None:
    async with running(DrakeViewerConfig(channels=2, offload_bytes=1)) as found:
        for number in range(4):
            found.receive(f"DRAKE_POINT_CLOUD_{number}", b"damaged")
        assert found.service.status()["dropped"] == 2
        await until(lambda: found.service.status()["undecodable"] == 2)
        found.receive("DRAKE_DRAW_FRAMES", at(1))
        await until(lambda: found.service.status()["channels"] == {"DRAKE_DRAW_FRAMES": 1})


@contextlib.asynccontextmanager
async def hub_of(found: Running, lcm: LcmConfig = TCPQ) -> AsyncIterator[str]:
    listener = ChannelListener(PREFIXES, found.service.receive)
    hub = TreeViewerService(TreeViewerConfig(lcm=lcm), found.live, listeners=[listener])
    async with background(hub.run()):
        await hub.wait_ready()
        yield f"tcpq://127.0.0.1:{hub.tcpq_port}"


async def test_messages_pass_the_tree_viewers_hub() -> None:
    lcm = liblcm()
    async with running() as found, hub_of(found) as url:
        client = await asyncio.to_thread(lcm.LCM, url)
        await asyncio.to_thread(client.publish, LOAD, ROBOT)
        await asyncio.to_thread(client.publish, DRAW, at(3))
        await asyncio.to_thread(client.publish, "OTHER", b"")
        await until(lambda: found.x() == 3.0)
        assert set(found.service.status()["channels"]) == {LOAD, DRAW}


@pytest.mark.lcm
async def test_messages_by_multicast() -> None:
    url = free_url()
    client = join(url)
    async with running() as found, hub_of(found, LcmConfig(url=url, tcpq_port=None)):
        for channel, message in ((LOAD, ROBOT), ("OTHER", b""), (DRAW, at(3))):
            client.publish(channel, message)
        await until(lambda: found.x() == 3.0)
        assert set(found.service.status()["channels"]) == {LOAD, DRAW}


async def test_programs_on_this_machine_name_files_in_all_folders(tmp_path: Path) -> None:
    (tmp_path / "t.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\n")
    message = load(link("a", 1, geometry(MESH, [1.0], string=str(tmp_path / "t.obj"))))
    async with running(files=MeshFiles(()), local_files=MeshFiles((), any_folder=True)) as found:
        for is_local in (True, False):
            found.receive(LOAD, message, is_local)
            found.receive(DRAW, at(1.0), is_local)
            await until(lambda: found.service.viewer.counters.loads == (1 if is_local else 2))  # noqa: B023 - awaited here
            await until(lambda: found.x() == 1.0)
            node: Any = found.live.snapshot.root.find(("drake", "illustration", "a"))
            assert len(node.parts or ()) == is_local
            warnings = found.service.status().get("warnings", [])
            assert is_local == (not warnings)
        assert "(--mesh-root auto)" in warnings[0]


async def test_ends_while_a_file_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    entered, leave = threading.Event(), threading.Event()

    def read(*_: object) -> None:
        entered.set()
        leave.wait(SECONDS)

    async with running() as found:
        monkeypatch.setattr(found.service.viewer, "read", read)
        found.receive(LOAD, ROBOT)
        await asyncio.to_thread(entered.wait, SECONDS)
    leave.set()
    assert not found.service.ready
    path: TreePath = ("drake",)
    assert found.live.snapshot.root.find(path) is None


@pytest.mark.parametrize(("count", "last"), [(3, "/gone2.obj"), (40, "and 21 more")])
async def test_each_thing_that_is_missing_has_a_sentence_of_its_own(count: int, last: str) -> None:
    shapes = [geometry(MESH, [], string=f"/gone{number}.obj") for number in range(count)]
    with capture_logs() as log:
        async with running() as found:
            found.receive(LOAD, load(link("a", 1, *shapes)))
            await until(lambda: found.service.status().get("warnings"))
            warnings = found.service.status()["warnings"]
    assert len(warnings) == min(count, MAX_LISTED)
    assert last in warnings[-1]
    for number in range(3):
        assert f"/gone{number}.obj" in warnings[number]
        assert f"/gone{number}.obj" in log[0]["reason"]


async def test_what_is_missing_is_a_warning_until_the_next_load_and_an_error_with_strict() -> None:
    message = load(link("a", 1, geometry(MESH, [], string="/gone.obj")))
    async with running() as found:
        found.receive(LOAD, message)
        await until(lambda: found.service.status().get("warnings"))
        assert "/gone.obj" in found.service.status()["warnings"][0]
        found.receive(LOAD, ROBOT)
        await until(lambda: "warnings" not in found.service.status())
    async with running(DrakeViewerConfig(strict=True)) as found:
        found.receive(LOAD, message)
        await until(lambda: found.service.status().get("warnings"))
        assert found.service.status()["warnings"][0].endswith("(refused: --strict)")
        assert found.live.snapshot.root.find(("drake",)) is None


async def test_a_repeated_load_keeps_its_warning_and_a_new_one_ends_those_of_its_channels() -> None:
    message = load(link("a", 1, geometry(99, [])))
    async with running() as found:
        found.receive(LOAD, message)
        await until(lambda: found.service.viewer.counters.loads == 1)
        found.receive("DRAKE_POINT_CLOUD_X", b"damaged")
        found.receive(LOAD, message)
        await until(lambda: found.service.viewer.counters.loads == 2)
        (warning,) = found.service.status()["warnings"]
        assert "geometry type 99 is unknown" in warning


async def test_messages_are_valid_from_their_arrival_however_long_they_wait() -> None:
    async with running(DrakeViewerConfig(offload_bytes=1)) as found:
        live = found.live
        found.receive(LOAD, ROBOT, arrival=10)
        found.receive(DRAW, at(3), arrival=20)
        assert (live.has_unapplied_before(9), live.has_unapplied_before(10)) == (False, True)
        await until(lambda: found.x() == 3)
        await until(lambda: not live.unapplied_arrivals)
        assert live.snapshot.timestamp == 20
