"""The client with the service over TCPQ and UDP, with a viewer that restarts, and without a viewer."""

import asyncio
import contextlib
import os
import socket
import subprocess
import sys
import threading
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from gateway.adapters.treeviewer.config import TreeViewerConfig
from gateway.runtime.lcm.config import LcmConfig
from gateway.scene.tree.live import LiveTree
from scenegate import (
    AsyncTreeViewer,
    Box,
    CameraFrustum,
    ImagePlane,
    MeshFile,
    PointCloud,
    Sphere,
    Text,
    TreeViewer,
    TreeViewerError,
)
from scenegate.messages import wire
from scenegate.messages.request_encoding import encode_request
from scenegate.messages.wire import UNKNOWN_FORMAT
from scenegate.tree import viewer
from tests.adapters.treeviewer.transports import free_url, join, serving
from tests.client.conftest import hub_of, in_thread, talk_to
from tests.support.ports import free_ports
from tests.support.waiting import SECONDS, until

pytestmark = [pytest.mark.lcm, pytest.mark.usefixtures("lcm")]


def paths(live: LiveTree) -> set[tuple[str | int, ...]]:
    """Return the paths of all nodes with geometry."""
    return {path for path, node in live.snapshot.root.walk() if node.parts is not None}


def tour(url: str, binary: bool | None) -> None:
    with TreeViewer(url, timeout=SECONDS, binary=binary) as tree_viewer:
        answer = tree_viewer["robot"]["base"].set(Box((1, 2, 3)), Sphere(1), transform=(0, 0, 1))
        assert (answer.status, answer.added, answer.transformed) == (0, (("robot", "base"),), (("robot", "base"),))
        assert tree_viewer["robot/arm"][0].set(PointCloud(np.zeros((5, 3)))).added == (("robot", "arm", 0),)
        image = np.zeros((40, 50, 3), np.uint8)
        shown = tree_viewer["sign"].set(
            Text("exit"), ImagePlane(image, width=1), CameraFrustum(50, 40, 30, image=image)
        )
        assert (shown.added, shown.warnings) == ((("sign",),), ())
        tree_viewer["sign"].delete()
        assert tree_viewer["nobody"].transform((1, 2, 3)).missing == (("nobody",),)
        with tree_viewer.batch() as batch:
            batch["x"].set(Sphere(1))
            batch["y"].set(Sphere(1), transform=np.eye(4))
            batch["x"].delete()
        assert batch.answer is not None
        assert (batch.answer.added, batch.answer.deleted) == ((("y",),), (("x",),))
        with pytest.raises(ValueError, match="lengths must have 3"):
            half_a_batch(tree_viewer)
        with pytest.raises(TreeViewerError, match="no folder of mesh files is open to clients") as caught:
            tree_viewer["mesh"].set(MeshFile("/etc/passwd"))
        assert caught.value.answer.status == -3
        with pytest.raises(TypeError, match=r"Box\(\(1, 1, 1\)\).* 'box'"):
            tree_viewer["robot"].set("box")  # type: ignore[arg-type]  # the error is tested
        assert tree_viewer["robot"]["base"].delete().deleted == (("robot", "base"),)


def half_a_batch(tree_viewer: TreeViewer) -> None:
    with tree_viewer.batch() as batch:
        batch["z"].set(Sphere(1))
        batch["z"].set(Box((1, 2)))


@pytest.mark.parametrize("binary", [None, True, False])
async def test_over_tcpq(binary: bool | None) -> None:
    live = LiveTree()
    async with serving(live=live) as service:
        await in_thread(tour, hub_of(service), binary)
        assert paths(live) == {("robot", "arm", 0), ("y",)}
        assert service.status()["internal_errors"] == 0


async def test_over_udp() -> None:
    url, live = free_url(), LiveTree()
    join(url)
    async with serving(TreeViewerConfig(lcm=LcmConfig(url=url, tcpq_port=None)), live=live):
        await in_thread(tour, url, None)
        assert paths(live) == {("robot", "arm", 0), ("y",)}


async def test_a_million_points_over_tcpq() -> None:
    live = LiveTree()

    def publish(tree_viewer: TreeViewer) -> None:
        points = np.zeros((1_000_000, 3), np.float32)
        assert tree_viewer["cloud"].set(PointCloud(points, colors=points.astype(np.uint8))).status == 0

    async with serving(live=live) as service:
        await talk_to(service, publish)
        node = live.snapshot.root.find(("cloud",))
        assert node is not None
        assert node.parts is not None
        shape: Any = node.parts[0].shape
        assert shape.points.shape == shape.channels["rgb"].shape == (1_000_000, 3)


