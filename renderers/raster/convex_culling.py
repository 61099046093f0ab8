"""Closed meshes whose back faces are hidden from every point outside: spheres, boxes, cylinders, capsules.

A closed surface covers every pixel centre by as many front as back faces: coverage is exact on snapped corners, and
each edge counts once in each direction. If all triangles also face away from one point within, a ray leaves the mesh
through front faces only, so that what it meets first from outside is a front face. The back faces of such a mesh need
not be drawn for a camera outside its bounding box. The image is the same, and so are the depths, except where snapping
moves a silhouette over a pixel centre or where front and back are closer than float32 can tell: there the front shows.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.device_function import inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pointers import address_of, f32_at, f64_at, i64_at, u32_at
from renderers.stop import current_stop

NEAR_ZERO: Final = 2.0**-40
"""Relative to the mesh's extent: smaller coordinates count as 0. Generators leave sin and cos of whole turns, 2e-16
apart, where seams meet."""

_BLOCK: Final = 1 << 16
"""Vertices or triangles between two checks of the stop flag: a mesh of millions takes a second."""

Bounds = tuple[float, float, float, float, float, float]


@inlined
def _hash(value):
    """Return splitmix64's finalizer of a uint64."""
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))


@kernel("void(int64, int64, int64, int64, int64, int64, int64, int64)")
def check_convex(positions_at, count, indices_at, triangles, cleaned_at, hashes_at, out_at, stop_at):
    """Check whether a mesh is closed and faces away from the centre of its bounding box everywhere.

    An edge from a to b counts A(a) B(b) - A(b) B(a), modulo 2^64, where A and B are two hashes of a position. The sum
    over all edges is 0 if each occurs as often in the other direction; otherwise with a probability of about 2^-60.

    Args:
        positions_at, count, indices_at, triangles: the mesh, float32 and uint32.
        cleaned_at: address of (count, 3) float32; gets the positions with values near zero set to zero.
        hashes_at: address of (count, 2) uint64 of scratch.
        out_at: address of 8 float64: 1 if so, else 0; 1 if the cleaned positions differ; centre and half sides of
            the bounding box.
        stop_at: address of a ``StopFlag``; the result means nothing if it was set.
    """
    positions, cleaned, out = f32_at(positions_at), f32_at(cleaned_at), f64_at(out_at)
    indices, hashes, bits = u32_at(indices_at), i64_at(hashes_at), u32_at(cleaned_at)
    out[0] = out[1] = 0.0
    extent = 0.0
    for axis in range(3):
        low, high = np.float32(np.inf), np.float32(-np.inf)
        finite = True
        for k in range(count):
            value = positions[3 * k + axis]
            finite = finite & (abs(value) < np.float32(1e18))
            low, high = min(low, value), max(high, value)
        if not finite or count == 0:
            return
        out[2 + axis] = 0.5 * (np.float64(low) + np.float64(high))
        out[5 + axis] = 0.5 * (np.float64(high) - np.float64(low))
        extent = max(extent, out[5 + axis])
    cx, cy, cz = out[2], out[3], out[4]
    # Most other meshes fail here, at one of their first triangles.
    for t in range(triangles):
        if t % _BLOCK == 0 and is_set(stop_at):
            return
        a, b, c = 3 * np.int64(indices[3 * t]), 3 * np.int64(indices[3 * t + 1]), 3 * np.int64(indices[3 * t + 2])
        ax, ay, az = positions[a] - cx, positions[a + 1] - cy, positions[a + 2] - cz
        bx, by, bz = positions[b] - cx, positions[b + 1] - cy, positions[b + 2] - cz
        dx, dy, dz = positions[c] - cx, positions[c + 1] - cy, positions[c + 2] - cz
        volume = ax * (by * dz - bz * dy) + ay * (bz * dx - bx * dz) + az * (bx * dy - by * dx)
        if not volume > 0.0:
            # Degenerate triangles, as at the poles of a sphere, are never visible.
            tiny = 4.0 * NEAR_ZERO * extent
            same = (abs(ax - bx) <= tiny) & (abs(ay - by) <= tiny) & (abs(az - bz) <= tiny)
            same |= (abs(bx - dx) <= tiny) & (abs(by - dy) <= tiny) & (abs(bz - dz) <= tiny)
            same |= (abs(dx - ax) <= tiny) & (abs(dy - ay) <= tiny) & (abs(dz - az) <= tiny)
            if not same:
                return
    tiny32 = np.float32(NEAR_ZERO * extent)
    changed = False
    for k in range(count):
        if k % _BLOCK == 0 and is_set(stop_at):
            return
        for axis in range(3):
            value = positions[3 * k + axis]
            near = abs(value) <= tiny32
            changed = changed | (near & (value != np.float32(0.0)))
            cleaned[3 * k + axis] = np.float32(0.0) if near else value
        first = np.uint64(bits[3 * k]) | (np.uint64(bits[3 * k + 1]) << np.uint64(32))
        mixed = _hash(_hash(first + np.uint64(0x9E3779B97F4A7C15)) + np.uint64(bits[3 * k + 2]))
        hashes[2 * k] = np.int64(mixed)
        hashes[2 * k + 1] = np.int64(_hash(mixed + np.uint64(0x9E3779B97F4A7C15)))
    total = np.int64(0)
    for t in range(triangles):
        if t % _BLOCK == 0 and is_set(stop_at):
            return
        a, b, c = 2 * np.int64(indices[3 * t]), 2 * np.int64(indices[3 * t + 1]), 2 * np.int64(indices[3 * t + 2])
        # The counts of its three edges, combined.
        total += (hashes[b] - hashes[a]) * (hashes[c + 1] - hashes[a + 1]) - (hashes[c] - hashes[a]) * (
            hashes[b + 1] - hashes[a + 1]
        )
    out[0] = 1.0 if total == 0 and triangles > 0 else 0.0
    out[1] = 1.0 if changed else 0.0


def convex_bounds(
    positions: NDArray[np.float32], indices: NDArray[np.uint32]
) -> tuple[Bounds, NDArray[np.float32]] | None:
    """Return the bounding box of a mesh whose back faces are hidden from outside; None for other meshes.

    Args:
        positions: (N, 3) float32, C-contiguous.
        indices: (M, 3) uint32, C-contiguous, below N.

    Returns:
        Centre and half sides of the box, and the positions to draw the mesh with: vertices that differ by rounding only
        are equal in it.

    Raises:
        Exception: the current ``StopFlag`` was set.
    """
    stop = current_stop()
    cleaned, hashes, out = np.empty_like(positions), np.empty((len(positions), 2), np.int64), np.empty(8)
    check_convex(
        address_of(positions, np.float32),
        len(positions),
        address_of(indices, np.uint32),
        len(indices),
        address_of(cleaned, np.float32),
        address_of(hashes, np.int64),
        address_of(out, np.float64),
        stop.address,
    )
    stop.check()
    if out[0] == 0.0:
        return None
    x, y, z, w, h, d = out[2:].tolist()
    return (x, y, z, w, h, d), cleaned if out[1] != 0.0 else positions
