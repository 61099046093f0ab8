"""Frames of the channels ``DRAKE_DRAW_FRAMES*``, each drawn as three axes."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final

from gateway.drakeviewer.arrows import triad
from gateway.drakeviewer.link_paths import link_paths
from gateway.drakeviewer.messages import Draw, LinkNames
from gateway.scene.geometry import Part
from gateway.scene.tree import Path, TreeEdit

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

    def apply(self, draw: Draw, edit: TreeEdit) -> None:
        """Move the frames. If their names have changed, delete the earlier frames."""
        if draw.names is not self.names:
            if self.names is None or set(draw.names.keys) != set(self.names.keys):
                edit.delete(self.root)
            paths = link_paths(draw.names.keys)
            self._paths = [(*self.root, *paths[key]) for key in draw.names.keys]
            for path in self._paths:
                edit.set_parts(path, _axes())
            self.names = draw.names
        for path, pose in zip(self._paths, draw.poses.tolist(), strict=True):
            edit.set_pose(path, tuple(pose))
