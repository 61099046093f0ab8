"""Meshes of which only fronts can be seen from outside.

A closed surface covers every pixel centre by as many fronts as backs: coverage is exact on snapped corners, and each
edge counts once in each direction. If all triangles also face away from one point c within (they are counter-clockwise
seen from where it lies opposite), every ray from anywhere away from c leaves through fronts only: no place is enclosed
a negative number of times. A camera's ray comes from a place that is enclosed by nothing, so what it meets first is a
front. Back faces of such a mesh, seen from outside of its box, need not be drawn: the pixels are the same, and so are
their depths but where snapping moves a silhouette over a pixel centre, or fronts and backs are no further apart than
float32 can tell; there the front is seen.

Spheres, boxes, cylinders, capsules, bumpy balls: what simulators are made of.
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
"""Of the mesh's extent: coordinates below it count as 0. Generators leave cos and sin of whole turns where seams meet,
2e-16 apart; 1e-12 of the extent is far below what float32 tells on any screen."""

_BLOCK: Final = 1 << 16
"""Vertices or triangles between two looks at the ``StopFlag``: a mesh of millions takes a second."""

Bounds = tuple[float, float, float, float, float, float]


@inlined
def _mixed(value):
    """splitmix64's finalizer: any change of the 64 bits changes half of the result's."""
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))


@kernel("void(int64, int64, int64, int64, int64, int64, int64, int64)")
def enclose(positions_at, count, elements_at, triangles, own_at, keys_at, out_at, stop_at):
    """Find out whether a mesh is closed and faces away from the middle of its box everywhere.

    An edge from a to b is counted as A(a) B(b) - A(b) B(a), modulo 2^64, with two random numbers A and B of each place
    in space: the sum over all edges of all triangles is 0 where each comes as often in the other direction, and
    otherwise only by a chance of about 2^-60.

    Args:
        positions_at, count, elements_at, triangles: the mesh, float32 and uint32.
        own_at: address of (count, 3) float32, filled with the positions whose values near zero are zero.
        keys_at: address of (count, 2) uint64 of scratch.
        out_at: address of 8 float64: 1 where it is so, else 0; 1 where own differs from the positions; then the box's
            middle and half its sides.
        stop_at: address of a ``StopFlag``; nothing is said of the mesh once it is set.
    """
    positions, own, out = f32_at(positions_at), f32_at(own_at), f64_at(out_at)
    indices, keys, bits = u32_at(elements_at), i64_at(keys_at), u32_at(own_at)
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
    # Most meshes that are not such fail here, at one of their first triangles.
    for t in range(triangles):
        if t % _BLOCK == 0 and is_set(stop_at):
            return
        a, b, c = 3 * np.int64(indices[3 * t]), 3 * np.int64(indices[3 * t + 1]), 3 * np.int64(indices[3 * t + 2])
        ax, ay, az = positions[a] - cx, positions[a + 1] - cy, positions[a + 2] - cz
        bx, by, bz = positions[b] - cx, positions[b + 1] - cy, positions[b + 2] - cz
        dx, dy, dz = positions[c] - cx, positions[c + 1] - cy, positions[c + 2] - cz
        volume = ax * (by * dz - bz * dy) + ay * (bz * dx - bx * dz) + az * (bx * dy - by * dx)
        if not volume > 0.0:
            # Two corners in one place: a triangle that nobody sees, as at the poles of a sphere.
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
            own[3 * k + axis] = np.float32(0.0) if near else value
        first = np.uint64(bits[3 * k]) | (np.uint64(bits[3 * k + 1]) << np.uint64(32))
        mixed = _mixed(_mixed(first + np.uint64(0x9E3779B97F4A7C15)) + np.uint64(bits[3 * k + 2]))
        keys[2 * k] = np.int64(mixed)
        keys[2 * k + 1] = np.int64(_mixed(mixed + np.uint64(0x9E3779B97F4A7C15)))
    total = np.int64(0)
    for t in range(triangles):
        if t % _BLOCK == 0 and is_set(stop_at):
            return
        a, b, c = 2 * np.int64(indices[3 * t]), 2 * np.int64(indices[3 * t + 1]), 2 * np.int64(indices[3 * t + 2])
        # Its three edges' counts together.
        total += (keys[b] - keys[a]) * (keys[c + 1] - keys[a + 1]) - (keys[c] - keys[a]) * (keys[b + 1] - keys[a + 1])
    out[0] = 1.0 if total == 0 and triangles > 0 else 0.0
    out[1] = 1.0 if changed else 0.0


def solid(positions: NDArray[np.float32], elements: NDArray[np.uint32]) -> tuple[Bounds, NDArray[np.float32]] | None:
    """Middle and half sides of the box of a mesh whose backs are seen from nowhere outside, and the positions to draw
    it with, of which those that lie in one place but for rounding are the same; None: it is no such mesh.

    Args:
        positions: (N, 3) float32, C-contiguous. elements: (M, 3) uint32, C-contiguous, below N.

    Raises:
        Exception: the current ``StopFlag`` was set.
    """
    stop = current_stop()
    own, keys, out = np.empty_like(positions), np.empty((len(positions), 2), np.int64), np.empty(8)
    enclose(
        address_of(positions, np.float32),
        len(positions),
        address_of(elements, np.uint32),
        len(elements),
        address_of(own, np.float32),
        address_of(keys, np.int64),
        address_of(out, np.float64),
        stop.address,
    )
    stop.check()
    if out[0] == 0.0:
        return None
    x, y, z, w, h, d = out[2:].tolist()
    return (x, y, z, w, h, d), own if out[1] != 0.0 else positions
