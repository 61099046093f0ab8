"""Run Drake's visualizer channels: read big messages in worker threads, and apply all messages on the event loop.

A group is a family of channels, or a channel without a family. While a thread reads a message, later messages of its
group wait in a queue, which keeps only the newest of each channel.
"""

import asyncio
from dataclasses import asdict
from typing import Any, Final, NamedTuple

import structlog

from gateway.adapters.drakeviewer.channels import Channel, Kind, channel_of
from gateway.adapters.drakeviewer.config import DrakeViewerConfig
from gateway.adapters.drakeviewer.viewer import DrakeViewer, ShowMessage
from gateway.adapters.drakeviewer.wire import MessageError
from gateway.files.assets.mesh_files import MeshFiles
from gateway.runtime.logs.tracing import lcm_message_span
from gateway.runtime.logs.warning_list import WarningList
from gateway.runtime.workers.pool_errors import UnavailableErrors
from gateway.runtime.workers.scheduling import BACKGROUND_NICENESS
from gateway.runtime.workers.worker_pool import WorkerPool
from gateway.scene.tree.live import LiveTree
from scenegate.lcm.transport import LcmMessage
from scenegate.warning_text import joined_warnings

_log = structlog.get_logger("gateway.drakeviewer")

MAX_LOGGED_REASONS: Final = 1000
"""Maximum number of log entries about messages. Later ones are only counted."""


class WaitingMessage(NamedTuple):
    """A message that waits in the queue of its group."""

    message: LcmMessage
    last_number: int
    """``DrakeState.last_number`` when it was received, or the message that it replaced: a new simulation keeps what is
    shown after that."""


