"""Shapes and their parts, the geometry of nodes: metres, in the shape's own frame, Z up."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.scene.tree.transforms import IDENTITY
from renderers.drawlist import Light, Material, Mesh
from scenegate.messages.geometry import Solid

_NO_CHANNELS: Mapping[str, NDArray[np.float32]] = MappingProxyType({})


class Surface(msgspec.Struct, frozen=True, gc=False, eq=False):
    """An explicit mesh: a glTF primitive, ``mesh_data``, or one part of a loaded file."""

    mesh: Mesh


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class PointCloud:
    """Points with any number of named channels."""

    points: NDArray[np.float32]
    """(N, 3) float32."""
    channels: Mapping[str, NDArray[np.float32]] = field(default_factory=lambda: _NO_CHANNELS)
    """(N,) or (N, k) float32 by name. The colours of the points are ``rgb``, (N, 3 | 4) in 0 .. 1. Without ``rgb``,
    the points are grey by ``intensity``, (N,) in 0 .. 1."""


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Line:
    """A polyline."""

    points: NDArray[np.float32]
    """(N, 3) float32; fewer than two points draw nothing."""
    radius: float = 0.01
    """Radius of the line as a tube; a hairline if not positive."""
    closed: bool = False
    """True: the last point is connected to the first one."""
    start_head: bool = False
    """True: an arrowhead at the first point."""
    end_head: bool = False
    """True: an arrowhead at the last point."""
    head_radius: float = 0.05
    head_length: float | None = None
    """Length of an arrowhead, whose tip lies at the end point; None: ``head_radius``."""


Shape = Solid | Surface | PointCloud | Line | Light
SHAPES: Final[tuple[type[Shape], ...]] = (*Solid.__subclasses__(), Surface, PointCloud, Line, Light)


class Part(msgspec.Struct, frozen=True, gc=False, eq=False):
    """A shape with its material and its place in the frame of its node. A node has any number of parts."""

    shape: Shape
    material: Material
    X_node_part: NDArray[np.float64] = IDENTITY
    """(4, 4) float64, affine."""
    kind: str = ""
    """The client's name for the shape, such as ``mesh_file`` or ``planar_lidar``; empty: the name of its class."""
    source: str = ""
    """Name of the file that the shape was read from, for display; empty: none."""

    @property
    def array_bytes(self) -> int:
        """Bytes of the arrays of the shape."""
        match self.shape:
            case Surface(mesh=mesh):
                return mesh.nbytes
            case PointCloud(points=points, channels=channels):
                return points.nbytes + sum(channel.nbytes for channel in channels.values())
            case Line(points=points):
                return points.nbytes
        return 0
