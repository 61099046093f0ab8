"""Shapes of a node, as values: metres, in the shape's own frame, Z up."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.scene.transforms import IDENTITY
from renderers.drawlist import Material, Mesh

_NO_CHANNELS: Mapping[str, NDArray[np.float32]] = MappingProxyType({})


class Value(msgspec.Struct, frozen=True, gc=False):
    """Base of shapes that are compared by value. Creating one takes a thirtieth of a frozen dataclass's time."""


class Box(Value, frozen=True, gc=False):
    """Centred on the origin."""

    lengths: tuple[float, float, float]
    """Full side lengths along x, y, z."""


class Sphere(Value, frozen=True, gc=False):
    radius: float


class Ellipsoid(Value, frozen=True, gc=False):
    radii: tuple[float, float, float]


class Cylinder(Value, frozen=True, gc=False):
    """Along z, centred, capped."""

    radius: float
    length: float


class Capsule(Value, frozen=True, gc=False):
    """A cylinder along z with a hemisphere at each end."""

    radius: float
    length: float
    """Length of the cylinder, without the end caps."""


class Surface(msgspec.Struct, frozen=True, gc=False, eq=False):
    """An explicit mesh: a glTF primitive, ``mesh_data``, or one part of a loaded file."""

    mesh: Mesh


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class PointCloud:
    """Points with any number of named channels."""

    points: NDArray[np.float32]
    """(N, 3) float32."""
    channels: Mapping[str, NDArray[np.float32]] = field(default_factory=lambda: _NO_CHANNELS)
    """(N,) or (N, k) float32 by name. ``rgb`` (N, 3 | 4) in 0 .. 1 colours the points, else ``intensity`` (N,)."""


class Triad(Value, frozen=True, gc=False):
    """Axes from the origin to +scale: x red, y green, z blue."""

    scale: float = 1.0
    tube: bool = False
    """True: tubes of 2 mm radius; False: hairlines."""


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Line:
    """A polyline."""

    points: NDArray[np.float32]
    """(N, 3) float32; fewer than two draw nothing."""
    radius: float = 0.01
    """<= 0: a hairline."""
    closed: bool = False
    start_head: bool = False
    end_head: bool = False
    head_radius: float = 0.05
    head_length: float | None = None
    """None: ``head_radius``. The tip lies at the end point."""


Shape = Box | Sphere | Ellipsoid | Cylinder | Capsule | Surface | PointCloud | Triad | Line


class Part(msgspec.Struct, frozen=True, gc=False, eq=False):
    """A shape with its material, placed in its node's frame. A node has any number of parts."""

    shape: Shape
    material: Material
    X_node_part: NDArray[np.float64] = IDENTITY
    """(4, 4) float64, affine."""
    kind: str = ""
    """The client's name for the shape (``mesh_file``, ``planar_lidar`` ...); empty: the class's name."""
    source: str = ""
    """Name of the file that it was read from, for display; empty: none."""
