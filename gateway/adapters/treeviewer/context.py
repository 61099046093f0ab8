"""State of one request while it is read, and the readers of arrays, images and text in it."""

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.treeviewer.config import Limits
from gateway.adapters.treeviewer.images import CheckedImage, read_image
from gateway.adapters.treeviewer.number_arrays import ArrayError, NumberArrays, PackedArray
from gateway.scene.tree.geometry import Part
from scenegate.messages.field_kinds import MAX_COLOR, CommandError, show


class ThreadRequired(Exception):  # noqa: N818 - an expected outcome, not a fault
    """A request that is read on the event loop contains what takes milliseconds: read it again in a worker thread."""


class MeshLoader(Protocol):
    """Loader of the files of ``mesh_file`` geometries. ``gateway.files.assets.mesh_files.MeshFiles`` implements it."""

    def load(self, filename: str, scale: tuple[float, float, float], warnings: list[str]) -> tuple[Part, ...]:
        """Return the parts of a mesh file, scaled along x, y, z. Append warnings about its content.

        Raises ValueError if it cannot be loaded; the attribute ``missing`` is True if it does not exist.
        """
        ...


@dataclass(slots=True)
class ReadContext:
    """Limits, arrays and warnings of the request being read: the ``FieldReader`` of its geometries."""

    limits: Limits = field(default_factory=Limits)
    arrays: NumberArrays = field(default_factory=NumberArrays)
    meshes: MeshLoader | None = None
    """None: the settings allow no folder of mesh files."""
    text_labels: int = 0
    """Number of text labels in the request so far."""
    strict: bool = False
    """True: ``warnings`` are errors."""
    at_once: bool = False
    """True: the event loop reads the request. Images, text, mesh files and controls raise ThreadRequired."""
    warnings: list[str] = field(default_factory=list)
    """One sentence for each irregularity of the current command that was tolerated."""
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Point of the current geometry from which its points are counted."""

    def require_thread(self) -> None:
        """Raise ThreadRequired on the event loop."""
        if self.at_once:
            raise ThreadRequired

    def rows(self, value: Any, name: str, columns: tuple[int, ...], limit: str) -> NDArray[np.float32]:
        try:
            if name in ("points", "vertices"):
                positions, self.origin = self.arrays.positions(value, getattr(self.limits, limit))
                return positions
            return self.arrays.floats(value, columns, getattr(self.limits, limit))
        except ArrayError as error:
            raise CommandError(f"{name} {error}") from None

    def grid(self, value: Any, name: str) -> NDArray[np.float32]:
        try:
            return self.arrays.grid(value, self.limits.heights)
        except ArrayError as error:
            raise CommandError(f"{name} {error}") from None

    def colors(self, value: Any, name: str) -> NDArray[np.float32]:
        colors = self.rows(value, name, (3, 4), "vertices")
        scale_colors(colors, value, name, self.warnings)
        return colors

    def image(self, value: Any, name: str) -> CheckedImage:
        self.require_thread()
        return read_image(value, name, self.limits)

    def text(self, value: Any, name: str) -> str:
        self.require_thread()
        if not isinstance(value, str):
            raise CommandError(f"{name} must be a string, not {show(value)}")
        if len(value) > self.limits.text_chars:
            raise CommandError(f"{name} has {len(value)} characters, the limit is {self.limits.text_chars}")
        self.text_labels += 1
        if self.text_labels > self.limits.text_labels:
            raise CommandError(
                f"{name} is label {self.text_labels} of the request, the limit is {self.limits.text_labels}"
            )
        return value


def scale_colors(colors: NDArray[np.float32], field: Any, name: str, warnings: list[str]) -> None:
    """Scale the colours read from a field, in place, to 0 to 1. NaN becomes 0. Warn of colours above 1."""
    if isinstance(field, PackedArray) and field.is_uint8:
        colors /= np.float32(255.0)
        return
    colors[np.isnan(colors)] = 0.0
    if colors.size and (largest := float(colors.max())) > MAX_COLOR:
        warnings.append(f"{name} has {largest:g}, colours are from 0 to 1 or bytes; it counts as 1")
    np.clip(colors, 0.0, 1.0, out=colors)
