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
from gateway.drakeviewer.config import DrakeViewerConfig
from gateway.drakeviewer.contacts import read_contacts
from gateway.drakeviewer.frames import FrameChannel
from gateway.drakeviewer.link_paths import count_nodes
from gateway.drakeviewer.messages import Draw, MessageError
from gateway.drakeviewer.point_clouds import read_cloud
from gateway.drakeviewer.robots import (
    ILLUSTRATION,
    INERTIA,
    PROXIMITY,
    ROOT,
    RobotChannels,
    ShownParts,
    read_robots,
    show_family,
)
from gateway.drakeviewer.shapes import read_deformables
from gateway.scene.live import LiveTree
from gateway.scene.tree import Path, TreeEdit
from scenegate.warning_text import strict_refusal

PREFIXES: Final = ("DRAKE_", "CONTACT_RESULTS")
"""Prefixes of the names of channels that are received. Not all of them are shown."""
LOAD: Final = "DRAKE_VIEWER_LOAD_ROBOT"
"""Prefix of the channels of load messages."""
DRAW: Final = "DRAKE_VIEWER_DRAW"
"""Prefix of the channels of draw messages: poses of links."""
DEFORMABLE: Final = "DRAKE_VIEWER_DEFORMABLE"
"""Prefix of the channels of deformable bodies."""
CONTACT_RESULTS: Final = "CONTACT_RESULTS"
"""Name of the channel of contacts."""
POINT_CLOUD: Final = "DRAKE_POINT_CLOUD"
"""Prefix of the channels of point clouds."""
FRAMES: Final = "DRAKE_DRAW_FRAMES"
"""Prefix of the channels of coordinate frames."""
CLOUD_GROUP: Final = "point clouds"
"""Name of the node above the point clouds."""
FRAME_GROUP: Final = "frames"
"""Name of the node above the frames."""
RESTART_SECONDS: Final = 0.1
"""A draw message whose time is earlier than the last one's by more than this starts a new simulation. UDP can swap
messages that are milliseconds apart."""
FAMILIES: Final = {
    "": ILLUSTRATION,
    "_ILLUSTRATION": ILLUSTRATION,
    "_PROXIMITY": PROXIMITY,
    "_INERTIA": INERTIA,
}
"""Family by the suffix of the channels ``LOAD``, ``DRAW`` and ``DEFORMABLE``."""

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
    loads: dict[str, tuple[bytes, bool]] = field(default_factory=dict)
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
    shown_at: dict[str, int] = field(default_factory=dict)
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

    @staticmethod
    def is_shown(channel: str) -> bool:
        """Return True for the channels that are shown."""
        is_of_family = _kind_and_family(channel) is not None
        return is_of_family or channel == CONTACT_RESULTS or channel.startswith((POINT_CLOUD, FRAMES))

    def has_fixed_name(self, channel: str) -> bool:
        """Return False for the channels of point clouds and frames, of which there can be any number."""
        return not channel.startswith((POINT_CLOUD, FRAMES))

    def group(self, channel: str) -> str:
        """Return the family of a channel, or the channel itself: messages of one group depend on each other."""
        found = _kind_and_family(channel)
        return channel if found is None else found[1]

    def is_load(self, channel: str) -> bool:
        """Return True for the channels of load messages."""
        return channel.startswith(LOAD)

    def reads_meshes(self, channel: str) -> bool:
        """Return True for the channels of meshes, which must be read in a worker thread: they may name files, and the
        kernels of their normals may not be compiled yet.
        """
        return channel.startswith((LOAD, DEFORMABLE))

    def handle(self, channel: str, message: wire.Message) -> Sequence[str]:
        """Read a message and apply it at once; see ``Edit`` for the result.

        Raises:
            MessageError: The message is damaged, of another type, or beyond a limit.
        """
        return self.apply(self.read(channel, message))

    def apply(self, edit: Edit | None, timestamp: int | None = None) -> Sequence[str]:
        """Apply an edit as one revision of the live tree, valid from ``timestamp``; see ``Edit`` for the result."""
        if edit is None:
            return ()
        with self._live.edit(timestamp) as tree:
            return edit(tree)

    def read(self, channel: str, message: wire.Message, files: MeshFiles | None = None) -> Edit | None:
        """Read a message of a channel for which ``is_shown`` is true; return its edit, None if it changes nothing.

        Args:
            files: mesh files that the sender may name; None: those that all senders may name.

        Raises:
            MessageError: The message is damaged, of another type, or beyond a limit.
        """
        found = _kind_and_family(channel)
        if found is not None:
            kind, family = found
            if kind == LOAD:
                return self._read_load(channel, family, message, files or self._files)
            return self._read_draw(family, message) if kind == DRAW else self._read_deformable(channel, family, message)
        if channel == CONTACT_RESULTS:
            return self._read_contacts(message)
        if channel.startswith(POINT_CLOUD):
            return self._read_cloud(channel, message)
        return self._read_frames(channel, message)

    @property
    def simulation_seconds(self) -> float | None:
        """Time of the simulation in the last draw message that was shown; None before the first one."""
        return self.state.seconds

    def families(self) -> dict[str, dict[str, int]]:
        """Return the numbers of links and draw messages of each family, as plain JSON values."""
        return {
            family: {"links": robots.links, "draws": robots.draws, "stale": robots.stale, "unloaded": robots.unloaded}
            for family, robots in self.state.robots.items()
        }

    def _read_load(self, channel: str, family: str, message: wire.Message, files: MeshFiles) -> Edit | None:
        limits, loads = self._config.limits, self.state.loads
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
            for other in [name for name in loads if _kind_and_family(name) == (LOAD, family)]:
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

    def _read_deformable(self, channel: str, family: str, message: wire.Message) -> Edit | None:
        limits = self._config.limits
        warnings: list[str] = []
        bodies = read_deformables(wire.decode_link_data(message, limits), (ROOT, family), limits, warnings)
        self._refuse_if_strict(warnings)
        shown = self.state.deformables.setdefault(channel, ShownParts())
        if not bodies and not shown.paths:
            return None

        def apply(edit: TreeEdit) -> Sequence[str]:
            self._reserve_nodes(channel, bodies)
            if bodies:
                show_family(edit, family)
            shown.replace(bodies, edit)
            return warnings

        return apply

    def _read_contacts(self, message: wire.Message) -> Edit | None:
        warnings: list[str] = []
        parts = read_contacts(wire.decode_contacts(message, self._config.limits), warnings)
        shown = self.state.contacts
        if not parts and not shown.paths and not warnings:
            return None
        return self._simulation_edit(CONTACT_RESULTS, lambda edit: shown.replace(parts, edit), warnings)

    def _read_cloud(self, channel: str, message: wire.Message) -> Edit:
        warnings: list[str] = []
        parts = read_cloud(wire.decode_point_cloud(message, self._config.limits), warnings)
        path = _channel_path(CLOUD_GROUP, channel, POINT_CLOUD)
        return self._simulation_edit(channel, lambda edit: edit.set_parts(path, parts), warnings)

    def _read_frames(self, channel: str, message: wire.Message) -> Edit:
        shown = self.state.frames.get(channel) or FrameChannel(_channel_path(FRAME_GROUP, channel, FRAMES))
        draw = wire.decode_draw(message, self._config.limits, shown.names)
        paths = shown.paths_of(draw.names, self._config.limits)
        self.state.frames[channel] = shown

        def apply(edit: TreeEdit) -> None:
            if draw.names is not shown.names:
                self._reserve_nodes(channel, paths)
            shown.apply(draw, paths, edit)

        return self._simulation_edit(channel, apply, _not_finite(draw))

    def _simulation_edit(self, channel: str, apply: Callable[[TreeEdit], object], warnings: Sequence[str]) -> Edit:
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
            if channel == CONTACT_RESULTS:
                state.contacts.replace({}, edit)
            elif channel.startswith(POINT_CLOUD):
                edit.delete(_channel_path(CLOUD_GROUP, channel, POINT_CLOUD))
            else:
                edit.delete(_channel_path(FRAME_GROUP, channel, FRAMES))
                state.frames.pop(channel, None)
                state.nodes.pop(channel, None)

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


def _kind_and_family(channel: str) -> tuple[str, str] | None:
    """Return the kind and the family of a load, draw or deformable channel; None for others."""
    for kind in (LOAD, DRAW, DEFORMABLE):
        if channel.startswith(kind):
            family = FAMILIES.get(channel[len(kind) :])
            return None if family is None else (kind, family)
    return None


def _channel_path(group: str, channel: str, prefix: str) -> Path:
    """Return the path of a channel's node: below ``group``, with the channel's name without ``prefix``."""
    return (ROOT, group, channel[len(prefix) :].removeprefix("_") or "default")


def _not_finite(draw: Draw) -> list[str]:
    """Return a sentence about NaN or infinite poses, as of a simulation that diverges; nothing if all are finite."""
    if math.isfinite(draw.poses.sum()):
        return []
    count = int(np.count_nonzero(~np.isfinite(draw.poses).all(axis=1)))
    return [f"{count} of {len(draw.poses)} poses are not finite"] if count else []
