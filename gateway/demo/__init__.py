"""A small moving scene to look at: a workcell with a robot arm, objects on a table and a scanner.

Everything is a pure function of time, so that pictures of it can be made again.
"""

from __future__ import annotations

from typing import Final

from gateway.demo.furniture import furniture
from gateway.demo.motion import PERIOD, poses
from gateway.scene.live import LiveTree
from gateway.scene.tree import TreeEdit

__all__ = ["PERIOD", "RATE", "ROOT", "Demo", "furniture", "poses"]

ROOT: Final = ("demo",)
RATE: Final = 30.0
"""Edits per second that look smooth."""


class Demo:
    """The scene in a live tree."""

    def __init__(self, tree: LiveTree) -> None:
        self._tree = tree

    def populate(self) -> None:
        """Puts everything at its place for time 0."""
        with self._tree.edit() as edit:
            edit.delete(ROOT)
            for path, parts in furniture().items():
                edit.set_parts((*ROOT, *path), parts)
            _put(edit, 0.0)

    def edit(self, t: float) -> None:
        """Moves everything to its place at time ``t``, seconds. One revision; geometry stays the same."""
        with self._tree.edit() as edit:
            _put(edit, t)

    def clear(self) -> None:
        """Takes the scene out of the tree."""
        with self._tree.edit() as edit:
            edit.delete(ROOT)


def _put(edit: TreeEdit, t: float) -> None:
    for path, pose in poses(t).items():
        edit.set_pose((*ROOT, *path), pose)
