"""One small function a room: settings to its configuration, its routes or its service to the house.

Each imports its room itself: that loads compiled kernels, which must be cached before, and a room that cannot be
imported (a system library is missing) is a sentence on the board instead of the end of the process.
"""

from __future__ import annotations

from collections.abc import Callable

from gateway.house import House
from gateway.settings import InterfaceName

JOINS: dict[InterfaceName, Callable[[House], None]] = {}
"""In the order of joining."""
