"""Limits of the documents that the reader accepts."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class GltfLimits:
    """Limits of a document. The error for a document beyond a limit names the limit and its value."""

    max_json_bytes: int = 16 << 20
    """Size of the JSON text without embedded data URIs of 1 KiB and more. Drake's largest scenes (25 MB bodies) have
    about 0.3 MB."""
    max_json_values: int = 2_000_000
    """Commas, brackets and braces of that text: a value costs up to 200 bytes when parsed, all of them 400 MB."""
    max_nodes: int = 100_000
    """Nodes of the scene; 30 times the largest robot cell seen."""
    max_node_depth: int = 256
    """Levels of nodes; kinematic chains have tens, and code that walks the tree may recurse."""
    max_primitives: int = 100_000
    """Primitives of the meshes in use; each costs some 30 us when it is new."""
    max_instances: int = 200_000
    """Primitives of all nodes together; many nodes may share one mesh."""
    max_vertices: int = 20_000_000
    """Vertices of the meshes in use, each mesh counted once: a vertex costs up to 68 bytes."""
    max_elements: int = 20_000_000
    """Triangles, lines and points of the meshes in use, each mesh counted once: 12 bytes each."""
    max_drawn_elements: int = 10_000_000
    """Triangles, lines and points of all instances, of which a small file can have many. Each takes about 210 bytes
    during rendering (its vertices, its edges, its place in the image), all of them 2 GB."""
    max_buffer_bytes: int = 512 << 20
    """Decoded buffers and images together; the size of a request's body is limited by its interface."""
    max_mesh_bytes: int = 512 << 20
    """Arrays read from buffers: many accessors can read the same bytes, so the size of the file does not limit it."""
    max_lights: int = 64
    """Nodes with a light (KHR_lights_punctual); every pixel is lit by all of them."""
    max_image_pixels: int = 64 << 20
    """Pixels of one image (8192 x 8192), by its header, before decoding: 256 MB of RGBA."""
    max_total_image_pixels: int = 256 << 20
    """Pixels of all different images in use."""
