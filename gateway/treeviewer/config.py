"""What an operator can set of the tree viewer, every bound with its reason."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

KIB: Final = 1024
MIB: Final = 1024 * KIB


@dataclass(frozen=True, slots=True)
class Limits:
    """What one message, and what all of them together, may ask for. Beyond a bound the command fails with -3."""

    message_bytes: int = 256 * MIB
    """Of one LCM message: liblcm itself refuses more than 2^28 bytes."""
    json_bytes: int = 32 * MIB
    """Of one message's JSON without its long number arrays: it becomes Python objects of about 10 times its size."""
    binary_objects: int = 4_000_000
    """Of one binary message besides its arrays: each becomes a Python object of up to 100 bytes."""
    path_elements: int = 128
    """Depth of the tree; robots stay below 50, and walking a path costs its depth."""
    element_chars: int = 4096
    """Of one name in a path: names are kept, sent back and listed."""
    nodes: int = 250_000
    """Of the live tree: a node costs about 400 bytes and every picture walks all of them."""
    parts: int = 1_000_000
    """Geometries in the live tree: each costs about 500 bytes."""
    parts_per_path: int = 10_000
    """Geometries of one setgeometry command."""
    points: int = 20_000_000
    """Of one point cloud, lidar or line: 240 MB of coordinates."""
    vertices: int = 20_000_000
    """Of one mesh: 240 MB of coordinates."""
    faces: int = 40_000_000
    """Of one mesh: 480 MB of indices."""
    channels: int = 64
    """Of one point cloud."""
    geometry_bytes: int = 4096 * MIB
    """Of all arrays that this interface put into the tree and that are still in use."""
    problems: int = 100
    """Reasons and warnings told in one answer; the others are counted, so that an answer stays small."""
    failed_commands: int = 10_000
    """Of one request; beyond them nothing of it is done: millions of wrong commands fit into a few bytes each, and
    finding the reason of each would take a thread for seconds."""


@dataclass(frozen=True, slots=True)
class TreeViewerConfig:
    """The tree viewer's transports and bounds."""

    lcm_url: str | None = None
    """None: LCM_DEFAULT_URL, or liblcm's default (udpm://239.255.76.67:7667?ttl=0). ``off``: no LCM."""
    tcpq_host: str = "127.0.0.1"
    """Where the hub for LCM_DEFAULT_URL=tcpq://host:port listens."""
    tcpq_port: int | None = 7700
    """None: no hub; 0: a free port."""
    receive_buffer_bytes: int = 64 * MIB
    """Of LCM's UDP socket: it decides how big a message survives (a 16 MB message wants 64 MB)."""
    offload_bytes: int = 256 * KIB
    """Messages above it are decoded in a thread that does not hold the interpreter: 256 kB of JSON take 1 ms. Binary
    messages, which have more in them, above a quarter of it."""
    slice_commands: int = 500
    """Commands of a big message applied before the event loop gets its turn: 500 take about 1 ms."""
    threads: int = 2
    """For big JSON messages, and as many for big binary messages and mesh files."""
    waiting_bytes: int = 1024 * MIB
    """Of messages that wait behind big ones, all clients together; beyond it a UDP message is refused."""
    client_waiting_bytes: int = 64 * MIB
    """Of one hub client's messages waiting here; beyond it the hub stops reading from that client; nothing is lost."""
    unsent_bytes: int = 64 * MIB
    """Of answers that the UDP network does not take yet; beyond it answers are dropped, and counted."""
    hub_clients: int = 256
    """Connections to the hub."""
    hub_client_send_bytes: int = 512 * MIB
    """Waiting for one slow reader of the hub; beyond it that reader is disconnected, as memory is finite."""
    hub_subscriptions: int = 256
    """Of one hub client."""
    limits: Limits = Limits()
