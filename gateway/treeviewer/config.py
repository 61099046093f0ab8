"""What an operator can set of the tree viewer, every bound with its reason."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from gateway.lcm.config import LcmConfig

KIB: Final = 1024
MIB: Final = 1024 * KIB


@dataclass(frozen=True, slots=True)
class Limits:
    """What one message, and what all of them together, may ask for. Beyond a bound the command fails with -3."""

    message_bytes: int = 256 * MIB
    """Of one request: as many as a transport lets through."""
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
class TreeViewerConfig(LcmConfig):
    """Limits of the tree viewer and of its transports."""

    offload_bytes: int = 256 * KIB
    """Messages above it are decoded in a thread that does not hold the interpreter: 256 kB of JSON take 1 ms. Binary
    messages, which have more in them, above a quarter of it."""
    slice_commands: int = 500
    """Commands of a big message applied before the event loop gets its turn: 500 take about 1 ms."""
    threads: int = 2
    """For big JSON messages, and as many for big binary messages and mesh files."""
    client_waiting_bytes: int = 64 * MIB
    """Of one hub client's messages waiting here; beyond it the hub stops reading from that client; nothing is lost."""
    limits: Limits = Limits()