class DrakeViewerService:
    """Receives messages on the event loop, and shows them in the live tree."""

    def __init__(
        self,
        live: LiveTree,
        files: MeshFiles,
        config: DrakeViewerConfig | None = None,
        local_files: MeshFiles | None = None,
    ) -> None:
        """``local_files``: mesh files that programs on this machine may name; None: ``files``, which all may name."""
        self._config = config or DrakeViewerConfig()
        self._files, self._local_files = files, local_files or files
        self.viewer = DrakeViewer(live, files, self._config)
        self._pool = WorkerPool(
            self._config.threads, self._config.channels, name="drakeviewer", niceness=BACKGROUND_NICENESS
        )
        self._queues: dict[str, dict[Channel, WaitingMessage]] = {}
        """Messages that wait, oldest first, by group and channel."""
        self._waiting_bytes = 0
        self._unapplied_arrivals = live.unapplied_arrivals
        """Arrival of the oldest message of each group that waits or is read: stereo cameras wait for it."""
        self._tasks: dict[str, asyncio.Task[None]] = {}
        """Task that empties the queue of each group that has one."""
        self._message_counts: dict[Channel, int] = {}
        """Number of messages of each channel. Senders choose the names of point clouds and frames, so that theirs are
        added with the first message that is shown: damaged messages must not use up ``config.channels``."""
        self._shown_bytes: dict[Channel, int] = {}
        """Size of the newest message of each channel that is shown."""
        self._unshown: dict[str, int] = {}
        """Number of messages of each channel that is not shown."""
        self._logged: set[tuple[Channel, str]] = set()
        """Channels and reasons that were logged."""
        self._warnings = WarningList()
        """Reason, by channel, why its newest message is not shown completely."""
        self._superseded = 0
        """Messages that were replaced in the queue by a newer one of their channel."""
        self._dropped = 0
        """Messages beyond the limits on all channels together."""
        self.ready = False

    def status(self) -> dict[str, Any]:
        """Return counters and warnings as plain JSON values."""
        status: dict[str, Any] = {
            **asdict(self.viewer.counters),
            "superseded": self._superseded,
            "dropped": self._dropped,
            "channels": {channel.name: count for channel, count in self._message_counts.items()},
            "families": self.viewer.families(),
        }
        if self.viewer.state.simulation_seconds is not None:
            status["simulation_seconds"] = self.viewer.state.simulation_seconds
        warnings = self._warnings.listed()
        if self._unshown:
            status["unshown_channels"] = dict(self._unshown)
            warnings.append(f"received, but not shown: {', '.join(list(self._unshown)[:10])}")
        if warnings:
            status["warnings"] = warnings
        return status

    async def run(self) -> None:
        """Show messages until cancelled."""
        self.ready = True
        try:
            await asyncio.Event().wait()
        finally:
            self.ready = False
            self._queues.clear()
            tasks = tuple(self._tasks.values())
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            await self._pool.close(0.0)

    def receive(self, message: LcmMessage) -> None:
        """Show a message, on the event loop: a small one at once, others after the worker thread has read them."""
        if not self.ready:
            return
        channel, nbytes = channel_of(message.channel), len(message.data)
        if channel is None:
            self._count_unshown(message.channel)
            return
        if self._drop_beyond_limits(channel, nbytes):
            return
        if channel in self._message_counts or channel.has_fixed_name:
            self._message_counts[channel] = self._message_counts.get(channel, 0) + 1
        self.viewer.counters.received += 1
        if channel.group not in self._tasks and not self._needs_thread(channel, message):
            with lcm_message_span(channel.name, nbytes):
                self._show(channel, message)
            return
        self._enqueue(channel, message)
        if channel.group not in self._tasks:
            self._tasks[channel.group] = asyncio.get_running_loop().create_task(self._show_waiting(channel.group))

    def _drop_beyond_limits(self, channel: Channel, nbytes: int) -> bool:
        """Drop a message beyond the limits on all channels together; return True if it was dropped."""
        bytes_of_others = sum(self._shown_bytes.values()) - self._shown_bytes.get(channel, 0)
        if self._exceeds_channels(channel):
            self._drop(channel, f"{self._config.channels} channels are shown or wait, which is the limit")
        elif bytes_of_others + nbytes > self._config.shown_bytes:
            limit = self._config.shown_bytes
            self._drop(channel, f"{nbytes} bytes are too many: the limit for all channels together is {limit}")
        else:
            return False
        return True

    def _exceeds_channels(self, channel: Channel) -> bool:
        """Return True if a channel is one too many besides those that are shown or wait."""
        if channel.has_fixed_name or channel in self._message_counts:
            return False
        waiting_channels = {waiting for queue in self._queues.values() for waiting in queue}
        other_channels = (self._message_counts.keys() | waiting_channels) - {channel}
        return len(other_channels) >= self._config.channels

    def _drop(self, channel: Channel, reason: str) -> None:
        self._dropped += 1
        self._set_warnings(channel, reason)

    def _needs_thread(self, channel: Channel, message: LcmMessage) -> bool:
        """Return True if reading the message may take milliseconds."""
        return len(message.data) >= self._config.offload_bytes or channel.reads_meshes

    def _enqueue(self, channel: Channel, message: LcmMessage) -> None:
        """Add a message to the end of its group's queue. An earlier one of its channel is removed in any case."""
        queue = self._queues.setdefault(channel.group, {})
        last_number = self.viewer.state.last_number
        earlier = queue.pop(channel, None)
        if earlier is not None:
            last_number = earlier.last_number
            self._superseded += 1
            self._waiting_bytes -= len(earlier.message.data)
        if self._waiting_bytes + len(message.data) > self._config.waiting_bytes:
            self._drop(channel, f"{self._waiting_bytes} bytes of messages are waiting")
            return
        queue[channel] = WaitingMessage(message, last_number)
        self._unapplied_arrivals.setdefault((self, channel.group), message.arrival)
        self._waiting_bytes += len(message.data)

    async def _show_waiting(self, group: str) -> None:
        """Show the messages of a group's queue until it is empty."""
        queue = self._queues[group]
        try:
            while queue:
                channel = next(iter(queue))
                message, last_number = queue.pop(channel)
                nbytes = len(message.data)
                self._unapplied_arrivals[self, group] = message.arrival
                self._waiting_bytes -= nbytes
                if self._drop_beyond_limits(channel, nbytes):
                    continue
                with lcm_message_span(channel.name, nbytes):
                    if self._needs_thread(channel, message):
                        await self._read_in_thread(channel, message, last_number)
                    else:
                        self._show(channel, message, last_number)
        finally:
            self._queues.pop(group, None)
            self._unapplied_arrivals.pop((self, group), None)
            del self._tasks[group]

    def _show(self, channel: Channel, message: LcmMessage, last_number: int | None = None) -> None:
        try:
            self._apply(channel, message, self.viewer.read(channel, message.data, last_number=last_number))
        except Exception as error:  # noqa: BLE001 - one message must not end the transport
            self._report_error(channel, error)

    async def _read_in_thread(self, channel: Channel, message: LcmMessage, last_number: int) -> None:
        files = self._local_files if message.is_local else self._files
        try:
            show = await self._pool.run(self.viewer.read, channel, message.data, files, last_number)
            self._apply(channel, message, show)
        except Exception as error:  # noqa: BLE001 - one message must not end the service
            self._report_error(channel, error)

    def _apply(self, channel: Channel, message: LcmMessage, show: ShowMessage | None) -> None:
        """Show a message that was read, and count its channel and size. Damaged messages do not count as shown."""
        self._set_warnings(channel, *self.viewer.apply(show, message.arrival))
        if channel.kind is Kind.LOAD:
            self._forget_cleared()
        self._message_counts.setdefault(channel, 1)
        self._shown_bytes[channel] = len(message.data)

    def _forget_cleared(self) -> None:
        """Forget the channels that a new simulation has cleared, and the warnings of the earlier one."""
        cleared = {channel for channel in self._message_counts if not channel.has_fixed_name}
        for channel in cleared - self.viewer.state.newest_numbers.keys():
            del self._message_counts[channel]
            self._shown_bytes.pop(channel, None)
        self._warnings.remove(lambda channel: channel.kind is not Kind.LOAD)

    def _report_error(self, channel: Channel, error: Exception) -> None:
        self.viewer.counters.undecodable += 1
        if isinstance(error, (MessageError, *UnavailableErrors)):
            self._set_warnings(channel, str(error))
        else:
            _log.error("A message could not be shown", channel=channel.name, exc_info=error)
            self._set_warnings(channel, "internal error; the gateway's log says more")

    def _set_warnings(self, channel: Channel, *reasons: str) -> None:
        """Log reasons once for each channel, and keep them for ``/healthz`` until a message of the channel is shown."""
        self._warnings.set(channel, *(f"{channel.name}: {reason}" for reason in reasons))
        reason = joined_warnings(reasons)
        if reason and (channel, reason) not in self._logged and len(self._logged) < MAX_LOGGED_REASONS:
            self._logged.add((channel, reason))
            _log.warning("A message of Drake's was ignored, or shown only in part", channel=channel.name, reason=reason)

    def _count_unshown(self, channel: str) -> None:
        self.viewer.counters.unshown += 1
        if channel in self._unshown:
            self._unshown[channel] += 1
        elif len(self._unshown) < self._config.channels:
            self._unshown[channel] = 1
            _log.warning("Messages of a channel are received, but not shown", channel=channel)
