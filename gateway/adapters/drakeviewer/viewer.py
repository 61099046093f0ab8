"""Drake's visualizer channels without network I/O: read a message, then apply it to the live tree.

Reading a load message opens the mesh files that it names.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

import numpy as np

from gateway.adapters.drakeviewer import wire
from gateway.adapters.drakeviewer.channels import Channel, Kind, channel_of
from gateway.adapters.drakeviewer.config import DrakeViewerConfig
from gateway.adapters.drakeviewer.contacts import read_contacts
from gateway.adapters.drakeviewer.frames import FrameChannel
from gateway.adapters.drakeviewer.link_paths import count_nodes
from gateway.adapters.drakeviewer.point_clouds import read_cloud
from gateway.adapters.drakeviewer.robots import RobotChannels, ShownParts, read_robots, show_family
from gateway.adapters.drakeviewer.shapes import read_deformables
from gateway.adapters.drakeviewer.wire import Draw, MessageError
from gateway.files.assets.mesh_files import MeshFiles
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.nodes import Path, TreeEdit
from scenegate.warning_text import strict_refusal

RESTART_SECONDS: Final = 0.1
"""A draw message whose time is earlier than the last one's by more than this starts a new simulation. UDP can swap
messages that are milliseconds apart."""

ShowMessage = Callable[[TreeEdit], Sequence[str]]
"""Shows a message that was read. Returns the reasons why some or all of it is not shown."""


@dataclass(slots=True)
class Counters:
    """Numbers of messages since start."""

    received: int = 0
    """Messages of the channels that are shown."""
    undecodable: int = 0
    """Messages that are damaged, of another type or beyond a limit, and those for which no worker thread was left."""
    loads: int = 0
    """Load messages that were shown."""
    repeated_loads: int = 0
    """Load messages without mesh files that were equal to the one before."""
    unshown: int = 0
    """Messages of channels that are not shown."""


class LastLoad(NamedTuple):
    """Last load message of a channel."""

    data: bytes
    must_be_read: bool
    """True if it is read again when it is repeated: it names files, or something is missing."""


@dataclass(slots=True, eq=False)
class DrakeState:
    """State of the channels, besides what the live tree has.

    Contacts, point clouds and frames belong to a simulation. Their messages are numbered as they are shown: a new
    simulation clears the channels whose newest message was shown before its own first message was received.
    """

    robots: dict[str, RobotChannels] = field(default_factory=dict)
    """Robots by family."""
    loads: dict[Channel, LastLoad] = field(default_factory=dict)
    deformables: dict[str, ShownParts] = field(default_factory=dict)
    """Deformable bodies by channel."""
    frames: dict[str, FrameChannel] = field(default_factory=dict)
    """Frames by channel."""
    contacts: ShownParts = field(default_factory=ShownParts)
    node_counts: dict[str, int] = field(default_factory=dict)
    """Number of nodes of each family's links, and of each channel of frames or deformable bodies."""
    simulation_seconds: float | None = None
    """Time of the last draw message that was shown."""
    last_number: int = 0
    """Number of the last message of contacts, point clouds or frames that was shown."""
    newest_numbers: dict[Channel, int] = field(default_factory=dict)
    """Number of the newest of these messages, by channel. Cleared channels are not in it."""

    def copy(self) -> DrakeState:
        """Return a copy that later messages do not change."""
        return replace(
            self,
            robots={name: copy.copy(robots) for name, robots in self.robots.items()},
            loads=self.loads.copy(),
            deformables={name: copy.copy(channel) for name, channel in self.deformables.items()},
            frames={name: copy.copy(channel) for name, channel in self.frames.items()},
            contacts=copy.copy(self.contacts),
            node_counts=self.node_counts.copy(),
            newest_numbers=self.newest_numbers.copy(),
        )


