"""Fixtures: a viewer in this process."""

import pytest

from gateway.adapters.drakeviewer import wire
from gateway.adapters.drakeviewer.config import DrakeViewerConfig
from gateway.adapters.drakeviewer.viewer import DrakeViewer
from gateway.files.assets.mesh_files import MeshFiles
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.nodes import Node, Path
from tests.adapters.drakeviewer.encoding import draw, link, load


class Viewer(DrakeViewer):
    def __init__(self, files: MeshFiles | None = None, config: DrakeViewerConfig | None = None) -> None:
        self.live = LiveTree()
        super().__init__(self.live, files or MeshFiles(()), config)

    def problem(self, channel: str, message: wire.Message) -> str:
        """Handle a message; return the reasons why something is not shown, an empty string for none."""
        return "; ".join(self.handle(channel, message))

    def show(self, *shapes: bytes) -> tuple[Part, ...]:
        """Load and draw shapes, of which all can be shown; return their parts."""
        assert self.problem("DRAKE_VIEWER_LOAD_ROBOT", load(link("world", 0, *shapes))) == ""
        self.handle("DRAKE_VIEWER_DRAW", draw({}))
        return self.node("illustration", "world").parts or ()

    def node(self, *path: str) -> Node:
        found = self.live.snapshot.root.find(("drake", *path))
        assert found is not None, f"{path} is not in {self.paths()}"
        return found

    def paths(self) -> list[Path]:
        return [path for path, node in self.live.snapshot.root.walk() if node.parts is not None]


@pytest.fixture
def viewer() -> Viewer:
    return Viewer()
