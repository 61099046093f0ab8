"""Limits of Drake's visualizer channels, with their reasons."""

from dataclasses import dataclass

from scenegate.lcm.transport import MIB


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of one message. A message beyond a limit is not shown; the log says why."""

    links: int = 20_000
    """Maximum number of links in a message: each costs about 400 bytes, and every image visits all of them."""
    geometries: int = 100_000
    """Maximum number of geometries in a message: each costs about 500 bytes."""
    vertices: int = 5_000_000
    """Maximum number of vertices of all meshes in a message: 60 MB of coordinates."""
    triangles: int = 10_000_000
    """Maximum number of triangles of all meshes in a message: 120 MB of indices."""
    contacts: int = 10_000
    """Maximum number of contacts in a message: each is drawn with two to five geometries."""
    points: int = 20_000_000
    """Maximum number of points in a point cloud: 240 MB of coordinates."""
    name_bytes: int = 4096
    """Maximum length of a name: names are stored, listed and shown in the browser."""
    name_elements: int = 32
    """Maximum number of elements of a name such as ``source::model::link``: each is a node of the tree."""
    mesh_text_bytes: int = 256 * MIB
    """Maximum length of the JSON of a mesh in memory, with all its files."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DrakeViewerConfig:
    """Scheduling of messages, and limits."""

    limits: Limits = Limits()
    strict: bool = False
    """True: a message of which something cannot be shown is refused."""
    offload_bytes: int = 64 << 10
    """Minimum size of messages that are read in a worker thread: a deformable mesh of 64 kB takes about 1 ms."""
    threads: int = 4
    """Number of threads that read big messages and mesh files. A slow file takes one of them."""
    channels: int = 256
    """Maximum number of channels that are shown, and of other channels whose messages are counted by name. Beyond it,
    new channels of point clouds and frames are not shown; the others have fixed names, so that there are few."""
    nodes: int = 250_000
    """Maximum number of nodes for the links, frames and deformable bodies of all channels together: each costs about
    500 bytes, and every image visits all of them."""
    shown_bytes: int = 4096 * MIB
    """Maximum total size of the newest message of every channel: the live tree holds their geometry."""
    waiting_bytes: int = 512 * MIB
    """Maximum total size of the messages that wait for a worker thread. Further messages are dropped."""
