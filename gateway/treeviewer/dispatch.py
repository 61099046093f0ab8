"""From a transport's messages to the protocol and back: at once where that is quick, in threads where it is not.

Order holds per client: what a client sends behind a big message waits for it; other clients do not.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import Final, NamedTuple, Protocol

import structlog

from gateway.treeviewer import answers, wire
from gateway.treeviewer.answers import Answer, FormatAnswer
from gateway.treeviewer.config import TreeViewerConfig
from gateway.treeviewer.protocol import Refused, TreeViewerProtocol, response_channel

_log = structlog.get_logger("gateway.treeviewer")

Reply = Callable[[str, bytes], None]
"""Publishes an answer: (channel, message)."""
Message = bytes | memoryview
OVERHEAD_BYTES: Final = 256
"""Of one waiting message besides its bytes."""
PATH_BYTES: Final = 100
"""Of one path in an answer that waits."""
RESEND_DELAY_SECONDS: Final = 0.01
"""Delay of answers with status 1. Director's Python client empties its queue of commands right after ``publish()``.
This erases what an earlier answer has put there. On a busy machine the client takes up to 8 ms, seldom more."""
LOUD: Final = 10
"""So many undecodable messages are logged one by one, then only every thousandth: a flood must not fill the disk."""


@dataclass(slots=True)
class Counters:
    """Since start."""

    received: int = 0
    received_bytes: int = 0
    answered: int = 0
    missing: int = 0
    """Answers with status 1."""
    failed: int = 0
    """Answers with a negative status."""
    undecodable: int = 0
    """Messages that are not a viewer2_comms_t; nobody can be answered."""
    unanswerable: int = 0
    """Answers that could not be sent: the client's id is too long for LCM's channel names, or it has gone."""
    dropped: int = 0
    """Requests refused because too much was waiting."""
    dropped_bytes: int = 0
    internal_errors: int = 0
    """Defects of ours; the log has them."""

    def as_dict(self) -> dict[str, int]:
        return asdict(self)


class Durable(Protocol):
    """Where the tree is stored, so that nothing is answered that could be lost."""

    @property
    def full(self) -> bool:
        """Whether so many answers wait that nothing new should be applied."""

    def after(self, done: Callable[[str], None], size: int) -> None:
        """Calls ``done`` on the event loop when all edits so far are stored (empty) or could not be (the reason)."""


@dataclass(slots=True, eq=False)
class _Lane:
    """One client's messages that wait, the first being worked on."""

    channel: str
    reply: Reply
    waiting: deque[Message] = field(default_factory=deque)
    waiting_bytes: int = 0
    on_drained: Callable[[], None] | None = None


class _Unsent(NamedTuple):
    """An answer and where it goes."""

    channel: str
    answer: Answer | FormatAnswer
    reply: Reply
    binary: bool