class DrakeViewer:
    """Shows Drake's messages in the live tree.

    ``read`` is thread-safe for messages of different groups, because each group has entries of its own in ``state``.
    ``apply`` and ``handle`` must run in one thread.
    """

    def __init__(
        self, live: LiveTree, files: MeshFiles, config: DrakeViewerConfig | None = None, state: DrakeState | None = None
    ) -> None:
        """``files``: those that all senders may name. ``state``: that of a viewer that has edited the tree before."""
        self._live = live
        self._files = files
        self._config = config or DrakeViewerConfig()
        self.state = state or DrakeState()
        self.counters = Counters()

    def handle(self, channel_name: str, message: wire.Message) -> Sequence[str]:
        """Read a message and apply it at once, unless its channel is not shown; see ``ShowMessage`` for the result.

        Raises MessageError if it is damaged, of another type, or beyond a limit.
        """
        channel = channel_of(channel_name)
        return () if channel is None else self.apply(self.read(channel, message))

    def apply(self, show: ShowMessage | None, timestamp: int | None = None) -> Sequence[str]:
        """Show a message as one revision of the live tree, valid from ``timestamp``; see ``ShowMessage``."""
        if show is None:
            return ()
        with self._live.edit(timestamp) as edit:
            return show(edit)

    def read(
        self, channel: Channel, message: wire.Message, files: MeshFiles | None = None, last_number: int | None = None
    ) -> ShowMessage | None:
        """Read a message; return the function that shows it, None if it changes nothing.

        ``files``: mesh files that the sender may name; None: those that all may name. ``last_number``: that of
        ``state`` when the message was received; None: now. Raises MessageError as ``handle``.
        """
        if last_number is None:
            last_number = self.state.last_number
        match channel.kind:
            case Kind.LOAD:
                return self._read_load(channel, message, files or self._files, last_number)
            case Kind.DRAW:
                return self._read_draw(channel.family, message, last_number)
            case Kind.DEFORMABLE:
                return self._read_deformable(channel, message)
            case Kind.CONTACTS:
                return self._read_contacts(channel, message)
            case Kind.CLOUD:
                warnings: list[str] = []
                parts = read_cloud(wire.decode_point_cloud(message, self._config.limits), warnings)
                return self._numbered(channel, lambda edit: edit.set_parts(channel.node, parts), warnings)
            case Kind.FRAMES:
                return self._read_frames(channel, message)

    def families(self) -> dict[str, dict[str, int]]:
        """Return the numbers of links and draw messages of each family, as plain JSON values."""
        return {
            family: {"links": robots.links, "draws": robots.draws, "stale": robots.stale, "unloaded": robots.unloaded}
            for family, robots in tuple(self.state.robots.items())  # a worker thread may add one
        }

    def _read_load(
        self, channel: Channel, message: wire.Message, files: MeshFiles, last_number: int
    ) -> ShowMessage | None:
        limits, loads, family = self._config.limits, self.state.loads, channel.family
        data = bytes(message)
        last = loads.get(channel, LastLoad(b"", must_be_read=True))
        is_repeated = last.data == data
        if is_repeated and not last.must_be_read:
            self.counters.repeated_loads += 1
            return None
        links = wire.decode_load_robot(data, limits)
        loaded = read_robots(links, family, files, limits)
        self._refuse_if_strict(loaded.warnings)
        names_files = any(geometry.text for link in links for geometry in link.geometries)

        def show(edit: TreeEdit) -> Sequence[str]:
            self._reserve_nodes(family, loaded.paths.values())
            if not is_repeated:
                self._clear_simulation(edit, last_number)
            self._robots(family).load(loaded, edit)
            for replaced in [other for other in loads if other.family == family]:  # two channels can have one family
                del loads[replaced]
            loads[channel] = LastLoad(data, must_be_read=names_files or bool(loaded.warnings))
            self.counters.loads += 1
            return loaded.warnings

        return show

    def _read_draw(self, family: str, message: wire.Message, last_number: int) -> ShowMessage:
        robots = self._robots(family)
        draw = wire.decode_draw(message, self._config.limits, robots.names)
        warnings = _pose_warnings(draw)
        self._refuse_if_strict(warnings)

        def show(edit: TreeEdit) -> Sequence[str]:
            reason_ignored = robots.draw(draw, edit)
            if reason_ignored:
                return (reason_ignored,)
            if draw.seconds < robots.seconds - RESTART_SECONDS:
                self._clear_simulation(edit, last_number)
            self.state.simulation_seconds = robots.seconds = draw.seconds
            return warnings

        return show

    def _read_deformable(self, channel: Channel, message: wire.Message) -> ShowMessage | None:
        limits = self._config.limits
        warnings: list[str] = []
        bodies = read_deformables(wire.decode_link_data(message, limits), channel.node, limits, warnings)
        self._refuse_if_strict(warnings)
        shown_bodies = self.state.deformables.setdefault(channel.name, ShownParts())
        if not bodies and not shown_bodies.paths:
            return None

        def show(edit: TreeEdit) -> Sequence[str]:
            self._reserve_nodes(channel.name, bodies)
            if bodies:
                show_family(edit, channel.family)
            shown_bodies.replace(bodies, edit)
            return warnings

        return show

    def _read_contacts(self, channel: Channel, message: wire.Message) -> ShowMessage | None:
        warnings: list[str] = []
        parts = read_contacts(wire.decode_contacts(message, self._config.limits), warnings)
        shown_contacts = self.state.contacts
        if not parts and not shown_contacts.paths and not warnings:
            return None
        return self._numbered(channel, lambda edit: shown_contacts.replace(parts, edit), warnings)

    def _read_frames(self, channel: Channel, message: wire.Message) -> ShowMessage:
        frames = self.state.frames.get(channel.name) or FrameChannel(channel.node)
        draw = wire.decode_draw(message, self._config.limits, frames.names)
        paths = frames.paths_of(draw.names, self._config.limits)

        def move_frames(edit: TreeEdit) -> None:
            if draw.names != frames.names or channel.name not in self.state.node_counts:  # cleared since the reading
                self._reserve_nodes(channel.name, paths)
            frames.apply(draw, paths, edit)
            self.state.frames[channel.name] = frames  # not before: any number of channels can have refused messages

        return self._numbered(channel, move_frames, _pose_warnings(draw))

    def _numbered(self, channel: Channel, change: Callable[[TreeEdit], object], warnings: Sequence[str]) -> ShowMessage:
        """Return a function that makes the change of a message of contacts, point clouds or frames, and numbers it."""
        self._refuse_if_strict(warnings)

        def show(edit: TreeEdit) -> Sequence[str]:
            change(edit)
            self.state.last_number += 1
            self.state.newest_numbers[channel] = self.state.last_number
            return warnings

        return show

    def _clear_simulation(self, edit: TreeEdit, last_number: int) -> None:
        """Delete what is shown of channels whose newest number is at most ``last_number``, the earlier simulation's."""
        state = self.state
        for channel in [channel for channel, number in state.newest_numbers.items() if number <= last_number]:
            del state.newest_numbers[channel]
            if channel.kind is Kind.CONTACTS:
                state.contacts.replace({}, edit)
            else:
                edit.delete(channel.node)
                state.frames.pop(channel.name, None)
                state.node_counts.pop(channel.name, None)

    def _reserve_nodes(self, source: str, paths: Iterable[Path]) -> None:
        """Count the nodes of a family's links, or of a channel, in place of its earlier ones. Raises MessageError."""
        counts, max_nodes = self.state.node_counts, self._config.nodes
        count = count_nodes(paths)
        total = sum(counts.values()) - counts.get(source, 0) + count
        if total > max_nodes:
            raise MessageError(f"the nodes of all channels would be {total}, the limit is {max_nodes}")
        counts[source] = count

    def _refuse_if_strict(self, warnings: Sequence[str]) -> None:
        """Raise MessageError if there are warnings and ``config.strict`` refuses them."""
        if self._config.strict and (refusal := strict_refusal(warnings)):
            raise MessageError(refusal)

    def _robots(self, family: str) -> RobotChannels:
        return self.state.robots.setdefault(family, RobotChannels(family))


def _pose_warnings(draw: Draw) -> list[str]:
    """Return a sentence about NaN or infinite poses, as of a simulation that diverges; nothing if all are finite."""
    if math.isfinite(draw.poses.sum()):
        return []
    count = int(np.count_nonzero(~np.isfinite(draw.poses).all(axis=1)))
    return [f"{count} of {len(draw.poses)} poses are not finite"] if count else []
