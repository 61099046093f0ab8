"""Drake's visualizer channels without network I/O: read a message, then apply it to the live tree.

Reading a load message opens the mesh files that it names.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from gateway.assets.mesh_files import MeshFiles
from gateway.drakeviewer import wire
from gateway.drakeviewer.channels import Channel, Kind, channel_of
from gateway.drakeviewer.config import DrakeViewerConfig
from gateway.drakeviewer.contacts import read_contacts
from gateway.drakeviewer.frames import FrameChannel
from gateway.drakeviewer.link_paths import count_nodes
from gateway.drakeviewer.messages import Draw, MessageError
from gateway.drakeviewer.point_clouds import read_cloud
from gateway.drakeviewer.robots import (
    RobotChannels,
    ShownParts,
    read_robots,
    show_family,
)
from gateway.drakeviewer.shapes import read_deformables
from gateway.scene.live import LiveTree
from gateway.scene.tree import Path, TreeEdit
from scenegate.warning_text import strict_refusal

RESTART_SECONDS: Final = 0.1
"""A draw message whose time is earlier than the last one's by more than this starts a new simulation. UDP can swap
messages that are milliseconds apart."""

Edit = Callable[[TreeEdit], Sequence[str]]
"""Applies a message to the live tree. Returns the reasons why some or all of the message is not shown."""


@dataclass(slots=True)
class Counters:
    """Numbers of messages since start."""

    received: int = 0
    """Messages of the channels that are shown."""
    undecodable: int = 0
    """Messages that are damaged, of another type or beyond a limit."""
    loads: int = 0
    """Load messages that were shown."""
    repeated_loads: int = 0
    """Load messages without mesh files that were equal to the one before."""
    unshown: int = 0
    """Messages of channels that are not shown."""


@dataclass(slots=True, eq=False)
class DrakeState:
    """State of the channels, besides what the live tree has."""

    robots: dict[str, RobotChannels] = field(default_factory=dict)
    """Robots by family."""
    loads: dict[Channel, tuple[bytes, bool]] = field(default_factory=dict)
    """Last load message of each channel, and True if it must be read again: it names files, or something is missing."""
    deformables: dict[str, ShownParts] = field(default_factory=dict)
    """Deformable bodies by channel."""
    frames: dict[str, FrameChannel] = field(default_factory=dict)
    """Frames by channel."""
    contacts: ShownParts = field(default_factory=ShownParts)
    nodes: dict[str, int] = field(default_factory=dict)
    """Number of nodes of each family's links, and of each channel of frames or deformable bodies."""
    seconds: float | None = None
    """Time of the last draw message that was shown."""
    shown: int = 0
    """Number of messages of contacts, point clouds and frames that were shown."""
    shown_at: dict[Channel, int] = field(default_factory=dict)
    """Value of ``shown`` after the newest of these messages, by channel."""

    def copy(self) -> DrakeState:
        """Return a copy that later messages do not change."""
        return replace(
            self,
            robots={name: copy(robots) for name, robots in self.robots.items()},
            loads=self.loads.copy(),
            deformables={name: copy(channel) for name, channel in self.deformables.items()},
            frames={name: copy(channel) for name, channel in self.frames.items()},
            contacts=copy(self.contacts),
            nodes=self.nodes.copy(),
            shown_at=self.shown_at.copy(),
        )