async def test_async_client() -> None:
    live = LiveTree()
    async with serving(live=live) as service:
        with pytest.raises(RuntimeError, match="enter the viewer first"):
            AsyncTreeViewer(timeout=SECONDS)["a"]
        async with AsyncTreeViewer(hub_of(service), timeout=SECONDS) as tree_viewer:
            answers = await asyncio.gather(*(tree_viewer["swarm"][i].set(Sphere(1)) for i in range(20)))
            assert {answer.status for answer in answers} == {0}
            await tree_viewer["swarm"][0].transform((1, 2, 3))
            async with tree_viewer.batch() as batch:
                batch["swarm", 1].delete()
            assert len(paths(live)) == 19
            await tree_viewer.delete()
        assert paths(live) == set()


async def test_sends_missing_geometry_again() -> None:
    live = LiveTree()

    def talk(tree_viewer: TreeViewer) -> None:
        tree_viewer["robot"].transform((5, 0, 0))
        tree_viewer["robot"]["base"].set(Box((1, 1, 1)))
        tree_viewer["other"].set(Box((1, 1, 1)))
        with live.edit() as edit:
            edit.delete(())
        answer = tree_viewer["robot"]["base"].transform((0, 0, 1))
        assert (answer.status, answer.missing) == (0, ())

    async with serving(live=live) as service:
        await talk_to(service, talk)
        assert paths(live) == {("robot", "base")}
        robot = live.snapshot.root.find(("robot",))
        assert robot is not None
        assert robot.matrix[0, 3] == 5.0


async def test_what_cannot_be_sent_is_not_sent_again() -> None:
    (port,) = free_ports(1)
    config = TreeViewerConfig(lcm=LcmConfig(url="off", tcpq_port=port))

    def fail(tree_viewer: TreeViewer) -> None:
        with pytest.raises(ValueError, match=r"^'\\ud800' is not Unicode text$"):
            tree_viewer["\ud800"].set(Box((1, 1, 1)))
        with pytest.raises(ValueError, match="more than 64 bits"):
            tree_viewer[2**70].set(Box((1, 1, 1)))

    async with serving(config):
        tree_viewer = await in_thread(TreeViewer, f"tcpq://127.0.0.1:{port}", 20.0)
        await in_thread(fail, tree_viewer)  # before the format is negotiated
        await in_thread(tree_viewer["robot"].set, Box((1, 1, 1)))
        await in_thread(fail, tree_viewer)
    live = LiveTree()
    try:
        async with serving(config, live=live):
            await until(lambda: paths(live) == {("robot",)})
    finally:
        await in_thread(tree_viewer.close)


async def test_falls_back_to_json(monkeypatch: pytest.MonkeyPatch) -> None:
    live = LiveTree()
    async with serving(live=live) as service:
        monkeypatch.delitem(service.protocol.readers, wire.BINARY)

        def talk() -> None:
            with TreeViewer(hub_of(service), timeout=SECONDS) as tree_viewer:
                assert tree_viewer["a"].set(Sphere(1)).status == 0
                assert tree_viewer.requests.message_format == wire.JSON
            with (
                TreeViewer(hub_of(service), timeout=SECONDS, binary=True) as tree_viewer,
                pytest.raises(TreeViewerError) as caught,
            ):
                tree_viewer["b"].set(Sphere(1))
            assert caught.value.answer.status == UNKNOWN_FORMAT

        await in_thread(talk)
        assert paths(live) == {("a",)}


def test_a_timeout_is_positive() -> None:
    for timeout in (0.0, -1.0, float("nan")):
        with pytest.raises(ValueError, match="positive number of seconds"):
            TreeViewer("tcpq://127.0.0.1:1", timeout=timeout)


