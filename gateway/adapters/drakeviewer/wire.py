"""Drake's LCM messages (``lcmtypes/lcmt_*.lcm``) as values, and their decoders: big-endian, the fingerprint first."""

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.drakeviewer.config import Limits

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


Message = bytes | memoryview
LOAD_ROBOT: Final = 0x8987209B10AA2D39
"""Fingerprint of ``lcmt_viewer_load_robot``."""
LINK_DATA: Final = 0x51252725AF982A63
"""Fingerprint of ``lcmt_viewer_link_data``."""
DRAW: Final = 0x414F0BFE5B2F4244
"""Fingerprint of ``lcmt_viewer_draw``."""
CONTACT_RESULTS: Final = 0x114C15EA77683B45
"""Fingerprint of ``lcmt_contact_results_for_viz``."""
POINT_CLOUD: Final = 0x17F2C128B5D25A95
"""Fingerprint of ``lcmt_point_cloud``."""
QUADRATURE_POINT_BYTES: Final = 9 * 8
"""Size of a ``lcmt_hydroelastic_quadrature_per_point_data_for_viz``."""

_GEOMETRY: Final = struct.Struct(">b11f")
"""Fields of ``lcmt_viewer_geometry_data`` before ``string_data``: type, position, quaternion, color."""
_THREE_DOUBLES: Final = struct.Struct(">3d")
_CLOUD_SIZE: Final = struct.Struct(">2q")
"""``width`` and ``height`` of a ``lcmt_point_cloud``."""
_CLOUD_FIELD: Final = struct.Struct(">ibi")
"""Fields of a ``lcmt_point_cloud_field`` after its name."""
_CLOUD_LAYOUT: Final = struct.Struct(">qiqh")
"""``flags``, ``point_step``, ``row_step`` and ``filler_size``."""
_MAX_CLOUD_FIELDS: Final = 64
"""Maximum number of fields of a point cloud: coordinates, colours, normals and the like."""


class Reader:
    """Reads fields of a message in their order. All methods raise MessageError at its end or beyond a limit."""

    __slots__ = ("_limits", "_view", "offset")

    def __init__(self, message: Message, fingerprint: int, name: str, limits: Limits) -> None:
        """``fingerprint``: start of the message. ``name``: name of its LCM type, for errors."""
        self._view = memoryview(message)
        self.offset = 8
        """Bytes before the next field."""
        self._limits = limits
        if len(message) < 8 or int.from_bytes(self._view[:8], "big") != fingerprint:
            raise MessageError(f"the message is not a {name}: fingerprint {bytes(self._view[:8]).hex()}")

    def take(self, size: int) -> memoryview:
        """Return the next ``size`` bytes."""
        end = self.offset + size
        if size < 0 or end > len(self._view):
            raise MessageError(f"the message ends after {len(self._view)} bytes, within its fields")
        taken = self._view[self.offset : end]
        self.offset = end
        return taken

    def unpack(self, layout: struct.Struct) -> tuple[Any, ...]:
        """Return several numbers."""
        return layout.unpack(self.take(layout.size))

    def integer(self, size: int = 4) -> int:
        """Return a signed integer of ``size`` bytes."""
        return int.from_bytes(self.take(size), "big", signed=True)

    def count(self, name: str, limit: int) -> int:
        """Return the number of elements of the array ``name``."""
        count = self.integer()
        if not 0 <= count <= limit:
            raise MessageError(f"{name} is {count}, the limit is {limit}")
        return count

    def text(self, limit: int = 0) -> str:
        """Return a string of at most ``limit`` bytes; default ``Limits.name_bytes``."""
        limit = limit or self._limits.name_bytes
        size = int.from_bytes(self.take(4), "big")
        if not 1 <= size <= limit + 1:
            raise MessageError(f"a text has {size} bytes with its NUL, the limit is {limit + 1}")
        return str(self.take(size)[:-1], "utf-8", "replace")

    def floats(self, count: int) -> NDArray[np.float32]:
        """Return ``count`` numbers, (count,) float32."""
        return np.frombuffer(self.take(4 * count), ">f4").astype(np.float32)

    def doubles(self, count: int) -> NDArray[np.float64]:
        """Return ``count`` numbers, (count,) float64."""
        return np.frombuffer(self.take(8 * count), ">f8").astype(np.float64)

    def vector(self) -> Vector3:
        """Return three numbers of type double."""
        x, y, z = self.unpack(_THREE_DOUBLES)
        return x, y, z

    def geometry(self) -> Geometry:
        """Return a ``lcmt_viewer_geometry_data``."""
        kind, x, y, z, qw, qx, qy, qz, *color = self.unpack(_GEOMETRY)
        text = self.text(self._limits.mesh_text_bytes)
        float_count = self.count("num_float_data", 2 + 3 * (self._limits.vertices + self._limits.triangles))
        r, g, b, alpha = color
        return Geometry(kind, (x, y, z), (qw, qx, qy, qz), (r, g, b, alpha), text, self.floats(float_count))

    def link(self) -> Link:
        """Return a ``lcmt_viewer_link_data``."""
        name, robot = self.text(), self.integer()
        count = self.count("num_geom", self._limits.geometries)
        return Link((robot, name), tuple(self.geometry() for _ in range(count)))


