"""The protocol without I/O: bytes of a request in, edits of the tree and a response out."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

from gateway.scene.live import LiveTree
from gateway.treeviewer import responses, wire
from gateway.treeviewer.apply import RequestApplier
from gateway.treeviewer.config import Limits
from gateway.treeviewer.context import MeshLoader
from gateway.treeviewer.json_reader import JsonReader
from gateway.treeviewer.msgpack_reader import MsgpackReader
from gateway.treeviewer.quota import TreeQuota
from gateway.treeviewer.requests import RequestError
from gateway.treeviewer.responses import AnyResponse

REQUEST: Final = "DIRECTOR_TREE_VIEWER_REQUEST"
RESPONSE: Final = "DIRECTOR_TREE_VIEWER_RESPONSE"
ALL_COMMANDS: Final = 1 << 30


def client_of(channel: str) -> str:
    """Return the client id between the first < and the last > of a request's channel, or an empty string."""
    begin, end = channel.find("<"), channel.rfind(">")
    return channel[begin + 1 : end] if 0 <= begin < end else ""


def response_channel(channel: str) -> str:
    """Return the channel of the response to a request on ``channel``."""
    client = client_of(channel)
    return f"{RESPONSE}_<{client}>" if client else RESPONSE


class RequestRefused(Exception):  # noqa: N818 - a response, not a failure of the viewer
    """The request gets this response, and the tree is not touched."""

    def __init__(self, response: AnyResponse) -> None:
        super().__init__(response)
        self.response = response


class TreeViewerProtocol:
    """Reads requests and applies them. ``open`` may run in any thread, the applier only in that of the tree."""

    def __init__(
        self,
        live: LiveTree,
        limits: Limits | None = None,
        meshes: MeshLoader | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.limits = limits or Limits()
        self.quota = TreeQuota(self.limits, clock)
        self.quota.adopt(live.snapshot.root)
        self.reads_files = meshes is not None
        """True if a request may open files, which must not happen on the event loop."""
        self._live = live
        self.readers = {
            wire.FORMAT: JsonReader(self.limits, meshes),
            wire.BINARY_FORMAT: MsgpackReader(self.limits, meshes),
        }
        """Reader of each supported format."""

    def header(self, message: bytes | memoryview) -> wire.Comms:
        """Decode and check the message's header; do not read its data.

        Raises:
            wire.WireError: it is not a viewer2_comms_t, so that no response is possible.
            RequestRefused: the format is not supported, or a length is wrong.
        """
        comms = wire.decode(message)
        supported = responses.SUPPORTED_FORMATS
        if comms.format not in self.readers:
            raise RequestRefused(responses.FormatResponse(comms.utime, responses.UNKNOWN_FORMAT, supported))
        if (comms.major, comms.minor) != wire.VERSION:
            raise RequestRefused(responses.FormatResponse(comms.utime, responses.UNKNOWN_FORMAT_VERSION, supported))
        if comms.fault:
            raise RequestRefused(responses.failed(comms.utime, comms.fault))
        if len(comms.data) > self.limits.message_bytes:
            reason = f"the request has {len(comms.data)} bytes, the limit is {self.limits.message_bytes}"
            raise RequestRefused(responses.failed(comms.utime, reason))
        return comms

    def open(self, comms: wire.Comms) -> RequestApplier:
        """Read a request without touching the tree.

        Raises:
            RequestRefused: it cannot be read.
        """
        try:
            request = self.readers[comms.format].read(comms.data)
        except RequestError as error:
            raise RequestRefused(responses.failed(comms.utime, str(error))) from None
        return RequestApplier(request, self._live, self.quota, self.limits)

    def handle(self, message: bytes | memoryview) -> AnyResponse:
        """Read and apply a request at once, and return the response.

        Raises:
            wire.WireError: as ``header``.
        """
        try:
            comms = self.header(message)
            applier = self.open(comms)
        except RequestRefused as refused:
            return refused.response
        applier.step(ALL_COMMANDS)
        return applier.response(comms.utime)
