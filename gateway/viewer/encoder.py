"""Updates of the page's scene: the differences between two snapshots of the tree as one binary frame.

The page holds nodes and meshes by id. Snapshots share their unchanged subtrees, so an update costs the number of
changes. Browsers at the same revision share the encoded bytes. A browser that skipped revisions gets one update that
leads to the newest revision directly.
"""

from __future__ import annotations

import asyncio
import time
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from typing import Any, Final

import msgspec
import numpy as np

from gateway.scene.live import Snapshot
from gateway.scene.tree import Change, Node, Path, changes
from gateway.viewer.frames import FrameBuilder, encode_fragment
from gateway.viewer.geometry_json import part_json
from gateway.viewer.resources import Resources
from gateway.viewer.sources import StereoRig
from renderers.cache import Cache

EMPTY: Final = Snapshot(Node(), 0)
"""The snapshot of a browser that has received nothing."""
MAX_TURN_SECONDS: Final = 0.002
"""Time after which encoding yields to the event loop; a scene of 50,000 nodes takes two seconds."""
MAX_UPDATES: Final = 8
"""Maximum number of encoded updates kept for other browsers; most of those are at one of the newest revisions."""
MAX_UPDATE_BYTES: Final = 256 << 20
"""Maximum size of these updates together."""


@dataclass(frozen=True, slots=True, eq=False)
class Update:
    """The differences between two revisions."""

    frame: bytes
    """Node structure, parts and transforms."""
    meshes: frozenset[int]
    """Ids of the meshes that the frame refers to."""


_INVALID_UPDATE: Final = Update(b"", frozenset())


class Encoder:
    """Encodes updates to the snapshot given to ``advance``. Belongs to the event loop.

    When there are more than ``max_node_ids`` paths, all ids are dropped and ``epoch`` grows by one: browsers of an
    earlier epoch must start again from ``EMPTY``.
    """

    def __init__(self, resources: Resources, max_node_ids: int = 1_000_000) -> None:
        self._resources = resources
        self._max_node_ids = max_node_ids
        self._ids: dict[Path, int] = {(): 0}
        self._updates: Cache[tuple[int, int], Update] = Cache(MAX_UPDATE_BYTES, MAX_UPDATES)
        self._encoding = asyncio.Lock()
        """Held while an update is encoded, so that browsers at the same revision encode it once."""
        self.current = EMPTY
        """The newest snapshot."""
        self.epoch = 0
        """Number of times that all ids were dropped."""

    def advance(self, snapshot: Snapshot) -> None:
        """Set the snapshot that updates lead to."""
        if snapshot.revision == self.current.revision:
            return
        self.current = snapshot
        if len(self._ids) > self._max_node_ids:
            self.epoch += 1
            self._ids = {(): 0}
            self._updates.clear()

    def node_id(self, path: Path) -> int:
        """Return the id of a path. It stays after the node is removed, since a browser may still have the node."""
        return self._ids.setdefault(path, len(self._ids))

    async def update(self, old: Snapshot) -> tuple[Update, Snapshot]:
        """Return the update from ``old`` to the current snapshot, and that snapshot.

        The current snapshot may change meanwhile. If ``epoch`` changes meanwhile, the update is invalid.
        """
        async with self._encoding:
            target, epoch = self.current, self.epoch
            key = (old.revision, target.revision)
            update = self._updates.get(key)
            if update is None:
                for update in self._encode(old, target):
                    if update is None:
                        await asyncio.sleep(0)
                    if self.epoch != epoch:
                        return _INVALID_UPDATE, target
                assert update is not None
                self._updates.put(key, update, len(update.frame))
            return update, target

    def _encode(self, old: Snapshot, target: Snapshot) -> Iterator[Update | None]:
        """Yield None after every ``MAX_TURN_SECONDS`` of work, and the update at the end."""
        nodes: list[msgspec.Raw] = []
        removed: list[int] = []
        transforms: list[tuple[int, Node]] = []
        meshes: set[int] = set()
        entry: dict[str, Any] = {}
        turn_end = time.perf_counter() + MAX_TURN_SECONDS
        for change in changes(old.root, target.root):
            node_id = self.node_id(change.path)
            if change.node is None:
                removed.append(node_id)
                continue
            if change.kind in ("added", "transform"):
                transforms.append((node_id, change.node))
            if change.kind not in ("transform", "reordered"):
                # All changes of a node follow one another.
                if entry and entry["id"] != node_id:
                    nodes.append(encode_fragment(entry))
                    entry = {}
                entry["id"] = node_id
                self._add_change(entry, change, change.node, meshes)
            if time.perf_counter() > turn_end:
                yield None
                turn_end = time.perf_counter() + MAX_TURN_SECONDS
        if entry:
            nodes.append(encode_fragment(entry))
        builder = FrameBuilder()
        header: dict[str, Any] = {"kind": "update", "from": old.revision, "revision": target.revision}
        if removed:
            header["removed"] = removed
        if nodes:
            header["nodes"] = nodes
        _add_transforms(builder, header, transforms)
        yield Update(builder.finish(header), frozenset(meshes))

    def _add_change(self, entry: dict[str, Any], change: Change, node: Node, meshes: set[int]) -> None:
        """Add a change to the node's entry in the header, and the ids of its meshes to ``meshes``."""
        added = change.kind == "added"
        if added:
            entry["parent"] = self.node_id(change.path[:-1])
            entry["name"] = change.path[-1]
        if change.kind == "visible" or (added and not node.visible):
            entry["visible"] = node.visible
        if change.kind == "geometry" or (added and node.parts is not None):
            parts = None if node.parts is None else [part_json(part, self._resources) for part in node.parts]
            entry["parts"] = parts
            meshes.update(draw["mesh"] for part in parts or () for draw in part["draws"])


def _add_transforms(builder: FrameBuilder, header: dict[str, Any], nodes: list[tuple[int, Node]]) -> None:
    """Add ids (uint32), poses (7 float32 each) and other transforms (16 float32 each, column-major) of nodes."""
    posed = [(node_id, node.pose) for node_id, node in nodes if node.pose is not None]
    others = [(node_id, node) for node_id, node in nodes if node.pose is None]
    if posed:
        # array() converts tuples faster than NumPy, and values beyond float32 to infinity.
        header["poses"] = {
            "ids": builder.add_array(array("I", [node_id for node_id, _ in posed])),
            "values": builder.add_array(array("f", chain.from_iterable([pose for _, pose in posed]))),
        }
    if others:
        with np.errstate(over="ignore"):
            values = np.array([node.matrix.T for _, node in others], dtype=np.float64).astype(np.float32)
        header["matrices"] = {
            "ids": builder.add_array(array("I", [node_id for node_id, _ in others])),
            "values": builder.add_array(values),
        }


def encode_status(status: dict[str, Any]) -> bytes:
    """Encode the state of the gateway, plain JSON values."""
    return FrameBuilder().finish({"kind": "status", **status})


def encode_stereo_rig(rig: StereoRig | None) -> bytes:
    """Encode the place of the stereo camera; the pose is null if there is none or it is not finite."""
    if rig is None or not np.isfinite(rig.pose).all():
        return FrameBuilder().finish({"kind": "rig", "pose": None})
    intrinsics = {name: getattr(rig, name) for name in ("width", "height", "fx", "fy", "cx", "cy", "baseline")}
    return FrameBuilder().finish({"kind": "rig", "pose": rig.pose.T.ravel().tolist(), **intrinsics})
