"""Pairs of primitives at edge pixels that are shaded once."""

import numpy as np
from numba import njit

from renderers.compiler.kernel_types import i64
from renderers.compiler.pointers import i32_at
from renderers.raster.layout import RasterFrame, RasterInstance
from renderers.raster.msaa.edge_merge import InstanceCache, share_smooth_edge


@njit(error_model="numpy")
def _share(frame, first, second, count, out):  # type: ignore[no-untyped-def]  # Numba infers the types
    cache = InstanceCache()
    cache.first_id = cache.end_id = cache.indices = 0
    for k in range(count):
        i32_at(out)[k] = share_smooth_edge(RasterFrame(frame), i64(i32_at(first)[k]), i64(i32_at(second)[k]), cache)


def test_triangles_that_share_an_edge_of_a_mesh_with_normals() -> None:
    rng = np.random.default_rng(3)
    # Two instances of random triangles with normals, one without, and lines.
    indices = [np.array([rng.permutation(7)[:3] for _ in range(n)], np.uint32) for n in (9, 12, 10)]
    indices.append(np.array([rng.permutation(7)[:2] for _ in range(8)], np.uint32))
    padded = [np.concatenate((np.zeros(8, np.uint32), each.ravel(), np.zeros(8, np.uint32))) for each in indices]
    first_ids = np.cumsum([0, *map(len, indices)]).astype(np.int64)
    instances, frame = np.zeros(5, RasterInstance.dtype), np.zeros(1, RasterFrame.dtype)
    instances["vertices_per_primitive"][:4] = 3, 3, 3, 2
    instances["mesh_normals"][:4] = 1, 1, 0, 1
    instances["mesh_indices"][:4] = [each.ctypes.data + 32 for each in padded]
    frame["instance_count"], frame["instances"], frame["first_ids"] = 4, instances.ctypes.data, first_ids.ctypes.data
    a, b = np.nonzero(~np.eye(first_ids[-1], dtype=bool))
    order = rng.permutation(len(a))
    a, b = a[order].astype(np.int32), b[order].astype(np.int32)
    out = np.zeros(len(a), np.int32)
    _share(frame.ctypes.data, a.ctypes.data, b.ctypes.data, len(a), out.ctypes.data)
    owner = np.searchsorted(first_ids, np.arange(first_ids[-1]), side="right") - 1
    corners = [set(row.tolist()) for each in indices for row in each]
    expected = [
        owner[p] == owner[q] and owner[p] < 2 and len(corners[p] & corners[q]) >= 2 for p, q in zip(a, b, strict=True)
    ]
    assert 10 < sum(expected) < len(expected) / 2
    assert out.tolist() == [int(value) for value in expected]
