"""Drake's LCM messages as values. ``wire`` decodes them; ``lcmtypes/lcmt_*.lcm`` defines them."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

Vector3 = tuple[float, float, float]
LinkKey = tuple[int, str]
"""Index of the model (``robot_num``) and name of the link: they identify a link in one message."""
WORLD: Final[LinkKey] = (0, "world")
"""The link that does not move. Drake sends its geometry, but no pose."""


class MessageError(ValueError):
    """A message cannot be decoded or is beyond a limit; the text is the reason."""


class GeometryType(IntEnum):
    """Values of ``lcmt_viewer_geometry_data.type``."""

    BOX = 1
    SPHERE = 2
    CYLINDER = 3
    MESH = 4
    CAPSULE = 5
    ELLIPSOID = 6


@dataclass(frozen=True, slots=True, eq=False)
class Geometry:
    """``lcmt_viewer_geometry_data``."""

    type: int
    position: Vector3
    """Metres, in the link's frame."""
    quaternion: tuple[float, float, float, float]
    """(w, x, y, z), of any length."""
    color: tuple[float, float, float, float]
    """Red, green, blue (sRGB) and alpha as sent."""
    text: str
    """``string_data``: a mesh's file or JSON, or a deformable body's name."""
    floats: NDArray[np.float32]
    """``float_data``, (N,) float32."""


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """``lcmt_viewer_link_data``."""

    key: LinkKey
    geometries: tuple[Geometry, ...]


@dataclass(frozen=True, slots=True)
class LinkNames:
    """The links of a ``lcmt_viewer_draw``. Senders repeat them in every message."""

    encoded: bytes
    """The bytes of ``link_name`` and ``robot_num`` in the message."""
    keys: tuple[LinkKey, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Draw:
    """``lcmt_viewer_draw``."""

    names: LinkNames
    seconds: float
    """Time of the simulation."""
    poses: NDArray[np.float64]
    """(N, 7) float64: x, y, z (metres), qw, qx, qy, qz of each link in the world."""


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceContact:
    """``lcmt_hydroelastic_contact_surface_for_viz``, in the world. Slip and traction are left out."""

    bodies: tuple[str, str]
    """Names of the bodies, with model and geometry where the name of the body is ambiguous."""
    centroid: Vector3
    """Metres."""
    force: Vector3
    """Newtons."""
    moment: Vector3
    """Newton metres, about the centroid."""
    vertices: NDArray[np.float64]
    """(N, 3) float64, metres."""
    pressure: NDArray[np.float64]
    """(N,) float64, pascals."""
    polygons: NDArray[np.int32]
    """(M,) int32: for each polygon its number of vertices, then their indices."""


@dataclass(frozen=True, slots=True, eq=False)
class Contacts:
    """``lcmt_contact_results_for_viz``."""

    point_bodies: tuple[tuple[str, str], ...]
    """Names of the bodies of N ``lcmt_point_pair_contact_info_for_viz``."""
    points: NDArray[np.float64]
    """(N, 3) float64, metres, in the world."""
    forces: NDArray[np.float64]
    """(N, 3) float64, newtons, in the world."""
    surfaces: tuple[SurfaceContact, ...]


@dataclass(frozen=True, slots=True)
class CloudField:
    """``lcmt_point_cloud_field``."""

    name: str
    offset: int
    """Bytes from the start of a point."""
    datatype: int
    """Type of the values, 1 to 8: see ``point_clouds``."""
    count: int
    """Number of values for each point."""


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """``lcmt_point_cloud``."""

    width: int
    """Points in a row."""
    height: int
    """Number of rows."""
    fields: tuple[CloudField, ...]
    flags: int
    """Bits; ``point_clouds.BIG_ENDIAN`` is the only one that is used."""
    point_step: int
    """Bytes from one point to the next."""
    row_step: int
    """Bytes from one row to the next."""
    data: memoryview
