"""Missing libraries and unreachable networks are reported in one sentence, and everything else works."""

import builtins
import sys
from typing import Any

import pytest

from gateway.adapters.treeviewer.config import TreeViewerConfig
from gateway.adapters.treeviewer.protocol import REQUEST
from gateway.runtime.lcm.config import LcmConfig
from gateway.scene.tree.live import LiveTree
from scenegate.lcm import liblcm_transport
from scenegate.lcm.transport import LcmMessage, LcmUnavailableError
from tests.adapters.treeviewer.transports import config_of, serving
from tests.support.liblcm import liblcm


@pytest.fixture
def without_lcm(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the import of lcm fail, as on a machine without libglib."""
    monkeypatch.delitem(sys.modules, "lcm", raising=False)
    real = builtins.__import__

    def fail(name: str, *args: Any, **kwargs: Any) -> Any:
        if name == "lcm":
            raise ImportError("No module named 'lcm.Release'")
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", fail)


@pytest.mark.usefixtures("without_lcm")
async def test_hub_works_without_libglib() -> None:
    live = LiveTree()
    async with serving(TreeViewerConfig(lcm=LcmConfig(url="memq://", tcpq_port=0)), live=live) as service:
        assert service.tcpq_port
        assert "libglib-2.0.so.0: apt install libglib2.0-0" in service.status()["lcm"]["problem"]


@pytest.mark.usefixtures("without_lcm")
async def test_service_fails_without_any_transport() -> None:
    with pytest.raises(LcmUnavailableError, match="libglib"):
        async with serving(TreeViewerConfig(lcm=LcmConfig(url="memq://", tcpq_port=None))):
            pass


@pytest.mark.lcm
async def test_udp_multicast_works_without_libglib(url: str, without_lcm: None) -> None:
    async with serving(config_of(url)) as service:
        assert service.status()["lcm"]["lost_datagrams"] == 0


async def test_liblcm_transport_limits_its_queue() -> None:
    liblcm()
    transport = liblcm_transport.LiblcmTransport("memq://", f"{REQUEST}.*", max_queued_bytes=3000)
    for _ in range(20):
        transport.queue.put(LcmMessage("c", b"x" * 744))
    assert transport.status() == {"url": "memq://", "waiting_bytes": 3000, "dropped": 17, "dropped_bytes": 17 * 744}
    await transport.close()


@pytest.mark.lcm
@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (
            "bogus://x",
            "LCM cannot join bogus://x: the URL must begin with udpm://, tcpq://, mpudpm://, memq://, file://",
        ),
        ("bogus", "LCM cannot join bogus: the URL must begin with udpm://"),
        (
            "udpm://10.1.2.3:7667",
            "LCM cannot join udpm://10.1.2.3:7667: 10.1.2.3 is not a multicast address (224.0.0.0",
        ),
        ("udpm://robot:7667", "LCM cannot join udpm://robot:7667: robot is not a multicast address"),
        ("udpm://239.255.76.67:99999", "LCM cannot join udpm://239.255.76.67:99999: its port is not a number"),
        ("udpm://?ttl=far", "LCM cannot join udpm://?ttl=far: ttl must be a number of 0 to 255, not 'far'"),
        ("tcpq://host:port", "LCM cannot join tcpq://host:port: its port is not a number"),
    ],
)
async def test_reports_invalid_urls(url: str, bad: str, reason: str) -> None:
    with pytest.raises(LcmUnavailableError) as caught:
        async with serving(TreeViewerConfig(lcm=LcmConfig(url=bad, tcpq_port=None))):
            pass
    assert str(caught.value).startswith(reason)


async def test_liblcm_refuses_too_many_open_files(monkeypatch: pytest.MonkeyPatch) -> None:
    liblcm()
    monkeypatch.setattr(liblcm_transport, "MAX_OPEN_FILES", 3)
    with pytest.raises(LcmUnavailableError, match="open files"):
        liblcm_transport.LiblcmTransport("memq://", "x", 1)
