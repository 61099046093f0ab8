"""Load the mesh files that the recordings name from the corpus."""

from pathlib import Path

from gateway.files.assets.mesh_files import MeshFiles
from gateway.scene.tree.geometry import Part

RECORDED_ROOT = "/srv/scenegate/mesh/"


class RecordedMeshes:
    """The gateway's mesh files with the corpus' folder open under the name that it had when recorded."""

    def __init__(self, assets: Path) -> None:
        self._assets = assets
        self._files = MeshFiles([assets])

    def load(self, filename: str, scale: tuple[float, float, float], warnings: list[str]) -> tuple[Part, ...]:
        if filename.startswith(RECORDED_ROOT):
            filename = str(self._assets / filename.removeprefix(RECORDED_ROOT))
        return self._files.load(filename, scale, warnings)
