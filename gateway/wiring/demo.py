"""The moving demo scene in the live tree (``--demo``)."""

import asyncio
from collections.abc import Mapping
from typing import Any

from gateway.demo import RATE, Demo
from gateway.scene.tree.live import LiveTree
from gateway.wiring.context import Context
from gateway.wiring.provided import Provided


async def setup(context: Context, provided: Provided) -> Provided:
    """Run the demo scene's service."""
    context.run_service("demo", DemoService(context.tree))
    return provided


class DemoService:
    """Moves the demo scene ``RATE`` times a second; skips steps when the event loop is late."""

    def __init__(self, tree: LiveTree) -> None:
        self._demo = Demo(tree)
        self.ready = False

    def status(self) -> Mapping[str, Any]:
        """Return no figures."""
        return {}

    async def run(self) -> None:
        """Move the scene until cancelled, then remove it from the tree."""
        loop = asyncio.get_running_loop()
        self._demo.populate()
        self.ready = True
        start = loop.time()
        try:
            while True:
                now = loop.time() - start
                self._demo.move_to(now)
                await asyncio.sleep((int(now * RATE) + 1) / RATE - now)
        finally:
            self.ready = False
            self._demo.clear()
