"""Build and parse the binary frames of the view's WebSocket: a JSON header and arrays.

Layout: ``u32 magic "SGV1" | u32 header bytes | header: JSON in UTF-8, padded with spaces | body``, little-endian. The
header refers to an array in the body as ``[offset, count]``: offset in bytes from the start of the body, number of
values. The offset is a multiple of 8, so that the page can use the array in place, without a copy.

A page numbers its changes of controls. It ignores values of a control that were sent before the gateway has received
its last change of that control: a frame ``received`` has the number.
"""

from __future__ import annotations

import struct
from array import array as packed_array
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.adapters.viewer import messages
from gateway.adapters.viewer.messages import NodeUpdate, SceneUpdate, Span, ViewMessage
from gateway.scene.page.control_store import ControlStore
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.nodes import Pose
from scenegate.messages import controls

MAGIC: Final = 0x31564753
"""The bytes "SGV1" as a little-endian integer."""
ALIGNMENT: Final = 8
"""Arrays start at multiples of this many bytes."""
PREFIX: Final = struct.Struct("<II")
"""``MAGIC`` and the size of the header."""
_json: Final = msgspec.json.Encoder()


class FrameBuilder:
    """Collects the nodes of a frame's header, and the arrays of its body."""

    __slots__ = ("_chunks", "_nodes", "_size")

    def __init__(self) -> None:
        self._nodes: list[Any] = []
        """Nodes as JSON."""
        self._chunks: list[bytes] = []
        self._size = 0

    def add_node(self, node: NodeUpdate) -> None:
        """Encode a node for the header's array ``nodes`` now: encoding thousands at once blocks the event loop."""
        self._nodes.append(msgspec.Raw(_json.encode(node)))

    def add_array(self, values: NDArray[Any] | packed_array[Any]) -> Span:
        """Append an array to the body; return its offset and count for the header."""
        data = values.tobytes()
        padding_bytes = -len(data) % ALIGNMENT
        self._chunks.append(data)
        if padding_bytes:
            self._chunks.append(bytes(padding_bytes))
        offset = self._size
        self._size += len(data) + padding_bytes
        return offset, int(values.size) if isinstance(values, np.ndarray) else len(values)

    def finish(self, header: ViewMessage) -> bytes:
        """Return the complete frame, with the fields of ``header``, and the nodes and arrays so far."""
        if isinstance(header, SceneUpdate):
            header.nodes = self._nodes
        text = _json.encode(header)
        padding_bytes = -(len(text) + PREFIX.size) % ALIGNMENT
        return b"".join((PREFIX.pack(MAGIC, len(text) + padding_bytes), text, b" " * padding_bytes, *self._chunks))


def encode(message: ViewMessage) -> bytes:
    """Return the frame of a message without arrays."""
    return FrameBuilder().finish(message)


class ControlFrames:
    """Encodes the controls. Pages that have the same revision share a frame."""

    def __init__(self, store: ControlStore, tree: LiveTree) -> None:
        self.store = store
        self._tree = tree
        self._frames: dict[int, bytes] = {}
        """Frames that lead to the newest revision, by the revision that the page has."""
        self._revision = store.revision

    def since(self, revision: int) -> bytes:
        """Return the frame with all that has changed since a revision."""
        store = self.store
        if self._revision != store.revision:
            self._revision = store.revision
            self._frames.clear()
        frame = self._frames.get(revision)
        if frame is None:
            builder = FrameBuilder()
            samples = [(control_id, builder.add_array(rows)) for control_id, rows in store.samples_since(revision)]
            header = messages.PageControls(
                controls=store.controls_since(revision), values=store.values_since(revision), samples=samples
            )
            frame = self._frames[revision] = builder.finish(header)
        return frame

    def change(self, change: messages.ControlChange) -> None:
        """Execute a change of a page. A gizmo moves its node, if there is one."""
        entry = self.store.change(change.control, change.value)
        if entry is None or not isinstance(entry.control, controls.Gizmo) or not isinstance(entry.value, controls.Pose):
            return
        pose: Pose = (*entry.value.translation, *entry.value.quaternion)
        if self._tree.snapshot.root.find(entry.control.node) is not None:
            with self._tree.edit() as edit:
                edit.set_pose(entry.control.node, pose)