class DrakeViewer:
    """Shows Drake's messages in the live tree.

    ``read`` is thread-safe for messages of different channels; ``apply`` and ``handle`` must run in one thread.
    """

    def __init__(
        self,
        live: LiveTree,
        files: MeshFiles,
        config: DrakeViewerConfig | None = None,
        state: DrakeState | None = None,
    ) -> None:
        """
        Args:
            files: Reads mesh files that all senders may name.
            state: State of the viewer that has edited the tree before; None: there was none.
        """
        self._live = live
        self._files = files
        self._config = config or DrakeViewerConfig()
        self.state = state or DrakeState()
        self.counters = Counters()

    def handle(self, channel_name: str, message: wire.Message) -> Sequence[str]:
        """Read a message and apply it at once, unless its channel is not shown; see ``Edit`` for the result.

        Raises:
            MessageError: The message is damaged, of another type, or beyond a limit.
        """
        channel = channel_of(channel_name)
        return () if channel is None else self.apply(self.read(channel, message))

    def apply(self, edit: Edit | None, timestamp: int | None = None) -> Sequence[str]:
        """Apply an edit as one revision of the live tree, valid from ``timestamp``; see ``Edit`` for the result."""
        if edit is None:
            return ()
        with self._live.edit(timestamp) as tree:
            return edit(tree)

    def read(self, channel: Channel, message: wire.Message, files: MeshFiles | None = None) -> Edit | None:
        """Read a message; return its edit, None if it changes nothing.

        Args:
            files: mesh files that the sender may name; None: those that all senders may name.

        Raises:
            MessageError: The message is damaged, of another type, or beyond a limit.
        """
        match channel.kind:
            case Kind.LOAD:
                return self._read_load(channel, message, files or self._files)
            case Kind.DRAW:
                return self._read_draw(channel.family, message)
            case Kind.DEFORMABLE:
                return self._read_deformable(channel, message)
            case Kind.CONTACTS:
                return self._read_contacts(channel, message)
            case Kind.CLOUD:
                return self._read_cloud(channel, message)
            case Kind.FRAMES:
                return self._read_frames(channel, message)

    def families(self) -> dict[str, dict[str, int]]:
        """Return the numbers of links and draw messages of each family, as plain JSON values."""
        return {
            family: {"links": robots.links, "draws": robots.draws, "stale": robots.stale, "unloaded": robots.unloaded}
            for family, robots in self.state.robots.items()
        }

    def _read_load(self, channel: Channel, message: wire.Message, files: MeshFiles) -> Edit | None:
        limits, loads, family = self._config.limits, self.state.loads, channel.family
        shown_before = self.state.shown  # what arrives while files are read belongs to the new simulation
        data = bytes(message)
        last, must_be_read = loads.get(channel, (b"", False))
        is_repeated = last == data
        if is_repeated and not must_be_read:
            self.counters.repeated_loads += 1
            return None
        links = wire.decode_load_robot(data, limits)
        loaded = read_robots(links, family, files, limits)
        warnings = self._refuse_if_strict(loaded.warnings)
        has_files = any(geometry.text for link in links for geometry in link.geometries)

        def apply(edit: TreeEdit) -> Sequence[str]:
            self._reserve_nodes(family, loaded.paths.values())
            if not is_repeated:
                self._clear_simulation(edit, shown_before)
            self._robots(family).load(loaded, edit)
            for other in [other for other in loads if other.family == family]:
                del loads[other]
            loads[channel] = (data, has_files or bool(warnings))
            self.counters.loads += 1
            return warnings

        return apply

    def _read_draw(self, family: str, message: wire.Message) -> Edit:
        robots = self._robots(family)
        draw = wire.decode_draw(message, self._config.limits, robots.names)
        not_finite = self._refuse_if_strict(_not_finite(draw))

        def apply(edit: TreeEdit) -> Sequence[str]:
            warning = robots.draw(draw, edit)
            if not warning:
                if draw.seconds < robots.seconds - RESTART_SECONDS:
                    self._clear_simulation(edit, self.state.shown)
                self.state.seconds = robots.seconds = draw.seconds
            return (warning,) if warning else not_finite

        return apply

    def _read_deformable(self, channel: Channel, message: wire.Message) -> Edit | None:
        limits = self._config.limits
        warnings: list[str] = []
        bodies = read_deformables(wire.decode_link_data(message, limits), channel.node, limits, warnings)
        self._refuse_if_strict(warnings)
        shown = self.state.deformables.setdefault(channel.name, ShownParts())
        if not bodies and not shown.paths:
            return None

        def apply(edit: TreeEdit) -> Sequence[str]:
            self._reserve_nodes(channel.name, bodies)
            if bodies:
                show_family(edit, channel.family)
            shown.replace(bodies, edit)
            return warnings

        return apply

    def _read_contacts(self, channel: Channel, message: wire.Message) -> Edit | None:
        warnings: list[str] = []
        parts = read_contacts(wire.decode_contacts(message, self._config.limits), warnings)
        shown = self.state.contacts
        if not parts and not shown.paths and not warnings:
            return None
        return self._simulation_edit(channel, lambda edit: shown.replace(parts, edit), warnings)

    def _read_cloud(self, channel: Channel, message: wire.Message) -> Edit:
        warnings: list[str] = []
        parts = read_cloud(wire.decode_point_cloud(message, self._config.limits), warnings)
        return self._simulation_edit(channel, lambda edit: edit.set_parts(channel.node, parts), warnings)

    def _read_frames(self, channel: Channel, message: wire.Message) -> Edit:
        shown = self.state.frames.get(channel.name) or FrameChannel(channel.node)
        draw = wire.decode_draw(message, self._config.limits, shown.names)
        paths = shown.paths_of(draw.names, self._config.limits)
        self.state.frames[channel.name] = shown

        def apply(edit: TreeEdit) -> None:
            if draw.names is not shown.names:
                self._reserve_nodes(channel.name, paths)
            shown.apply(draw, paths, edit)

        return self._simulation_edit(channel, apply, _not_finite(draw))

    def _simulation_edit(self, channel: Channel, apply: Callable[[TreeEdit], object], warnings: Sequence[str]) -> Edit:
        """Return the edit of a message of contacts, point clouds or frames, and count it for ``_clear_simulation``."""
        self._refuse_if_strict(warnings)

        def edit_and_count(edit: TreeEdit) -> Sequence[str]:
            apply(edit)
            self.state.shown += 1
            self.state.shown_at[channel] = self.state.shown
            return warnings

        return edit_and_count

    def _clear_simulation(self, edit: TreeEdit, last: int) -> None:
        """Delete the contacts, point clouds and frames of the last simulation.

        Args:
            last: number of its last message: the value of ``DrakeState.shown`` after it.
        """
        state = self.state
        for channel in [channel for channel, number in state.shown_at.items() if number <= last]:
            del state.shown_at[channel]
            if channel.kind is Kind.CONTACTS:
                state.contacts.replace({}, edit)
            else:
                edit.delete(channel.node)
                state.frames.pop(channel.name, None)
                state.nodes.pop(channel.name, None)

    def _reserve_nodes(self, source: str, paths: Iterable[Path]) -> None:
        """Count the nodes of a family's links, or of a channel, in place of its earlier ones.

        Raises:
            MessageError: There are too many nodes of all channels together.
        """
        nodes = self.state.nodes
        count = count_nodes(paths)
        total = sum(nodes.values()) - nodes.get(source, 0) + count
        if total > self._config.nodes:
            raise MessageError(f"the nodes of all channels would be {total}, the limit is {self._config.nodes}")
        nodes[source] = count

    def _refuse_if_strict(self, warnings: Sequence[str]) -> Sequence[str]:
        """Return the warnings; raise MessageError if there are any and ``config.strict`` refuses them."""
        if warnings and self._config.strict:
            raise MessageError(strict_refusal(warnings))
        return warnings

    def _robots(self, family: str) -> RobotChannels:
        return self.state.robots.setdefault(family, RobotChannels(family))


def _not_finite(draw: Draw) -> list[str]:
    """Return a sentence about NaN or infinite poses, as of a simulation that diverges; nothing if all are finite."""
    if math.isfinite(draw.poses.sum()):
        return []
    count = int(np.count_nonzero(~np.isfinite(draw.poses).all(axis=1)))
    return [f"{count} of {len(draw.poses)} poses are not finite"] if count else []
