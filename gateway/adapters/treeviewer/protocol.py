"""Director's tree viewer protocol without I/O: read a request, apply it to the live tree, return the response."""

import time
from collections.abc import Callable

from gateway.adapters.treeviewer import responses
from gateway.adapters.treeviewer.apply import PageClient, RequestApplier, update_page
from gateway.adapters.treeviewer.config import Limits
from gateway.adapters.treeviewer.context import MeshLoader, ReadContext
from gateway.adapters.treeviewer.quota import TreeQuota
from gateway.adapters.treeviewer.request_reader import JsonReader, MsgpackReader, RequestReader
from gateway.adapters.treeviewer.requests import UnreadableRequestError
from gateway.adapters.treeviewer.responses import AnyResponse
from gateway.runtime.logs.warning_list import WarningList
from gateway.scene.page.live_page import LivePage
from gateway.scene.tree.live import LiveTree
from scenegate.messages import wire
from scenegate.messages.wire import REQUEST as REQUEST
from scenegate.messages.wire import RESPONSE as RESPONSE


def client_of(channel: str) -> str:
    """Return the client id in a request's channel: the text between the first < and the last >, or an empty string."""
    opening, closing = channel.find("<"), channel.rfind(">")
    return channel[opening + 1 : closing] if 0 <= opening < closing else ""


def response_channel(channel: str) -> str:
    """Return the channel of the response to a request on ``channel``."""
    client = client_of(channel)
    return f"{RESPONSE}_<{client}>" if client else RESPONSE


class RequestRefused(Exception):  # noqa: N818 - a response, not a failure of the viewer
    """The request is not executed. ``response`` contains the reason."""

    def __init__(self, response: AnyResponse) -> None:
        super().__init__(response)
        self.response = response


class TreeViewerProtocol:
    """Reads requests and applies them to the live tree.

    A request takes two steps: ``read`` it, which is thread-safe, and apply it. Appliers edit the tree, and run in the
    event loop's thread. ``handle`` takes both steps there.
    """

    def __init__(
        self,
        live: LiveTree,
        limits: Limits | None = None,
        meshes: MeshLoader | None = None,
        clock: Callable[[], float] = time.monotonic,
        page: LivePage | None = None,
        local_meshes: MeshLoader | None = None,
        *,
        strict: bool = False,
    ) -> None:
        self.limits = limits or Limits()
        self.quota = TreeQuota(self.limits, clock)
        self.quota.count_existing(live.snapshot.root)
        self._strict = strict
        self._meshes = meshes
        self._local_meshes = local_meshes or meshes
        self.page = page or LivePage()
        """State of the pages that show the tree."""
        self.warnings = WarningList()
        """Warnings about the newest command of each name and path, by ``Subject``."""
        self.live = live
        """Tree that requests edit."""
        self.readers: dict[str, RequestReader] = {
            wire.JSON: JsonReader(self.limits),
            wire.BINARY: MsgpackReader(self.limits),
        }
        """Readers by the name of the format."""

    def read(self, comms: wire.Comms, is_local: bool = False, *, at_once: bool = False) -> RequestApplier:
        """Read a request, and return the applier that executes it.

        ``is_local``: the client is a program on this machine, which may name files in more folders. Raises
        RequestRefused, or ThreadRequired (see ``ReadContext.at_once``).
        """
        supported = responses.SUPPORTED_FORMATS
        reader = self.readers.get(comms.format)
        if reader is None:
            raise RequestRefused(responses.FormatResponse(comms.utime, wire.UNKNOWN_FORMAT, supported))
        if (comms.major, comms.minor) != wire.VERSION:
            raise RequestRefused(responses.FormatResponse(comms.utime, wire.UNKNOWN_FORMAT_VERSION, supported))
        if comms.fault:
            raise RequestRefused(responses.failed(comms.utime, comms.fault))
        if len(comms.data) > self.limits.message_bytes:
            reason = f"the request has {len(comms.data)} bytes, the limit is {self.limits.message_bytes}"
            raise RequestRefused(responses.failed(comms.utime, reason))
        meshes = self._local_meshes if is_local else self._meshes
        context = ReadContext(self.limits, meshes=meshes, strict=self._strict, at_once=at_once)
        try:
            request = reader.read(comms.data, context)
        except UnreadableRequestError as error:
            raise RequestRefused(responses.failed(comms.utime, str(error))) from None
        return RequestApplier(request, self.live, self.quota, self.limits, self.warnings)

    def handle(self, message: bytes | memoryview, client: PageClient | None = None) -> AnyResponse:
        """Read and apply a request, a viewer2_comms_t, at once, and return the response.

        ``client``: the sender; None: it cannot receive messages of the page. Raises ``wire.WireError`` for another
        message.
        """
        comms = wire.decode(message)
        try:
            applier = self.read(comms)
        except RequestRefused as refused:
            return refused.response
        applier.apply()
        return self.respond(applier, client, comms.utime)

    def respond(self, applier: RequestApplier, client: PageClient | None, utime: int) -> AnyResponse:
        """Execute the commands for the page of a request that was applied, and return the response."""
        update_page(self.page, applier.request, client, utime)
        return applier.response(utime)
