"""Read and apply requests: small ones at once on the event loop, big ones and those with images in worker threads."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Final

import structlog

from gateway.adapters.treeviewer import responses
from gateway.adapters.treeviewer.apply import PageClient
from gateway.adapters.treeviewer.config import TreeViewerConfig
from gateway.adapters.treeviewer.context import ThreadRequired
from gateway.adapters.treeviewer.delivery import Counters, Recipient
from gateway.adapters.treeviewer.protocol import RequestRefused, TreeViewerProtocol
from gateway.adapters.treeviewer.queues import ReceivedRequest
from gateway.adapters.treeviewer.responses import AnyResponse
from gateway.runtime.logs.tracing import lcm_message_span
from gateway.runtime.workers.pool_errors import UnavailableErrors
from gateway.runtime.workers.worker_pool import WorkerPool
from renderers.compiler.pending import any_pending
from scenegate.messages import wire

_log = structlog.get_logger("gateway.treeviewer")

_MESSAGEPACK_SLOWNESS: Final = 4
"""Ratio of the time to read a MessagePack request to that of a JSON request of the same size; see ``offload_bytes``."""


class RequestExecutor:
    """Returns the response to a request, also to one that fails. Runs in the event loop's thread."""

    def __init__(
        self,
        protocol: TreeViewerProtocol,
        config: TreeViewerConfig,
        pool: WorkerPool,
        counters: Counters,
        page_client: Callable[[Recipient], PageClient],
    ) -> None:
        """``pool`` reads what the event loop does not. ``page_client`` returns the client behind a recipient."""
        self._protocol, self._config, self._pool = protocol, config, pool
        self._counters, self._page_client = counters, page_client
        self._apply_lock = asyncio.Lock()
        """Held while a big request is applied: merging two of them would block the event loop."""

    def respond_at_once(self, request: ReceivedRequest) -> AnyResponse | None:
        """Read and apply a small request on the event loop; return None if a thread must read it."""
        message, comms = request.message, request.comms
        slowness = _MESSAGEPACK_SLOWNESS if comms.format == wire.BINARY else 1
        if len(message.data) > self._config.offload_bytes // slowness or any_pending():
            return None
        try:
            applier = self._protocol.read(comms, at_once=True)
            with lcm_message_span(message.channel, len(message.data)):
                applier.apply(message.arrival)
                return self._protocol.respond(applier, self._page_client(request.recipient), comms.utime)
        except ThreadRequired:
            return None
        except Exception as error:  # one request must not end the transport  # noqa: BLE001
            return self._failure(request, error)

    async def respond(self, request: ReceivedRequest) -> AnyResponse:
        """Read and apply a request: on the event loop if that is quick, else in a thread and in slices on the loop."""
        if response := self.respond_at_once(request):
            return response
        message, comms = request.message, request.comms
        try:
            with lcm_message_span(message.channel, len(message.data)):
                applier = await self._pool.run(self._protocol.read, comms, message.is_local)
                async with self._apply_lock:
                    for _ in applier.slices(self._config.slice_commands, message.arrival):
                        await asyncio.sleep(0)
                return self._protocol.respond(applier, self._page_client(request.recipient), comms.utime)
        except Exception as error:  # noqa: BLE001 - as in respond_at_once
            return self._failure(request, error)

    def _failure(self, request: ReceivedRequest, error: Exception) -> AnyResponse:
        """Return the response to a request that could not be read or applied. Log an unexpected error."""
        if isinstance(error, RequestRefused):
            return error.response
        if isinstance(error, UnavailableErrors):
            return responses.failed(request.comms.utime, str(error))
        self._counters.internal_errors += 1
        _log.error("A request could not be handled", channel=request.message.channel, exc_info=error)
        return responses.failed(request.comms.utime, "internal error; the viewer's log says more")
