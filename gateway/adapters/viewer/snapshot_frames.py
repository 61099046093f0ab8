"""Encodes snapshots of a tree as the frames of the view, which ``SceneMirror`` reads."""

from collections.abc import Callable

from gateway.adapters.viewer.encoder import EMPTY_SNAPSHOT, Encoder, encode_stereo_rig
from gateway.adapters.viewer.messages import PlacedRig
from gateway.adapters.viewer.resources import Resources
from gateway.scene.tree.live import Snapshot


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
