"""Closed meshes whose back faces are hidden from every point outside: spheres, boxes, cylinders, capsules.

On a closed mesh, as many front faces as back faces cover each pixel centre. This holds exactly, because corners are
snapped to a grid and each edge occurs once in each direction. If all triangles also face away from one inner point, a
ray from outside meets a front face first. A camera outside the bounding box of such a mesh needs no back faces. The
image and its depths are the same, except where snapping moves a silhouette over a pixel centre, or where front and back
are closer than float32 can tell: there the front shows.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.device_function import inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.kernel_types import F32, F64, I64, U32, Address, Pointer, f32, f64, i64, u64
from renderers.compiler.pointers import address_of, f32_at, f64_at, i64_at, u32_at
from renderers.shading.vec3 import cross, dot
from renderers.splitmix import GAMMA, mix
from renderers.stop import current_stop

NEAR_ZERO: Final = 2.0**-40
"""Coordinates below this times the mesh's extent count as 0. Mesh generators end a ring at sin(2 pi), which they
compute as 2e-16; as 0, it meets the start of the ring."""

_BLOCK: Final = 1 << 16
"""Vertices or triangles between two checks of the stop flag: a mesh of millions takes a second."""

Bounds = tuple[float, float, float, float, float, float]


@inlined
def _measure(positions: Pointer[F32], vertex_count: I64, out: Pointer[F64]) -> bool:
    """Write centre and half extents of the bounding box to ``out[2:8]``; return False if a vertex is not finite."""
    for axis in range(3):
        low, high = f32(np.inf), f32(-np.inf)
        finite = True
        for k in range(vertex_count):
            value = positions[3 * k + axis]
            finite = finite & (abs(value) < f32(1e18))
            low, high = min(low, value), max(high, value)
        if not finite or vertex_count == 0:
            return False
        out[2 + axis] = 0.5 * (f64(low) + f64(high))
        out[5 + axis] = 0.5 * (f64(high) - f64(low))
    return True


@inlined
def _coincide(a: tuple[F64, F64, F64], b: tuple[F64, F64, F64], tolerance: F64) -> bool:
    """Return whether two points are equal in each coordinate, up to a tolerance, metres."""
    return (abs(a[0] - b[0]) <= tolerance) & (abs(a[1] - b[1]) <= tolerance) & (abs(a[2] - b[2]) <= tolerance)


@inlined
def _from_center(positions: Pointer[F32], vertex: I64, center: tuple[F64, F64, F64]) -> tuple[F64, F64, F64]:
    """Return a vertex relative to a point, metres; ``vertex`` is its index."""
    return (
        positions[3 * vertex] - center[0],
        positions[3 * vertex + 1] - center[1],
        positions[3 * vertex + 2] - center[2],
    )


@inlined
def _faces_away(
    positions: Pointer[F32],
    indices: Pointer[U32],
    triangle_count: I64,
    center: tuple[F64, F64, F64],
    extent: F64,
    stop_at: Address,
) -> bool:
    """Return whether all triangles face away from ``center``; degenerate ones, as at a sphere's poles, may do anything.

    ``extent`` is the largest half extent of the mesh's box, metres.
    """
    for t in range(triangle_count):
        if t % _BLOCK == 0 and is_set(stop_at):
            return False
        a = _from_center(positions, i64(indices[3 * t]), center)
        b = _from_center(positions, i64(indices[3 * t + 1]), center)
        c = _from_center(positions, i64(indices[3 * t + 2]), center)
        if not dot(a, cross(b, c)) > 0.0:
            tolerance = 4.0 * NEAR_ZERO * extent
            if not (_coincide(a, b, tolerance) | _coincide(b, c, tolerance) | _coincide(c, a, tolerance)):
                return False
    return True


@inlined
def _clean_and_hash(
    positions: Pointer[F32],
    vertex_count: I64,
    near_zero: F32,
    cleaned: Pointer[F32],
    bits: Pointer[U32],
    hashes: Pointer[I64],
    stop_at: Address,
) -> bool:
    """Write the positions, with coordinates up to ``near_zero`` as 0, and two hashes of each; return whether any
    changed.

    ``bits`` is the memory of ``cleaned`` as uint32.
    """
    changed = False
    for k in range(vertex_count):
        if k % _BLOCK == 0 and is_set(stop_at):
            return False
        for axis in range(3):
            value = positions[3 * k + axis]
            is_zero = abs(value) <= near_zero
            changed = changed | (is_zero & (value != f32(0.0)))
            cleaned[3 * k + axis] = f32(0.0) if is_zero else value
        xy_bits = u64(bits[3 * k]) | (u64(bits[3 * k + 1]) << u64(32))
        first_hash = mix(mix(xy_bits + GAMMA) + u64(bits[3 * k + 2]))
        hashes[2 * k] = i64(first_hash)
        hashes[2 * k + 1] = i64(mix(first_hash + GAMMA))
    return changed


@inlined
def _edge_sum(indices: Pointer[U32], triangle_count: I64, hashes: Pointer[I64], stop_at: Address) -> I64:
    """Return the sum over all edges from a to b of A(a) B(b) - A(b) B(a), modulo 2^64.

    A and B are the two hashes of a position. If each edge occurs as often in the other direction, the sum is 0;
    otherwise it is 0 with a probability of about 2^-60.
    """
    edge_sum = i64(0)
    for t in range(triangle_count):
        if t % _BLOCK == 0 and is_set(stop_at):
            return i64(1)
        a, b, c = 2 * i64(indices[3 * t]), 2 * i64(indices[3 * t + 1]), 2 * i64(indices[3 * t + 2])
        # The terms of its three edges, expanded around corner a.
        edge_sum += (hashes[b] - hashes[a]) * (hashes[c + 1] - hashes[a + 1])
        edge_sum -= (hashes[c] - hashes[a]) * (hashes[b + 1] - hashes[a + 1])
    return edge_sum


@kernel
def check_back_faces_hidden(
    positions_at: Address,
    vertex_count: I64,
    indices_at: Address,
    triangle_count: I64,
    cleaned_at: Address,
    hashes_at: Address,
    out_at: Address,
    stop_at: Address,
) -> None:
    """Check whether a mesh is closed and faces away from the centre of its bounding box everywhere.

    Args:
        cleaned_at: (vertex_count, 3) float32; gets the positions with values near zero set to zero.
        hashes_at: (vertex_count, 2) uint64 of scratch.
        out_at: 8 float64: 1 if it is closed and faces away, else 0; 1 if the cleaned positions differ, else 0; centre
            and half extents of the bounding box.
        stop_at: a ``StopFlag``; the result means nothing if it was set.
    """
    positions, indices, out = f32_at(positions_at), u32_at(indices_at), f64_at(out_at)
    cleaned, bits, hashes = f32_at(cleaned_at), u32_at(cleaned_at), i64_at(hashes_at)
    out[0] = out[1] = 0.0
    if not _measure(positions, vertex_count, out):
        return
    center, extent = (out[2], out[3], out[4]), max(out[5], out[6], out[7])
    # Most other meshes fail here, at one of their first triangles.
    if not _faces_away(positions, indices, triangle_count, center, extent, stop_at):
        return
    near_zero = f32(NEAR_ZERO * extent)
    changed = _clean_and_hash(positions, vertex_count, near_zero, cleaned, bits, hashes, stop_at)
    is_closed = _edge_sum(indices, triangle_count, hashes, stop_at) == 0 and triangle_count > 0
    out[0] = 1.0 if is_closed else 0.0
    out[1] = 1.0 if changed else 0.0


def cullable_mesh(
    positions: NDArray[np.float32], indices: NDArray[np.uint32]
) -> tuple[Bounds, NDArray[np.float32]] | None:
    """Return the bounding box of a mesh whose back faces are hidden from outside; None for other meshes.

    Args:
        positions, indices: (N, 3) and (M, 3), C-contiguous.

    Returns:
        Centre and half extents of the box, and the positions to draw the mesh with: values near zero are exactly zero,
            so that vertices on the two sides of a seam are equal.

    Raises:
        Exception: the current ``StopFlag`` was set.
    """
    stop = current_stop()
    cleaned, hashes, out = np.empty_like(positions), np.empty((len(positions), 2), np.int64), np.empty(8)
    check_back_faces_hidden(
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
    x, y, z, half_x, half_y, half_z = out[2:].tolist()
    return (x, y, z, half_x, half_y, half_z), cleaned if out[1] != 0.0 else positions
