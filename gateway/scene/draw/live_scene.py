"""The live scene as the sources of images and files of it need it."""

from collections.abc import Callable
from dataclasses import dataclass, field

from gateway.scene.draw.flatten import Flattener
from gateway.scene.tree.labels import LabelTable
from gateway.scene.tree.live import LiveTree, Snapshot
from gateway.scene.tree.timeline import Timeline
from renderers.camera import Camera
from renderers.drawlist import DrawList


@dataclass(frozen=True, slots=True, eq=False)
class LiveScene:
    """The live tree with its draw lists, its earlier states and the stereo camera in it. Thread-safe."""

    tree: LiveTree
    flattener: Flattener = field(default_factory=lambda: Flattener(LabelTable()))
    """Flattener of the newest snapshots with the tree's labels; other interfaces may share it."""
    timeline: Timeline | None = None
    """Earlier states of the tree; None: there are none."""
    stereo_camera: Callable[[Snapshot], Camera | None] = lambda snapshot: None
    """Returns the left camera of the stereo sensor in a snapshot, for ``camera=stereo``."""

    def draw_list(self, snapshot: Snapshot) -> DrawList:
        """Return the draw list of a snapshot, which may be an earlier one, or have other visible nodes."""
        flattener = self.flattener if snapshot is self.tree.snapshot else Flattener(self.flattener.labels)
        return flattener.flatten(snapshot)
