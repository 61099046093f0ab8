"""State of one request while ``request_reader``, ``fields`` and ``geometry`` read it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

from gateway.scene.geometry import Part
from gateway.treeviewer.config import Limits
from gateway.treeviewer.number_arrays import NumberArrays


class MeshLoader(Protocol):
    """Loader of the files of ``mesh_file`` geometries. ``gateway.assets.mesh_files.MeshFiles`` implements it."""

    def load(self, filename: str, scale: tuple[float, float, float], warnings: list[str]) -> tuple[Part, ...]:
        """Return the parts of a mesh file, scaled along x, y, z. Append warnings about its content.

        Raises:
            ValueError: the file cannot be loaded; the attribute ``missing`` is True if it does not exist.
        """
        ...


@dataclass(slots=True)
class ReadContext:
    """Limits, arrays and warnings of the request being read."""

    limits: Limits = field(default_factory=Limits)
    arrays: NumberArrays = field(default_factory=NumberArrays)
    meshes: MeshLoader | None = None
    """None: the settings allow no folder of mesh files."""
    text_labels: int = 0
    """Number of text labels in the request so far."""
    strict: bool = False
    """True: ``warnings`` are errors."""
    warnings: list[str] = field(default_factory=list)
    """One sentence for each irregularity of the current command that was tolerated."""
