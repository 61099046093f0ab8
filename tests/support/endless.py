"""A renderer that never finishes by itself."""

import threading
from typing import Any

from renderers.interface import Frame
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
