"""Logs for tests, and what a viewer that receives their messages shows after each."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from gateway.adapters.drakeviewer.viewer import DrakeViewer
from gateway.adapters.drakeviewer.wire import MessageError
from gateway.adapters.treeviewer.protocol import REQUEST, TreeViewerProtocol
from gateway.files.assets.mesh_files import MeshFiles
from gateway.scene.tree.geometry import PointCloud, Surface
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.nodes import Node
from scenegate.lcm.event_log import pack_event, read_events
from scenegate.messages import wire

CHANNEL = f"{REQUEST}_<me>"
BEGIN = 1_700_000_000
"""Time of the first event of most logs, seconds."""
Message = tuple[float, str, bytes]
"""Seconds after BEGIN, channel and data."""


def write_log(path: Path, messages: Iterable[Message]) -> Path:
    path.write_bytes(
        b"".join(
            pack_event(number, BEGIN * 1_000_000 + round(seconds * 1e6), channel, data)
            for number, (seconds, channel, data) in enumerate(messages)
        )
    )
    return path


def nanoseconds(seconds: float) -> int:
    return BEGIN * 1_000_000_000 + round(seconds * 1e6) * 1000


def content(root: Node) -> list[Any]:
    """Return everything of a tree that pages show, for comparisons."""
    return [
        (path, node.visible, node.opacity, node.matrix.tolist(), [_shape(part.shape) for part in node.parts or ()])
        for path, node in root.walk()
    ]


def _shape(shape: Any) -> Any:
    if isinstance(shape, Surface):
        return shape.mesh.positions.tobytes(), np.asarray(shape.mesh.elements).tobytes()
    if isinstance(shape, PointCloud):
        return shape.points.tobytes(), sorted(shape.channels)
    return repr(shape)


def states(log: Path) -> list[tuple[int, Node]]:
    """Return time and tree after each message of a log, as a viewer shows it that gets them one after the other."""
    live = LiveTree()
    tree, drake = TreeViewerProtocol(live), DrakeViewer(live, MeshFiles(()))
    found = []
    with log.open("rb") as file:
        for event in read_events(file):
            try:
                if event.channel.startswith(REQUEST):
                    tree.handle(event.data)
                else:
                    drake.handle(event.channel, event.data)
            except (wire.WireError, MessageError):
                pass
            found.append((1000 * event.time_us, live.snapshot.root))
    return found