class Dispatcher:
    """Takes requests from transports. All methods belong to the event loop's thread."""

    def __init__(
        self,
        protocol: TreeViewerProtocol,
        config: TreeViewerConfig,
        for_json: Executor,
        for_others: Executor,
        durable: Durable | None = None,
    ) -> None:
        """
        Args:
            for_json: reads big messages of text, which takes long.
            for_others: reads big binary messages and files.
            durable: answers wait for it; None: they are sent at once.
        """
        self._protocol = protocol
        self._durable = durable
        self._config = config
        self._for_json = for_json
        self._for_others = for_others
        self._lanes: dict[object, _Lane] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._delayed: dict[str, deque[_Unsent]] = {}
        """Delayed responses by request channel: the one with status 1, and all behind it."""
        self.counters = Counters()
        self.waiting_bytes = 0
        """Of all lanes."""
        self._with_files = b"mesh_file" if protocol.reads_files else None
        self._last_undecodable = ""

    def receive(
        self,
        source: object,
        channel: str,
        message: Message,
        reply: Reply,
        on_drained: Callable[[], None] | None = None,
    ) -> int:
        """A request arrived. Small ones are answered before this returns, unless paths are missing.

        Args:
            source: identifies the transport or connection; with the channel it is the client.
            reply: publishes the answer; its OSError or ValueError means that it cannot be sent.
            on_drained: called whenever less than half of ``client_waiting_bytes`` still waits.
        Returns:
            the bytes that wait for this client, for transports that can hold it back.
        """
        self.counters.received += 1
        self.counters.received_bytes += len(message)
        key = (source, channel)
        lane = self._lanes.get(key)
        full = self._durable is not None and self._durable.full
        if lane is None and not full and not self._is_big(message):
            self._answer_now(channel, message, reply)
            return 0
        size = len(message) + OVERHEAD_BYTES
        if full or self.waiting_bytes + size > self._config.waiting_bytes:
            self.counters.dropped += 1
            self.counters.dropped_bytes += len(message)
            self._refuse(channel, message, reply)
            return lane.waiting_bytes if lane else 0
        if lane is None:
            lane = self._lanes[key] = _Lane(channel, reply, on_drained=on_drained)
            task = asyncio.get_running_loop().create_task(self._work(key, lane))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)
        lane.waiting.append(message)
        lane.waiting_bytes += size
        self.waiting_bytes += size
        return lane.waiting_bytes

    def status(self) -> dict[str, object]:
        """Plain JSON values."""
        return {
            **self.counters.as_dict(),
            "waiting": sum(len(lane.waiting) for lane in self._lanes.values()),
            "waiting_bytes": self.waiting_bytes,
            **({"last_undecodable": self._last_undecodable} if self._last_undecodable else {}),
        }

    def flush(self) -> None:
        """Sends the answers that are delayed, before their transports close."""
        delayed, self._delayed = self._delayed, {}
        for waiting in delayed.values():
            for unsent in waiting:
                self._publish(*unsent)

    async def close(self) -> None:
        """Ends the work on waiting messages."""
        tasks = list(self._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def _is_big(self, message: Message) -> bool:
        size = len(message)
        if size > self._config.offload_bytes or (size > self._config.offload_bytes // 4 and wire.is_binary(message)):
            return True
        return self._with_files is not None and self._with_files in bytes(message)

    async def _work(self, key: object, lane: _Lane) -> None:
        try:
            while lane.waiting:
                message = lane.waiting[0]
                if self._is_big(message):
                    await self._answer_later(lane, message)
                else:
                    self._answer_now(lane.channel, message, lane.reply)
                lane.waiting.popleft()
                size = len(message) + OVERHEAD_BYTES
                lane.waiting_bytes -= size
                self.waiting_bytes -= size
                if lane.on_drained is not None and lane.waiting_bytes < self._config.client_waiting_bytes // 2:
                    lane.on_drained()
        finally:
            self.waiting_bytes -= lane.waiting_bytes
            del self._lanes[key]

    def _answer_now(self, channel: str, message: Message, reply: Reply) -> None:
        try:
            answer = self._protocol.handle(message)
        except wire.WireError as error:
            self._undecodable(channel, error)
            return
        except Exception:  # a defect must not end the transport  # noqa: BLE001
            answer = self._defect(channel, message)
        self._send(channel, answer, reply, wire.is_binary(message))

    async def _answer_later(self, lane: _Lane, message: Message) -> None:
        answer: Answer | FormatAnswer
        try:
            comms = self._protocol.header(message)
            loop = asyncio.get_running_loop()
            text = len(message) > self._config.offload_bytes and not wire.is_binary(message)
            executor = self._for_json if text else self._for_others
            application = await loop.run_in_executor(executor, self._protocol.open, comms)
            while application.step(self._config.slice_commands):  # noqa: ASYNC110 - others get their turn
                await asyncio.sleep(0)
            answer = application.answer(comms.utime)
        except Refused as refused:
            answer = refused.answer
        except wire.WireError as error:
            self._undecodable(lane.channel, error)
            return
        except Exception:  # noqa: BLE001 - as above
            answer = self._defect(lane.channel, message)
        self._send(lane.channel, answer, lane.reply, wire.is_binary(message))

    def _send(self, channel: str, answer: Answer | FormatAnswer, reply: Reply, binary: bool) -> None:
        if self._durable is None:
            self._delay(_Unsent(channel, answer, reply, binary))
            return
        paths = 0
        if isinstance(answer, Answer):
            paths = len(answer.deleted_paths) + len(answer.added_geometries) + len(answer.set_transforms)
        self._durable.after(partial(self._stored, channel, answer, reply, binary), OVERHEAD_BYTES + PATH_BYTES * paths)

    def _stored(self, channel: str, answer: Answer | FormatAnswer, reply: Reply, binary: bool, problem: str) -> None:
        if problem and isinstance(answer, Answer):
            reason = f"the tree has been changed, but the change could not be stored: {problem}"
            answer.error = f"{answer.error}; {reason}" if answer.error else reason
            answer.status = answers.ERROR_HANDLING_REQUEST
        self._delay(_Unsent(channel, answer, reply, binary))

    def _delay(self, unsent: _Unsent) -> None:
        """Publishes at once, or after ``RESEND_DELAY_SECONDS`` where paths are missing; a channel's order stays."""
        waiting = self._delayed.get(unsent.channel)
        missing = unsent.answer.status == answers.MISSING_PATHS
        if waiting is None and not missing:
            self._publish(*unsent)
            return
        self._delayed.setdefault(unsent.channel, deque()).append(unsent)
        if missing:
            asyncio.get_running_loop().call_later(RESEND_DELAY_SECONDS, self._delay_ended, unsent.channel)

    def _delay_ended(self, channel: str) -> None:
        """Publishes the oldest answer that is delayed, and those behind it up to the next with status 1."""
        waiting = self._delayed.get(channel)
        if not waiting:  # flushed
            return
        self._publish(*waiting.popleft())
        while waiting and waiting[0].answer.status != answers.MISSING_PATHS:
            self._publish(*waiting.popleft())
        if not waiting:
            del self._delayed[channel]

    def _publish(self, channel: str, answer: Answer | FormatAnswer, reply: Reply, binary: bool) -> None:
        message = answers.encode(answer, binary=binary)
        try:
            reply(response_channel(channel), message)
        except (OSError, ValueError) as error:
            self.counters.unanswerable += 1
            _log.warning("An answer could not be sent", channel=channel, reason=str(error))
            return
        self.counters.answered += 1
        self.counters.missing += answer.status == answers.MISSING_PATHS
        self.counters.failed += answer.status < 0

    def _refuse(self, channel: str, message: Message, reply: Reply) -> None:
        try:
            comms = wire.decode(message)
        except wire.WireError as error:
            self._undecodable(channel, error)
            return
        refusal = answers.failed(comms.utime, "too many messages are waiting; send slower")
        self._publish(channel, refusal, reply, wire.is_binary(message))

    def _undecodable(self, channel: str, error: wire.WireError) -> None:
        self.counters.undecodable += 1
        self._last_undecodable = f"{channel}: {error}"
        if self.counters.undecodable > LOUD and self.counters.undecodable % 1000:
            return
        _log.warning("An undecodable message was ignored", channel=channel, reason=str(error))

    def _defect(self, channel: str, message: Message) -> Answer:
        self.counters.internal_errors += 1
        _log.exception("A request could not be handled", channel=channel)
        return answers.failed(wire.decode(message).utime, "internal error; the viewer's log says more")
