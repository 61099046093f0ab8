"""Run the tree viewer: connect the LCM transports with the protocol. ``gateway.wiring`` creates the service."""

import asyncio
from collections.abc import Sequence
from functools import partial
from typing import Any, Final
from urllib.parse import urlsplit

import structlog

from gateway.adapters.treeviewer import responses
from gateway.adapters.treeviewer.config import TreeViewerConfig
from gateway.adapters.treeviewer.context import MeshLoader
from gateway.adapters.treeviewer.delivery import DurableStore, forget_clients
from gateway.adapters.treeviewer.dispatch import Dispatcher
from gateway.adapters.treeviewer.protocol import REQUEST, RESPONSE, TreeViewerProtocol
from gateway.runtime.lcm.listener import ChannelListener
from gateway.runtime.lcm.tcpq_hub import TcpqHub
from gateway.runtime.workers.scheduling import BACKGROUND_NICENESS
from gateway.runtime.workers.worker_pool import WorkerPool
from gateway.scene.page.live_page import LivePage
from gateway.scene.tree.live import LiveTree
from scenegate.lcm import tcpq_transport
from scenegate.lcm.network import open_transport, resolve_url
from scenegate.lcm.transport import LcmUnavailableError, Transport
from scenegate.lcm.url import OFF

_log = structlog.get_logger("gateway.treeviewer")

_LOCAL_HOSTS: Final = frozenset(("127.0.0.1", "localhost", "::1", "0.0.0.0"))  # noqa: S104 - compared only


class TreeViewerService:
    """The tree viewer with a transport for ``lcm.url`` and a TCPQ hub. Each works if the other cannot start."""

    def __init__(
        self,
        config: TreeViewerConfig,
        live: LiveTree,
        meshfiles: MeshLoader | None = None,
        store: DurableStore | None = None,
        listeners: Sequence[ChannelListener] = (),
        page: LivePage | None = None,
        local_meshfiles: MeshLoader | None = None,
    ) -> None:
        """Create the service; ``run`` starts it.

        ``meshfiles``: None: requests cannot load files. ``store``: None: responses do not wait. ``listeners`` receive
        other channels. ``local_meshfiles``: for programs on this machine; None: ``meshfiles``.
        """
        self._config = config
        self.protocol = TreeViewerProtocol(
            live, config.limits, meshfiles, page=page, local_meshes=local_meshfiles, strict=config.strict
        )
        self._pool = WorkerPool(
            config.threads, config.waiting_requests, name="treeviewer", niceness=BACKGROUND_NICENESS
        )
        self._dispatcher = Dispatcher(self.protocol, config, self._pool, store, listeners)
        self._transport: Transport | None = None
        self.hub: TcpqHub | None = None
        self._prefixes = (REQUEST, *(prefix for listener in listeners for prefix in listener.prefixes))
        """Starts of the names of all channels to receive."""
        self._problems: dict[str, str] = {}
        """Reason why a transport could not start, by its name."""
        self._started = asyncio.Event()

    @property
    def ready(self) -> bool:
        """True while the transports run."""
        return self._started.is_set()

    @property
    def tcpq_port(self) -> int:
        """Port of the hub; 0 if there is none."""
        return self.hub.port if self.hub is not None else 0

    async def wait_ready(self) -> None:
        """Wait until the transports run."""
        await self._started.wait()

    def status(self) -> dict[str, Any]:
        """Return counters, warnings, and the status or problem of each transport, as plain JSON values."""
        status: dict[str, Any] = self._dispatcher.status()
        if self._transport is not None:
            status["lcm"] = self._transport.status()
        if self.hub is not None:
            status["port"] = self.hub.port
            status["tcpq"] = self.hub.status()
        for transport, problem in self._problems.items():
            status[transport] = {"problem": problem}
        warnings = [*self._problems.values(), *self.protocol.warnings.listed()]
        if warnings:
            status["warnings"] = warnings
        status["geometry_bytes"] = self.protocol.quota.array_bytes
        return status

    async def run(self) -> None:
        """Serve until cancelled. Raises LcmUnavailableError if no transport could start."""
        try:
            await self._start()
            self._started.set()
            await asyncio.Event().wait()
        finally:
            self._started.clear()
            await self._stop()

    async def _start(self) -> None:
        ready_message = responses.encode(responses.ReadyMessage())
        url = resolve_url(self._config.lcm.url)
        if self._config.lcm.tcpq_port is not None:
            await self._start_hub(ready_message)
        if url != OFF and not self._is_own_hub(url):
            try:
                self._transport = open_transport(url, self._prefixes, self._config.lcm)
            except LcmUnavailableError as error:
                self._add_problem("lcm", error)
        if self._problems and self._transport is None and self.hub is None:
            raise LcmUnavailableError("; ".join(self._problems.values()))
        if self._transport is not None:
            transport = self._transport
            on_message = partial(self._dispatcher.receive, transport.publish)
            transport.start(on_message, partial(_announce, transport, ready_message))

    async def _start_hub(self, ready_message: bytes) -> None:
        hub = TcpqHub(self._config.lcm, (RESPONSE, ready_message))
        receive = partial(self._dispatcher.receive, hub.publish)
        try:
            await hub.start(self._prefixes, receive, partial(forget_clients, self.protocol.page, hub))
        except LcmUnavailableError as error:
            self._add_problem("tcpq", error)
        else:
            self.hub = hub

    async def _stop(self) -> None:
        await self._dispatcher.close()
        if self._transport is not None:
            await self._transport.close()
            self._transport = None
        if self.hub is not None:
            await self.hub.close()
            self.hub = None
        await self._pool.close(0.0)

    def _add_problem(self, transport: str, error: LcmUnavailableError) -> None:
        self._problems[transport] = str(error)
        _log.warning(str(error), transport=transport)

    def _is_own_hub(self, url: str) -> bool:
        """Return True if a URL is that of this service's hub, to which LCM_DEFAULT_URL may direct all programs."""
        parts = urlsplit(url)
        try:
            port = parts.port or tcpq_transport.DEFAULT_PORT
        except ValueError:
            return False
        is_local = (parts.hostname or "127.0.0.1") in _LOCAL_HOSTS
        return self.hub is not None and parts.scheme == "tcpq" and is_local and port == self.hub.port


def _announce(transport: Transport, ready_message: bytes) -> None:
    """Publish that the viewer has started, as Director does."""
    try:
        transport.publish(RESPONSE, ready_message)
    except OSError as error:
        _log.warning("The ready message could not be sent", reason=str(error))
