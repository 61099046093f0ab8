"""Encode updates of the page's scene, and its status messages. ``hub`` and ``browser`` use it.

An update is one binary frame with the differences between two snapshots of the tree. The page stores nodes and meshes
by id. Snapshots share their unchanged subtrees, so the time to encode an update depends on the number of changes.
Browsers at the same revision share the encoded bytes. A browser that skipped revisions receives one update that leads
to the newest revision directly.
"""

import asyncio
import time
from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Final
from weakref import ref

import numpy as np

from gateway.adapters.viewer import messages
from gateway.adapters.viewer.frames import FrameBuilder, encode
from gateway.adapters.viewer.geometry_messages import part_message
from gateway.adapters.viewer.messages import PlacedRig
from gateway.adapters.viewer.resources import Resources
from gateway.scene.page.live_page import LivePage
from gateway.scene.tree.live import Snapshot
from gateway.scene.tree.nodes import Change, Node, Path, changes

EMPTY_SNAPSHOT: Final = Snapshot(Node(), 0)
"""The snapshot of a page that has received no update."""
MAX_BLOCKING_SECONDS: Final = 0.002
"""Maximum time that encoding blocks the event loop. Encoding a scene of 50,000 nodes takes two seconds in total."""
MAX_POSE_METRES: Final = 1000.0
"""Poses with larger coordinates are sent as matrices, which are float64: float32 has steps of 0.06 mm here."""
MAX_UPDATES: Final = 8
"""Maximum number of encoded updates that are kept for other browsers."""


@dataclass(frozen=True, slots=True, eq=False)
class Update:
    """The differences between two revisions of the scene."""

    frame: bytes
    """The binary message: removed, added and changed nodes."""
    meshes: frozenset[int]
    """Ids of the meshes that the frame refers to."""


_INVALID_UPDATE: Final = Update(b"", frozenset())


class Encoder:
    """Encodes updates. Not thread-safe: it is used in the event loop only.

    When more than ``max_node_ids`` paths have an id, all ids are dropped and ``epoch`` is incremented. Pages of an
    earlier epoch must then be updated from ``EMPTY_SNAPSHOT``.
    """

    def __init__(self, resources: Resources, max_node_ids: int = 1_000_000) -> None:
        self._resources = resources
        self._max_node_ids = max_node_ids
        self._ids: dict[Path, int] = {(): 0}
        """Id of each path."""
        self._updates: dict[tuple[int, int, ref[Node], ref[Node]], Update] = {}
        """Encoded updates by the old and new revision and tree. A log has several trees of one revision, each decoded
        for a seek: they are equal, but their meshes are different objects with different ids."""
        self._encode_lock = asyncio.Lock()
        """Held while an update is encoded, so that two browsers do not encode the same update."""
        self.current = EMPTY_SNAPSHOT
        """The newest snapshot."""
        self.epoch = 0
        """Number of times that all ids were dropped."""

    def advance(self, snapshot: Snapshot) -> None:
        """Set the newest snapshot, to which later updates lead."""
        if snapshot.revision != self.current.revision:
            self.current = snapshot
            self._updates.clear()  # none leads to this snapshot
            self.limit_ids()

    def limit_ids(self) -> None:
        """Drop all ids if there are too many. Called before a page gets another snapshot."""
        if len(self._ids) > self._max_node_ids:
            self.epoch += 1
            self._ids = {(): 0}
            self._updates.clear()

    def node_id(self, path: Path) -> int:
        """Return the id of a path. The id is kept when the node is removed, because a page may still have the node."""
        return self._ids.setdefault(path, len(self._ids))

    def path_of(self, node_id: int) -> Path | None:
        """Return the path of an id, or None if there is no such id."""
        return next(islice(self._ids, node_id, None), None) if node_id >= 0 else None

    async def update(self, old: Snapshot, target: Snapshot | None = None) -> tuple[Update, Snapshot]:
        """Return the update from ``old`` to ``target``, and that snapshot. None: the newest one.

        Another task may call ``advance`` while the update is encoded. The update is invalid if ``epoch`` has changed.
        """
        async with self._encode_lock:
            target, epoch = target or self.current, self.epoch
            key = (old.revision, target.revision, ref(old.root), ref(target.root))
            update = self._updates.get(key)
            if update is None:
                for update in self._encode(old, target):
                    if update is None:
                        await asyncio.sleep(0)
                    if self.epoch != epoch:
                        return _INVALID_UPDATE, target
                assert update is not None
                if len(self._updates) >= MAX_UPDATES:
                    del self._updates[next(iter(self._updates))]
                self._updates[key] = update
            return update, target

    def encode(self, old: Snapshot, target: Snapshot) -> Update:
        """Return the update between two snapshots. It blocks: for threads, with an encoder of their own."""
        *_, update = self._encode(old, target)
        assert update is not None
        return update

    def _encode(self, old: Snapshot, target: Snapshot) -> Iterator[Update | None]:
        """Yield None whenever ``MAX_BLOCKING_SECONDS`` have passed, and the update at the end."""
        builder = FrameBuilder()
        removed: list[int] = []
        transforms = _Transforms()
        meshes: set[int] = set()
        node_update: messages.NodeUpdate | None = None  # of the node whose changes are being read
        pause_time = time.perf_counter() + MAX_BLOCKING_SECONDS
        for change in changes(old.root, target.root):
            node_id = self.node_id(change.path)
            if change.node is None:
                removed.append(node_id)
                continue
            if change.kind in ("added", "transform"):
                transforms.add(node_id, change.node)
            if change.kind not in ("transform", "reordered"):
                # The changes of one node follow each other.
                if node_update is None or node_update.id != node_id:
                    if node_update is not None:
                        builder.add_node(node_update)
                    node_update = messages.NodeUpdate(id=node_id)
                self._add_change(node_update, change, change.node, meshes)
            if time.perf_counter() > pause_time:
                yield None
                pause_time = time.perf_counter() + MAX_BLOCKING_SECONDS
        if node_update is not None:
            builder.add_node(node_update)
        header = messages.SceneUpdate(
            from_=old.revision, revision=target.revision, timestamp=target.timestamp, removed=removed
        )
        transforms.add_to(builder, header)
        yield Update(builder.finish(header), frozenset(meshes))

    def _add_change(self, update: messages.NodeUpdate, change: Change, node: Node, meshes: set[int]) -> None:
        """Add a change of ``node`` to its update, and the ids of the node's meshes to ``meshes``."""
        added = change.kind == "added"
        if added:
            update.parent = self.node_id(change.path[:-1])
            update.name = change.path[-1]
        if change.kind == "visible" or (added and not node.visible):
            update.visible = node.visible
        if change.kind == "opacity" or (added and node.opacity != 1.0):
            update.opacity = node.opacity
        if change.kind == "geometry" or (added and node.parts is not None):
            parts = None if node.parts is None else [part_message(part, self._resources) for part in node.parts]
            update.parts = parts
            meshes.update(draw.mesh for part in parts or () for draw in part.draws)


