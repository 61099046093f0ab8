"""Primitives that look the same where they meet: triangles of one instance that share an edge and its vertex normals.

Pixels that see two of them are shaded once, as one.
"""

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_types import I64
from renderers.compiler.pointers import address, advance, u32_at
from renderers.compiler.structs import Struct
from renderers.primitive_ids import instance_of
from renderers.raster.layout import TRIANGLE_VERTICES, RasterFrame


class InstanceCache(Struct):
    """The instance that was looked up last. All zero at first."""

    first_id: I64  # first primitive id of the instance
    end_id: I64  # the one after its last
    indices: I64  # address of its indices; 0: no triangles with normals


@device_function
def _load_instance(frame: RasterFrame, primitive_id: I64, cache: InstanceCache) -> None:
    """Fill ``cache``, a InstanceCache, with a primitive's instance."""
    first_ids = frame.first_ids
    index = instance_of(first_ids, frame.instance_count, primitive_id, 0)
    instance = frame.instances[index]
    cache.first_id, cache.end_id = first_ids[index], first_ids[index + 1]
    has_normals = instance.vertices_per_primitive == TRIANGLE_VERTICES and instance.mesh_normals != 0
    cache.indices = address(instance.mesh_indices) if has_normals else 0


@inlined
def share_smooth_edge(frame: RasterFrame, a: I64, b: I64, cache: InstanceCache) -> bool:
    """Return whether two primitives (ids) are triangles with normals of one instance that share an edge."""
    if a < cache.first_id or a >= cache.end_id:
        _load_instance(frame, a, cache)
    if b < cache.first_id or b >= cache.end_id or cache.indices == 0:
        return False
    # Visible triangles have three different corners: the test is symmetric.
    low, high = min(a, b) - cache.first_id, max(a, b) - cache.first_id
    indices = u32_at(cache.indices)
    p, q = advance(indices, 3 * low), advance(indices, 3 * high)
    if high < 2:
        shared = 0
        for i in range(3):
            shared += (p[i] == q[0]) | (p[i] == q[1]) | (p[i] == q[2])
        return shared >= 2
    # Eight values that end with q's corners: eight from q on may lie beyond the array.
    corners = vec.load(indices, 3 * high - 5)
    is_shared = (corners == vec.i32(p[0])) | (corners == vec.i32(p[1])) | (corners == vec.i32(p[2]))
    return vec.count_bits(vec.movemask(is_shared) >> 5) >= 2
