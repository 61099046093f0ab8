"""Keeps the demo scene moving, as a service."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import Any

from gateway.demo import RATE, Demo
from gateway.scene.live import LiveTree


class DemoRun:
    """Moves the scene at its rate; skips steps when the loop is late."""

    def __init__(self, tree: LiveTree) -> None:
        self._demo = Demo(tree)
        self.ready = False
        """Whether the scene is there."""

    def status(self) -> Mapping[str, Any]:
        """Nothing to tell."""
        return {}

    async def run(self) -> None:
        """Works until cancelled, and takes the scene away."""
        loop = asyncio.get_running_loop()
        self._demo.populate()
        self.ready = True
        start = loop.time()
        try:
            while True:
                now = loop.time() - start
                self._demo.edit(now)
                await asyncio.sleep((int(now * RATE) + 1) / RATE - now)
        finally:
            self.ready = False
            self._demo.clear()