class _Transforms:
    """The ids (uint32) and transforms of nodes: a pose (7 float32) or a column-major matrix (16 float64) each.

    They are converted one by one: converting all of them at the end blocks the event loop.
    """

    def __init__(self) -> None:
        self._pose_ids = array("I")
        self._poses = array("f")
        self._matrix_ids = array("I")
        self._matrices = array("d")

    def add(self, node_id: int, node: Node) -> None:
        """Add a node."""
        pose, limit = node.pose, MAX_POSE_METRES
        if pose is not None and abs(pose[0]) <= limit and abs(pose[1]) <= limit and abs(pose[2]) <= limit:
            self._pose_ids.append(node_id)
            self._poses.extend(pose)
        else:
            self._matrix_ids.append(node_id)
            self._matrices.extend(node.matrix.T.ravel().tolist())

    def add_to(self, builder: FrameBuilder, header: messages.SceneUpdate) -> None:
        """Add the arrays to a frame."""
        if self._pose_ids:
            ids = builder.add_array(self._pose_ids)
            header.poses = messages.Poses(ids=ids, values=builder.add_array(self._poses))
        if self._matrix_ids:
            ids = builder.add_array(self._matrix_ids)
            header.matrices = messages.Matrices(ids=ids, values=builder.add_array(self._matrices))


def encode_page(page: LivePage) -> bytes:
    """Return the frame with the view settings and the clickable paths."""
    view = page.view
    home = None if view.home is None else messages.Home(eye=view.home.eye, target=view.home.target, up=view.home.up)
    clickable = list(page.clicks.paths())
    return encode(messages.PageSettings(background=view.background, grid=view.grid, home=home, clickable=clickable))


def encode_stereo_rig(rig: messages.PlacedRig | None) -> bytes:
    """Return the frame with the stereo camera; its pose is null if there is no camera, or the pose is not finite."""
    return encode(rig if rig is not None and np.isfinite(rig.pose).all() else messages.NoRig(pose=None))


class SnapshotFrames:
    """Encodes what changes from one snapshot to the next. Not thread-safe."""

    def __init__(self, rig: Callable[[Snapshot], PlacedRig | None] = lambda snapshot: None) -> None:
        """``rig`` returns the stereo camera in a snapshot."""
        self._rig = rig
        self._rig_frame = b""
        self._resources = Resources()
        self._encoder = Encoder(self._resources)
        self._encoded = EMPTY_SNAPSHOT
        self._sent_meshes: set[int] = set()

    async def advance(self, snapshot: Snapshot) -> list[bytes]:
        """Return the frames that lead from the last snapshot to this one; none if it is the same one."""
        if snapshot.revision == self._encoded.revision:
            return []
        epoch = self._encoder.epoch
        self._encoder.advance(snapshot)
        if self._encoder.epoch != epoch:  # the ids of nodes are others
            self._encoded = EMPTY_SNAPSHOT
        update, self._encoded = await self._encoder.update(self._encoded)
        self._sent_meshes -= self._resources.take_removed_meshes()
        new = sorted(update.meshes - self._sent_meshes)
        self._sent_meshes.update(new)
        rig_frame = encode_stereo_rig(self._rig(snapshot))
        rigs = [rig_frame] if rig_frame != self._rig_frame else []
        self._rig_frame = rig_frame
        return [*filter(None, map(self._resources.mesh_frame, new)), *rigs, update.frame]
