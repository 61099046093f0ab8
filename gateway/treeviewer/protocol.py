"""The protocol without any transport: the bytes of a request in, an application to the tree and an answer out."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import lru_cache
from typing import Final

from gateway.scene.live import LiveTree
from gateway.treeviewer import answers, wire
from gateway.treeviewer.answers import Answer, FormatAnswer
from gateway.treeviewer.apply import Application
from gateway.treeviewer.binary import BinaryReader
from gateway.treeviewer.config import Limits
from gateway.treeviewer.geometry import MeshLoader
from gateway.treeviewer.quota import Census
from gateway.treeviewer.requests import RequestError, RequestReader

REQUEST: Final = "DIRECTOR_TREE_VIEWER_REQUEST"
RESPONSE: Final = "DIRECTOR_TREE_VIEWER_RESPONSE"
LEAST_EXTRACTED: Final = 256 * 1024
"""Bytes; from here on looking for long arrays costs nothing compared with the message."""
LONGEST_CHANNEL: Final = 63
"""Characters (LCM); a client id of 32 fits into the request's channel but not into the answer's."""


def client_of(channel: str) -> str:
    """The client id between the first < and the last > of a request's channel; empty if there is none."""
    begin, end = channel.find("<"), channel.rfind(">")
    return channel[begin + 1 : end] if 0 <= begin < end else ""


@lru_cache(maxsize=1024)
def response_channel(channel: str) -> str:
    """Where the answer to a request on ``channel`` goes."""
    client = client_of(channel)
    return f"{RESPONSE}_<{client}>" if client else RESPONSE


class Refused(Exception):  # noqa: N818 - an answer, not a failure of ours
    """The request is answered without touching the tree."""

    def __init__(self, answer: Answer | FormatAnswer) -> None:
        super().__init__(answer)
        self.answer = answer


class TreeViewerProtocol:
    """Reads requests and applies them. ``open`` may run in any thread, the application must stay in one."""

    def __init__(
        self,
        live: LiveTree,
        limits: Limits | None = None,
        meshes: MeshLoader | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.limits = limits or Limits()
        self.census = Census(self.limits, clock)
        self.census.adopt(live.snapshot.root)
        self.reads_files = meshes is not None
        """Whether a request may open files, which must not happen on the event loop."""
        self._live = live
        self._readers = {
            wire.FORMAT: RequestReader(self.limits, meshes),
            wire.BINARY_FORMAT: BinaryReader(self.limits, meshes),
        }

    def header(self, message: bytes | memoryview) -> wire.Comms:
        """The message's header, cheap; its data is not looked at.

        Raises:
            wire.WireError: not a viewer2_comms_t, so there is nothing to answer.
            Refused: an encoding that we do not speak, or lengths that are lies.
        """
        comms = wire.decode(message)
        if comms.format not in self._readers:
            raise Refused(FormatAnswer(comms.utime, answers.UNKNOWN_FORMAT, answers.SUPPORTED))
        if (comms.major, comms.minor) != wire.VERSION:
            raise Refused(FormatAnswer(comms.utime, answers.UNKNOWN_FORMAT_VERSION, answers.SUPPORTED))
        if comms.fault:
            raise Refused(answers.failed(comms.utime, comms.fault))
        if len(comms.data) > self.limits.message_bytes:
            reason = f"the request has {len(comms.data)} bytes, the limit is {self.limits.message_bytes}"
            raise Refused(answers.failed(comms.utime, reason))
        return comms

    def open(self, comms: wire.Comms) -> Application:
        """Reads a request; the tree is not touched yet.

        Raises:
            Refused: it cannot be read.
        """
        try:
            reader = self._readers[comms.format]
            request = reader.read(comms.data, extract=True if len(comms.data) >= LEAST_EXTRACTED else None)
        except RequestError as error:
            raise Refused(answers.failed(comms.utime, str(error))) from None
        return Application(request, self._live, self.census, self.limits)

    def handle(self, message: bytes | memoryview) -> Answer | FormatAnswer:
        """All at once, for messages that are small.

        Raises:
            wire.WireError: as ``header``.
        """
        try:
            comms = self.header(message)
            application = self.open(comms)
        except Refused as refused:
            return refused.answer
        while application.step(1 << 30):
            pass
        return application.answer(comms.utime)