def decode_load_robot(message: Message, limits: Limits) -> tuple[Link, ...]:
    """Return the links of a ``lcmt_viewer_load_robot``. Decoders raise MessageError for damage and beyond limits."""
    reader = Reader(message, LOAD_ROBOT, "lcmt_viewer_load_robot", limits)
    links = tuple(reader.link() for _ in range(reader.count("num_links", limits.links)))
    geometries = sum(len(link.geometries) for link in links)
    if geometries > limits.geometries:
        raise MessageError(f"the links have {geometries} geometries, the limit is {limits.geometries}")
    return links


def decode_link_data(message: Message, limits: Limits) -> Link:
    """Return a ``lcmt_viewer_link_data``."""
    return Reader(message, LINK_DATA, "lcmt_viewer_link_data", limits).link()


def decode_draw(message: Message, limits: Limits, known: LinkNames | None = None) -> Draw:
    """Return a ``lcmt_viewer_draw``, with object ``known`` for equal names: decoding them takes most of the time."""
    reader = Reader(message, DRAW, "lcmt_viewer_draw", limits)
    milliseconds = reader.integer(8)
    count = reader.count("num_links", limits.links)
    begin = reader.offset
    if known is not None and len(known.keys) == count and message[begin : begin + len(known.encoded)] == known.encoded:
        reader.take(len(known.encoded))
        names = known
    else:
        texts = [reader.text() for _ in range(count)]
        robots = struct.unpack(f">{count}i", reader.take(4 * count))
        keys: tuple[LinkKey, ...] = tuple(zip(robots, texts, strict=True))
        names = LinkNames(bytes(message[begin : reader.offset]), keys)
    poses = np.empty((count, 7))
    positions, quaternions = reader.take(12 * count), reader.take(16 * count)
    with np.errstate(invalid="ignore"):  # signalling NaNs
        poses[:, :3] = np.frombuffer(positions, ">f4").reshape(count, 3)
        poses[:, 3:] = np.frombuffer(quaternions, ">f4").reshape(count, 4)
    return Draw(names, milliseconds / 1000.0, poses)


def decode_contacts(message: Message, limits: Limits) -> Contacts:
    """Return a ``lcmt_contact_results_for_viz``."""
    reader = Reader(message, CONTACT_RESULTS, "lcmt_contact_results_for_viz", limits)
    reader.take(8)  # timestamp
    bodies, encoded_vectors = [], []
    for _ in range(reader.count("num_point_pair_contacts", limits.contacts)):
        reader.take(8)  # timestamp
        bodies.append((reader.text(), reader.text()))
        encoded_vectors.append(reader.take(3 * 3 * 8))
    vectors = np.frombuffer(b"".join(encoded_vectors), ">f8").reshape(-1, 3, 3).astype(np.float64)
    points, forces, _ = vectors.swapaxes(0, 1)  # and normals
    surface_count = reader.count("num_hydroelastic_contacts", limits.contacts)
    surfaces = tuple(_surface_contact(reader, limits) for _ in range(surface_count))
    return Contacts(tuple(bodies), points, forces, surfaces)


def _surface_contact(reader: Reader, limits: Limits) -> SurfaceContact:
    bodies = _body_name(reader), _body_name(reader)
    centroid, force, moment = reader.vector(), reader.vector(), reader.vector()
    reader.take(QUADRATURE_POINT_BYTES * reader.count("num_quadrature_points", limits.triangles))
    count = reader.count("num_vertices", limits.vertices)
    vertices, pressure = reader.doubles(3 * count).reshape(count, 3), reader.doubles(count)
    polygons = reader.take(4 * reader.count("poly_data_int_count", 8 * limits.triangles))
    indices = np.frombuffer(polygons, ">i4").astype(np.int32)
    return SurfaceContact(bodies, centroid, force, moment, vertices, pressure, indices)


def _body_name(reader: Reader) -> str:
    """Return a body's name as Drake's own viewer shows it: ``[model.]body[.geometry]``."""
    geometry, body, model = reader.text(), reader.text(), reader.text()
    is_unique, geometries = reader.integer(1), reader.integer()
    return ".".join(([] if is_unique else [model]) + [body] + ([geometry] if geometries > 1 else []))


def decode_point_cloud(message: Message, limits: Limits) -> Cloud:
    """Return a ``lcmt_point_cloud``."""
    reader = Reader(message, POINT_CLOUD, "lcmt_point_cloud", limits)
    reader.take(8)  # utime
    reader.text()  # frame_name
    width, height = reader.unpack(_CLOUD_SIZE)
    if not (width >= 0 and height >= 0 and width * height <= limits.points):
        raise MessageError(f"the cloud has {width} x {height} points, the limit is {limits.points}")
    fields = tuple(
        CloudField(reader.text(), *reader.unpack(_CLOUD_FIELD))
        for _ in range(reader.count("num_fields", _MAX_CLOUD_FIELDS))
    )
    flags, point_step, row_step, filler_bytes = reader.unpack(_CLOUD_LAYOUT)
    reader.take(filler_bytes)
    return Cloud(width, height, fields, flags, point_step, row_step, reader.take(reader.integer(8)))
