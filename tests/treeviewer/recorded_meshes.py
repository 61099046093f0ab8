"""Opens the mesh files that the recordings name, which lie in the corpus."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gateway.scene.geometry import Part, Surface
from gateway.scene.transforms import scaling
from renderers.drawlist import Material, Mesh

RECORDED_ROOT = "/srv/scenegate/mesh/"


class MissingFileError(ValueError):
    missing = True


class RecordedMeshes:
    """A mesh loader for wavefront files of triangles; the recordings' folder is the only one open."""

    def __init__(self, assets: Path) -> None:
        self._assets = assets
        self.loaded: list[tuple[str, tuple[float, float, float]]] = []

    def load(self, filename: str, scale: tuple[float, float, float]) -> tuple[Part, ...]:
        if filename.startswith("/nonexistent/"):
            raise MissingFileError(f"{filename} does not exist")
        if filename.startswith("package://"):
            raise ValueError(f"{filename}: there is no package of that name")
        if not filename.startswith(RECORDED_ROOT):
            raise ValueError(f"{filename} is outside the folders that are open")
        self.loaded.append((filename, scale))
        words = [
            line.split() for line in (self._assets / filename.removeprefix(RECORDED_ROOT)).read_text().splitlines()
        ]
        positions = np.array([line[1:] for line in words if line[0] == "v"], np.float32)
        faces = np.array([line[1:] for line in words if line[0] == "f"], np.uint32) - 1
        return (Part(Surface(Mesh(positions, faces)), Material(), scaling(*scale)),)
