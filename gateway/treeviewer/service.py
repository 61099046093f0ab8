"""The tree viewer as a service: joins its transports with the protocol and the live tree."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, Final

import structlog

from gateway.lcm.errors import LcmUnavailable
from gateway.lcm.liblcm_transport import LcmBus
from gateway.lcm.network import join, url_of
from gateway.lcm.tcpq_hub import Hub, HubConnection
from gateway.lcm.tcpq_transport import TcpqBus
from gateway.lcm.udpm_transport import UdpmBus
from gateway.runtime.scheduling import yield_to_event_loop
from gateway.scene.live import LiveTree
from gateway.treeviewer import answers
from gateway.treeviewer.config import TreeViewerConfig
from gateway.treeviewer.dispatch import Dispatcher, Durable
from gateway.treeviewer.geometry import MeshLoader
from gateway.treeviewer.protocol import REQUEST, RESPONSE, TreeViewerProtocol

_log = structlog.get_logger("gateway.treeviewer")

OFF = "off"
PATTERN = f"{REQUEST}.*"
"""Director's own; the channel without a client id is among them."""


class TreeViewerService:
    """Runs until cancelled. One transport that cannot start is told and does not keep the other from working."""

    def __init__(
        self,
        config: TreeViewerConfig,
        live: LiveTree,
        meshfiles: MeshLoader | None = None,
        clock: Callable[[], float] = time.monotonic,
        durable: Durable | None = None,
    ) -> None:
        """``durable``: where the tree is stored; answers wait for it."""
        self._config = config
        self._protocol = TreeViewerProtocol(live, config.limits, meshfiles, clock)
        self._executors = (
            ThreadPoolExecutor(config.threads, "treeviewer-json", yield_to_event_loop),
            ThreadPoolExecutor(config.threads, "treeviewer"),
        )
        self._dispatcher = Dispatcher(self._protocol, config, *self._executors, durable)
        self._bus: LcmBus | UdpmBus | None = None
        self._remote: TcpqBus | None = None
        self._hub: Hub | None = None
        self._problems: dict[str, str] = {}
        self._started = asyncio.Event()

    @property
    def ready(self) -> bool:
        """Whether clients can use it now."""
        return self._started.is_set()

    @property
    def tcpq_port(self) -> int:
        """Where the hub listens; 0 when there is none."""
        return self._hub.port if self._hub is not None else 0

    async def wait_ready(self) -> None:
        """Returns when clients can use it."""
        await self._started.wait()

    def status(self) -> dict[str, Any]:
        """Plain JSON values: counters, and every transport with its problem if it has one."""
        described: dict[str, Any] = self._dispatcher.status()
        if self._bus is not None:
            described["lcm"] = self._bus.status()
        if self._remote is not None:
            described["lcm"] = self._remote.status()
        if self._hub is not None:
            described["port"] = self._hub.port
            described["tcpq"] = self._hub.status()
        for transport, problem in self._problems.items():
            described[transport] = {"problem": problem}
        described["geometry_bytes"] = self._protocol.census.array_bytes
        return described

    async def run(self) -> None:
        """Serves until cancelled.

        Raises:
            LcmUnavailable: no transport works.
        """
        try:
            await self._start()
            self._started.set()
            await asyncio.Event().wait()
        finally:
            self._started.clear()
            await self._stop()

    async def _start(self) -> None:
        ready = answers.encode(answers.ReadyAnswer())
        wanted = 0
        url = url_of(self._config.lcm_url)
        if url != OFF:
            wanted += 1
            try:
                self._join(url)
            except LcmUnavailable as error:
                self._problem("lcm", error)
        if self._config.tcpq_port is not None:
            wanted += 1
            hub = Hub(self._config, self._from_hub, PATTERN, (RESPONSE, ready))
            try:
                await hub.start()
            except LcmUnavailable as error:
                self._problem("tcpq", error)
            else:
                self._hub = hub
        if self._problems and len(self._problems) == wanted:
            raise LcmUnavailable("; ".join(self._problems.values()))
        if self._remote is not None and self._is_own_hub(self._remote):
            # everything in one environment: LCM_DEFAULT_URL names our own hub, which is served without a connection
            self._remote = None
        if self._remote is not None:
            remote = self._remote
            remote.start(partial(self._from_remote, remote), partial(_announce, remote, ready))
        if self._bus is not None:
            bus = self._bus
            bus.start(lambda channel, data: self._from_lcm(bus, channel, data))
            _announce(bus, ready)

    def _join(self, url: str) -> None:
        bus = join(url, REQUEST, self._config)
        if isinstance(bus, TcpqBus):
            self._remote = bus
        else:
            self._bus = bus

    async def _stop(self) -> None:
        self._dispatcher.flush()
        if self._bus is not None:
            self._bus.close()
            self._bus = None
        if self._remote is not None:
            await self._remote.close()
            self._remote = None
        if self._hub is not None:
            await self._hub.close()
            self._hub = None
        await self._dispatcher.close()
        for executor in self._executors:
            executor.shutdown(wait=False, cancel_futures=True)

    def _problem(self, transport: str, error: LcmUnavailable) -> None:
        self._problems[transport] = str(error)
        _log.warning(str(error), transport=transport)

    def _from_lcm(self, bus: LcmBus | UdpmBus, channel: str, data: bytes | memoryview) -> None:
        self._dispatcher.receive("lcm", channel, data, bus.publish)

    def _from_remote(self, remote: TcpqBus, channel: str, data: bytes | memoryview) -> None:
        self._dispatcher.receive("remote", channel, data, remote.publish)

    def _is_own_hub(self, remote: TcpqBus) -> bool:
        return self._hub is not None and remote.port == self._hub.port and remote.host in _HERE

    def _from_hub(self, sender: HubConnection, channel: str, data: bytes | memoryview) -> None:
        hub = self._hub
        if hub is None:
            return
        waiting = self._dispatcher.receive(sender, channel, data, hub.publish, sender.release)
        if waiting > self._config.client_waiting_bytes:
            sender.hold()


_HERE: Final = frozenset(("127.0.0.1", "localhost", "::1", "0.0.0.0"))  # noqa: S104 - names that mean this machine


def _announce(bus: LcmBus | UdpmBus | TcpqBus, ready: bytes) -> None:
    """Director says so when it starts, and its tests wait for it."""
    try:
        bus.publish(RESPONSE, ready)
    except OSError as error:
        _log.warning("The ready message could not be sent", reason=str(error))
