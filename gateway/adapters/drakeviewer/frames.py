"""Frames of the channels ``DRAKE_DRAW_FRAMES*``, each drawn as three axes."""

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final

from gateway.adapters.drakeviewer.arrows import triad
from gateway.adapters.drakeviewer.config import Limits
from gateway.adapters.drakeviewer.link_paths import link_paths
from gateway.adapters.drakeviewer.wire import Draw, LinkNames
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.nodes import Path, TreeEdit

LENGTH: Final = 0.25
"""Length of the axes, metres, as in Drake's own viewer."""
RADIUS: Final = 0.01
"""Radius of the axes, metres."""


@lru_cache(maxsize=1)
def _axes() -> tuple[Part, ...]:
    return triad(LENGTH, RADIUS)


@dataclass(slots=True, eq=False)
class FrameChannel:
    """The frames of one channel in the live tree."""

    root: Path
    """Path of the node above the frames."""
    names: LinkNames | None = None
    """Names in the last message, for ``wire.decode_draw``."""
    _paths: list[Path] = field(default_factory=list)
    """Path of each frame in ``names``."""

    def paths_of(self, names: LinkNames, limits: Limits) -> list[Path]:
        """Return the path of each frame in a message. Raises MessageError if a name has too many elements."""
        if names == self.names:
            return self._paths
        paths = link_paths(names.keys, limits)
        return [(*self.root, *paths[key]) for key in names.keys]

    def apply(self, draw: Draw, paths: list[Path], edit: TreeEdit) -> None:
        """Move the frames at ``paths_of`` the message. If their names have changed, delete the earlier frames."""
        if draw.names != self.names:
            if self.names is None or set(draw.names.keys) != set(self.names.keys):
                edit.delete(self.root)
            self.names, self._paths = draw.names, paths
        for path, node in zip(paths, edit.set_poses(paths, map(tuple, draw.poses.tolist())), strict=True):
            if node.parts is None:  # new, or deleted by a client of the tree viewer
                edit.set_parts(path, _axes())
