"""State shared by the functions that read one request."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

from gateway.scene.geometry import Part
from gateway.treeviewer.config import Limits
from gateway.treeviewer.number_arrays import NumberArrays


class MeshLoader(Protocol):
    """Loads the files of ``mesh_file`` (``gateway.assets.mesh_files.MeshFiles``)."""

    def load(self, filename: str, scale: tuple[float, float, float]) -> tuple[Part, ...]:
        """Return the file's parts.

        Raises:
            ValueError: with one sentence; its attribute ``missing`` is true when there is no such file.
        """
        ...


@dataclass(slots=True)
class ReadContext:
    """Limits, arrays and warnings of the request being read."""

    limits: Limits = field(default_factory=Limits)
    arrays: NumberArrays = field(default_factory=NumberArrays)
    meshes: MeshLoader | None = None
    """None: no folder of mesh files is open to clients."""
    warnings: list[str] = field(default_factory=list)
    """One sentence for each tolerated oddity of the current command."""
