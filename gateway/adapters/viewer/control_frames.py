"""Controls of the page: the frames with them and their values, and the changes that a page sends.

A page numbers its changes. It ignores values of a control that were sent before the gateway has received its last
change of that control: a frame ``received`` has the number.
"""

from gateway.adapters.viewer import messages
from gateway.adapters.viewer.frames import FrameBuilder
from gateway.scene.page.control_store import ControlStore
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.nodes import Pose
from scenegate.messages import controls


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