def test_off_is_no_network(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LCM_DEFAULT_URL", "off")
    with pytest.raises(ConnectionError, match="URL 'off'"):
        TreeViewer(timeout=SECONDS)


def test_a_url_is_a_text() -> None:
    port: Any = 7700
    with pytest.raises(ValueError, match=r"^url .*7700"):
        TreeViewer(port, timeout=SECONDS)


def test_a_connection_that_is_late_ends() -> None:
    """It is closed before its thread connects, or just when it does."""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        url = f"tcpq://127.0.0.1:{silent.getsockname()[1]}"
        for _ in range(50):
            with contextlib.suppress(ConnectionError):
                TreeViewer(url, timeout=1e-9).close()  # short: it shall be late


def test_reports_timeout() -> None:
    url = free_url()
    join(url)
    with (
        TreeViewer(url, timeout=0.05) as tree_viewer,  # short: no viewer
        pytest.raises(TimeoutError, match=r"0\.05 s on udpm:.* big messages"),
    ):
        tree_viewer["a"].set(Sphere(1))
    assert not tree_viewer.requests.pending
    with pytest.raises(ConnectionError, match="closed"):
        tree_viewer["a"].delete()


async def test_names_a_peer_that_is_no_hub(monkeypatch: pytest.MonkeyPatch) -> None:
    """Such as the gateway's HTTP port."""
    monkeypatch.setattr("scenegate.lcm.tcpq_transport.RETRY_SECONDS", SECONDS)  # the reason of the first attempt stays

    async def refuse(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"HTTP/1.1 400 Bad Request")
        with contextlib.suppress(ConnectionError):
            await reader.read()
        writer.close()

    def talk(url: str) -> None:
        with TreeViewer(url, timeout=0.3) as tree_viewer:  # short: no hub
            tree_viewer["a"].set(Sphere(1))

    server = await asyncio.start_server(refuse, "127.0.0.1", 0)
    async with server:
        url = f"tcpq://127.0.0.1:{server.sockets[0].getsockname()[1]}"
        with pytest.raises((ConnectionError, TimeoutError), match="it does not speak TCPQ"):
            await in_thread(talk, url)


def test_reports_missing_network(monkeypatch: pytest.MonkeyPatch) -> None:
    (port,) = free_ports(1)
    with pytest.raises(ConnectionError, match="no hub listens there"):
        TreeViewer(f"tcpq://127.0.0.1:{port}", timeout=0.05)  # short: no hub
    with pytest.raises(ConnectionError, match="must begin with udpm://, tcpq://"):
        TreeViewer("bogus://here", timeout=SECONDS)
    monkeypatch.setattr("socket.getaddrinfo", Mock(side_effect=socket.gaierror))
    with pytest.raises(ConnectionError, match=r"the host 'no-such-host\.invalid' is unknown"):
        TreeViewer("tcpq://no-such-host.invalid", timeout=0.5)  # short: no hub


def test_ignores_foreign_messages() -> None:
    url, before = free_url(), set(threading.enumerate())
    other = join(url)
    with TreeViewer(url, timeout=0.05) as tree_viewer:  # short: no viewer
        threads = set(threading.enumerate()) - before
        ready = bytes(encode_request({"timestamp": 0, "status": 0, "ready": True}, 0, wire.JSON))
        for message in (b"", b"junk", ready):
            other.publish(wire.RESPONSE, message)
            other.publish(f"{wire.RESPONSE}_<{tree_viewer.requests.client_id}>", message)
        with pytest.raises(TimeoutError):
            tree_viewer["a"].set(Sphere(1))
        assert threads
        assert all(thread.is_alive() for thread in threads)


FORK = """
import os, sys
from scenegate import Box, TreeViewer
with TreeViewer(sys.argv[1]) as viewer:
    if (child := os.fork()) == 0:
        try:
            viewer["a"].set(Box((1, 1, 1)))
        except ConnectionError as error:
            os.write(1, str(error).encode())
        os._exit(0)
    os.waitpid(child, 0)
    viewer["b"].set(Box((1, 1, 1)))
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork")
async def test_a_forked_child_is_told_at_once() -> None:
    live = LiveTree()
    async with serving(live=live) as service:
        command = [sys.executable, "-W", "ignore", "-c", FORK, hub_of(service)]
        done = await in_thread(lambda: subprocess.run(command, capture_output=True, text=True, check=True))
        assert "fork" in done.stdout
        assert paths(live) == {("b",)}


def test_imports_nothing_of_the_server_and_no_extra() -> None:
    code = (
        "import sys; from scenegate import TreeViewer, AsyncTreeViewer, Box; "
        "print([m for m in sys.modules if m.partition('.')[0] in "
        "('gateway', 'renderers', 'numba', 'grpc', 'google', 'PIL', 'lcm', 'structlog', 'pytest')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["[]"]


def test_names_of_the_package() -> None:
    import scenegate as package

    assert {name for name in package.__all__ if getattr(package, name) is not None} == set(package.__all__)
    assert package.TreeViewer is viewer.TreeViewer
    assert [name for name in dir(package) if not name.startswith("__")] == package.__all__
    with pytest.raises(AttributeError):
        _ = package.Nothing  # type: ignore[attr-defined]  # at run time, too


async def test_no_stderr_output_on_success(capfd: pytest.CaptureFixture[str]) -> None:
    async with serving() as service:
        await talk_to(service, lambda tree_viewer: tree_viewer["a"].set(Sphere(1)))
    assert capfd.readouterr().err == ""


def test_no_stderr_output_without_a_hub(capfd: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        url = f"tcpq://127.0.0.1:{taken.getsockname()[1]}"
    with pytest.raises(ConnectionError, match="no hub listens there"):
        TreeViewer(url, timeout=0.5)  # short: no hub
    assert capfd.readouterr().err == ""
