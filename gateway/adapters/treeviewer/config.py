"""Settings of the tree viewer, and its limits with their reasons. ``gateway.wiring`` fills them from the options."""

from dataclasses import dataclass, field

from gateway.runtime.lcm.config import LcmConfig
from scenegate.lcm.transport import MIB


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of one request and of the tree. A command beyond a limit fails with status -3."""

    message_bytes: int = 256 * MIB
    """Maximum size of a request's data in bytes."""
    json_bytes: int = 32 * MIB
    """Maximum size of a request's JSON without its long number arrays: its Python objects take 10 times as much."""
    binary_objects: int = 4_000_000
    """Maximum number of values in a MessagePack request besides its arrays: each becomes up to 100 bytes."""
    path_elements: int = 128
    """Maximum number of names in a path: those of robots have fewer than 50."""
    element_chars: int = 4096
    """Maximum length of one name in a path: names are stored, listed and sent back."""
    nodes: int = 250_000
    """Maximum number of nodes in the live tree: each costs about 400 bytes, and every image visits all of them."""
    parts: int = 1_000_000
    """Maximum number of geometries in the live tree: each costs about 500 bytes."""
    parts_per_path: int = 10_000
    """Maximum number of geometries in one setgeometry command."""
    points: int = 20_000_000
    """Maximum number of points in a point cloud, lidar or line: 240 MB of coordinates."""
    vertices: int = 20_000_000
    """Maximum number of vertices in a mesh: 240 MB of coordinates."""
    faces: int = 40_000_000
    """Maximum number of faces in a mesh: 480 MB of indices."""
    image_bytes: int = 64 * MIB
    """Maximum size of an encoded image: a PNG of ``image_pixels`` random pixels has 64 MiB."""
    image_pixels: int = 1 << 24
    """Maximum number of pixels in an image: 4096 x 4096, 64 MiB as RGBA."""
    text_chars: int = 1000
    """Maximum number of characters in a text label: a page has about 3000."""
    text_labels: int = 10_000
    """Maximum number of text labels in a request, and of different ones that are in use: each has an image of its own,
    about 100 kB. Labels that a request replaces are in use until it has been executed."""
    heights: int = 4_000_000
    """Maximum number of heights in a heightmap: 2000 x 2000, 220 MB as a mesh."""
    channels: int = 64
    """Maximum number of channels in a point cloud."""
    geometry_bytes: int = 4096 * MIB
    """Maximum size of all arrays, and of the files and decoded pixels of all images, that requests put into the tree
    and that are still in use."""
    controls: int = 1000
    """Maximum number of controls in setcontrols, and of values in setvalues: every page shows all of them."""
    problems: int = 100
    """Maximum number of errors, and of warnings, listed in one response; the others are counted."""
    failed_commands: int = 10_000
    """Maximum number of failed commands in a request; a request with more is not executed at all. Millions of invalid
    commands fit into one message, and describing them would take seconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TreeViewerConfig:
    """Scheduling of requests, and the limits of the protocol and its transports."""

    lcm: LcmConfig = field(default_factory=LcmConfig)
    limits: Limits = Limits()
    strict: bool = False
    """True: a geometry or transform with a warning is refused."""
    offload_bytes: int = 256 << 10
    """Maximum size of JSON requests that the event loop reads: 256 kB take 1 ms. For MessagePack, which is more
    compact, it is a quarter."""
    slice_commands: int = 2000
    """Number of commands of a big request that are executed before the event loop continues: 2000 take about 5 ms. The
    request becomes visible at once, after its last command."""
    threads: int = 4
    """Number of worker threads for big requests and those with images, text, mesh files or controls. A slow file takes
    one of them."""
    waiting_requests: int = 100_000
    """Maximum number of requests that wait for a worker thread: one of each client."""
    waiting_bytes: int = 1024 * MIB
    """Maximum size of the requests of all clients that wait for an earlier request of their client. Further requests
    are refused."""
    client_waiting_bytes: int = 64 * MIB
    """Maximum size of the waiting requests of one TCPQ client. Beyond it the hub reads no more from the client, and
    loses nothing."""
