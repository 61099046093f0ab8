"""A small moving demo scene: a workcell with a robot arm, objects on a table and a scanner.

The scene is a pure function of time, so its images are reproducible.
"""

import asyncio
from collections.abc import Mapping
from typing import Any, Final

from gateway.demo.objects import PERIOD, poses, scene_parts
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.nodes import TreeEdit

__all__ = ["PERIOD", "RATE", "ROOT", "Demo", "poses", "scene_parts"]

ROOT: Final = ("demo",)
"""Path of the demo in the live tree."""
RATE: Final = 30.0
"""Steps per second."""


class Demo:
    """The demo scene in a live tree. ``run`` moves it; steps are skipped when the event loop is late."""

    def __init__(self, tree: LiveTree) -> None:
        self._tree = tree
        self.ready = False

    def status(self) -> Mapping[str, Any]:
        """Return no figures."""
        return {}

    async def run(self) -> None:
        """Move the scene until cancelled, then remove it from the tree."""
        loop = asyncio.get_running_loop()
        self.populate()
        self.ready = True
        start = loop.time()
        try:
            while True:
                now = loop.time() - start
                self.move_to(now)
                await asyncio.sleep((int(now * RATE) + 1) / RATE - now)
        finally:
            self.ready = False
            with self._tree.edit() as edit:
                edit.delete(ROOT)

    def populate(self) -> None:
        """Add the scene with its poses at time 0; replace an existing one."""
        with self._tree.edit() as edit:
            edit.delete(ROOT)
            for path, parts in scene_parts().items():
                edit.set_parts((*ROOT, *path), parts)
            _set_poses(edit, 0.0)

    def move_to(self, t: float) -> None:
        """Move the scene to its poses at time ``t`` in seconds, in one revision that changes transforms only."""
        with self._tree.edit() as edit:
            _set_poses(edit, t)


def _set_poses(edit: TreeEdit, t: float) -> None:
    for path, pose in poses(t).items():
        edit.set_pose((*ROOT, *path), pose)
