"""States of a replay from which others can begin, so that no seek replays more than a part of the log."""

from bisect import bisect_right
from typing import Final

from gateway.replay.log_replay import ReplayState
from gateway.scene.tree.nodes import CHILD_BYTES, NODE_BYTES, Node

MAX_BYTES: Final = 512 << 20
"""Default limit of the memory that checkpoints need besides the newest state."""
MAX_COUNT: Final = 4096
"""Limit of the number of checkpoints."""
MIN_INTERVAL: Final = 500.0
"""Default cost of the events between two checkpoints (``cost_of``): a seek replays them in about 50 ms."""
LINK_BYTES: Final = 100
"""Memory of the state of one of Drake's links, frames or bodies."""


class Checkpoints:
    """Checkpoints in the order of the log. If they need too much memory, every second one is dropped."""

    def __init__(self, max_bytes: int = MAX_BYTES, max_count: int = MAX_COUNT, interval: float = MIN_INTERVAL) -> None:
        self._max_bytes, self._max_count = max_bytes, max_count
        self._states = [ReplayState()]
        self._bytes = [0]
        """Bytes that each checkpoint needs besides the one before."""
        self.interval = interval
        """Cost of the events between two checkpoints."""

    def __len__(self) -> int:
        return len(self._states)

    @property
    def nbytes(self) -> int:
        """Estimate of the memory of all checkpoints."""
        return sum(self._bytes)

    def add(self, state: ReplayState) -> None:
        """Append a checkpoint."""
        self._bytes.append(bytes_besides(state, self._states[-1]))
        self._states.append(state)
        while len(self._states) > 1 and (self.nbytes > self._max_bytes or len(self._states) > self._max_count):
            self._states = self._states[::2]
            pairs = zip(self._states[1:], self._states, strict=False)
            self._bytes = [0, *(bytes_besides(state, earlier) for state, earlier in pairs)]
            self.interval *= 2.0

    def before(self, time_ns: int) -> ReplayState:
        """Return the last checkpoint with no event after a time, nanoseconds since the epoch."""
        return self._states[max(0, bisect_right(self._states, time_ns, key=lambda each: each.clock.time_ns) - 1)]


def bytes_besides(state: ReplayState, earlier: ReplayState) -> int:
    """Return an estimate of the memory that a state needs besides an earlier one."""
    size = LINK_BYTES * sum(state.drake.node_counts.values())
    for channel, load in state.drake.loads.items():
        earlier_load = earlier.drake.loads.get(channel)
        if earlier_load is None or earlier_load.data is not load.data:
            size += len(load.data)
    stack: list[tuple[Node, Node | None]] = [(state.snapshot.root, earlier.snapshot.root)]
    while stack:
        node, before = stack.pop()
        if node is before:
            continue
        size += NODE_BYTES + CHILD_BYTES * len(node.children)
        if before is None or node.parts is not before.parts:
            size += sum(NODE_BYTES + part.array_bytes for part in node.parts or ())
        children = before.children if before is not None else {}
        stack += [(child, children.get(name)) for name, child in node.children.items()]
    return size
