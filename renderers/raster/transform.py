"""Transformation of vertices from a mesh's frame to pixels: the first phase of a frame."""

from typing import Final

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.kernel_types import F32, F64, I64, Address, Pointer, f32
from renderers.compiler.pointers import advance, stack_array
from renderers.compiler.simd import F64x8
from renderers.raster.layout import BEFORE_NEAR_PLANE, GUARD_BAND, OUTSIDE_GUARD_BAND, RasterFrame, draw_of

_VERTICES_PER_STOP_CHECK: Final = 1 << 18
"""Vertices between two checks of the stop flag: about a millisecond."""

_position_array = stack_array(F32, 3 * vec.LANES)
_vertex_array = stack_array(F32, 4 * vec.LANES)


@inlined
def _affine_row(row: Pointer[F64], x: F64x8, y: F64x8, z: F64x8) -> F64x8:
    """Return a coordinate of eight points, transformed by a row of an affine matrix, translation last."""
    return vec.f64(row[0]) * x + vec.f64(row[1]) * y + vec.f64(row[2]) * z + vec.f64(row[3])


@inlined
def _transform_eight(
    frame: RasterFrame, X_camera_mesh: Pointer[F64], positions: Pointer[F32], out: Pointer[F32]
) -> None:
    """Transform eight vertices, (8, 3), metres, to (8, 4): x and y in pixels, 1/z, unused."""
    # load_third(p, i, k): every third value from p[i] on, its k-th of three.
    px = vec.to_f64(vec.load_third(positions, 0, 0))
    py = vec.to_f64(vec.load_third(positions, 0, 1))
    pz = vec.to_f64(vec.load_third(positions, 0, 2))
    one, guard = vec.f64(1.0), vec.f64(GUARD_BAND)
    z = _affine_row(advance(X_camera_mesh, 8), px, py, pz)
    in_front = z >= vec.f64(frame.near)
    inv_z = vec.select(in_front, one / z, one)
    x = vec.f64(frame.fx) * _affine_row(X_camera_mesh, px, py, pz) * inv_z + vec.f64(frame.cx)
    y = vec.f64(frame.fy) * _affine_row(advance(X_camera_mesh, 4), px, py, pz) * inv_z + vec.f64(frame.cy)
    # A z that is not a number gives BEFORE_NEAR_PLANE; such an x or y, with a z in front, gives OUTSIDE_GUARD_BAND:
    # clipping drops it.
    inside = (vec.absolute(x) <= guard) & (vec.absolute(y) <= guard)
    inv_z = vec.select(inside, inv_z, vec.f64(OUTSIDE_GUARD_BAND))
    inv_z = vec.select(in_front, inv_z, vec.f64(BEFORE_NEAR_PLANE))
    vec.store_vertices(out, 0, vec.to_f32(x), vec.to_f32(y), vec.to_f32(inv_z))


@device_function
def _transform(
    frame: RasterFrame, X_camera_mesh: Pointer[F64], positions: Pointer[F32], count: I64, out: Pointer[F32]
) -> None:
    """Transform ``count`` vertices as ``_transform_eight``."""
    whole = count - count % vec.LANES
    for k in range(0, whole, vec.LANES):
        _transform_eight(frame, X_camera_mesh, advance(positions, 3 * k), advance(out, 4 * k))
    if whole < count:  # with whole vectors of their own: what follows in memory belongs to others
        last_positions, last_out = _position_array(), _vertex_array()
        for k in range(3 * vec.LANES):
            last_positions[k] = positions[3 * whole + k] if k < 3 * (count - whole) else f32(0.0)
        _transform_eight(frame, X_camera_mesh, last_positions, last_out)
        for k in range(4 * (count - whole)):
            out[4 * whole + k] = last_out[k]


@kernel
def transform(frame_address: Address, begin: I64, end: I64) -> None:
    """Compute pixel coordinates and 1/z of the vertices ``begin .. end`` among those of all draws."""
    frame = RasterFrame(frame_address)
    draw_index = draw_of(frame, begin, True)
    first = begin
    while first < end and not is_set(frame.stop):
        draw = frame.draws[draw_index]
        draw_end = frame.draws[draw_index + 1].first_vertex
        run_end = min(end, draw_end, first + _VERTICES_PER_STOP_CHECK)
        offset = first - draw.first_vertex
        positions, out = advance(draw.positions, 3 * offset), advance(frame.vertices, 4 * first)
        _transform(frame, draw.X_camera_mesh, positions, run_end - first, out)
        # A guard: draws are in the order of their vertices, so that run_end >= first.
        first = max(first, run_end)
        draw_index += first >= draw_end  # the next draw, if this one is done
