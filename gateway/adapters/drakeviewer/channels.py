"""Channels of Drake's visualizer, by their names."""

from enum import Enum
from functools import lru_cache
from typing import Final, NamedTuple

from gateway.adapters.drakeviewer.robots import ILLUSTRATION, INERTIA, PROXIMITY, ROOT
from gateway.scene.tree.nodes import Path

PREFIXES: Final = ("DRAKE_", "CONTACT_RESULTS")
"""Prefixes of the names of channels that are received. Not all of them are shown."""


class Kind(Enum):
    """Content of a channel. The value is the start of the channel's name."""

    LOAD = "DRAKE_VIEWER_LOAD_ROBOT"
    """Links with their geometry."""
    DRAW = "DRAKE_VIEWER_DRAW"
    """Poses of links."""
    DEFORMABLE = "DRAKE_VIEWER_DEFORMABLE"
    """Deformable bodies."""
    CONTACTS = "CONTACT_RESULTS"
    """Contacts: the only channel with this start, whose name it is."""
    CLOUD = "DRAKE_POINT_CLOUD"
    FRAMES = "DRAKE_DRAW_FRAMES"


_FAMILIES: Final = {"": ILLUSTRATION, "_ILLUSTRATION": ILLUSTRATION, "_PROXIMITY": PROXIMITY, "_INERTIA": INERTIA}
"""Family by the end of the name of a channel of links or deformable bodies."""
_GROUPS: Final = {Kind.CLOUD: "point clouds", Kind.FRAMES: "frames"}
"""Names of the nodes above the point clouds and the frames."""


class Channel(NamedTuple):
    """A channel that is shown."""

    name: str
    kind: Kind
    family: str = ""
    """Family of links and deformable bodies; empty for others."""

    @property
    def group(self) -> str:
        """Family, or name of a channel without one: messages of one group depend on each other."""
        return self.family or self.name

    @property
    def has_fixed_name(self) -> bool:
        """False for point clouds and frames, of which there can be any number of channels."""
        return self.kind not in _GROUPS

    @property
    def reads_meshes(self) -> bool:
        """True if a worker thread must read it: it may name files, or need kernels that are not compiled yet."""
        return self.kind in (Kind.LOAD, Kind.DEFORMABLE)

    @property
    def node(self) -> Path:
        """Path of the node of a family, a point cloud, or the frames of a channel."""
        if self.has_fixed_name:
            return ROOT, self.family
        return ROOT, _GROUPS[self.kind], self.name[len(self.kind.value) :].removeprefix("_") or "default"


@lru_cache(maxsize=256)
def channel_of(name: str) -> Channel | None:
    """Return the channel of a name; None if it is not shown."""
    for kind in Kind:
        if name.startswith(kind.value):
            end = name[len(kind.value) :]
            if kind in (Kind.LOAD, Kind.DRAW, Kind.DEFORMABLE):
                return Channel(name, kind, _FAMILIES[end]) if end in _FAMILIES else None
            return None if kind is Kind.CONTACTS and end else Channel(name, kind)
    return None
