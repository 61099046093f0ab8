"""Renderers that do not finish at once."""

import threading
from collections.abc import Callable
from typing import Any

from renderers.camera import Camera
from renderers.compiler import pending
from renderers.drawlist import DrawList
from renderers.interface import Frame, Look, Output
from renderers.stereo.depth.matching import in_turn
from renderers.stop import check_stop


class EndlessRenderer:
    """Checks its stop flag until it is set; counts the running and the ended calls."""

    parallel = staticmethod(in_turn)

    def __init__(self) -> None:
        self.begun = self.ended = 0
        self._lock = threading.Lock()

    def render(self, *_: Any, **__: Any) -> Frame:
        with self._lock:
            self.begun += 1
        try:
            while True:
                check_stop()
        finally:
            with self._lock:
                self.ended += 1


def waits_for_studio(render: Callable[..., Frame]) -> Callable[..., Frame]:
    """Return a function that renders with kernels of the part ``studio`` in the look of this name."""

    def waiting(scene: DrawList, camera: Camera, outputs: Output, look: Look) -> Frame:
        if look.name == "studio" and Output.COLOR in outputs:
            pending.wait_for_kernel("studio.shade")
        return render(scene, camera, outputs, look)

    return waiting
