from __future__ import annotations

import numpy as np

from gateway.scene.gltf import warm_up
from gateway.scene.gltf.bytewise import equal_bytes
from gateway.scene.gltf.kernels import equal_arrays, sum_normals
from gateway.scene.gltf.normals import vertex_normals


def test_nothing_is_compiled_after_the_warm_up() -> None:
    """Read-only and writable arrays are different types to Numba: callers must always pass the same."""
    warm_up()
    data = bytes(10_000)
    for other in (bytes(10_000), memoryview(bytearray(10_000)), memoryview(bytearray(10_001))[1:]):
        assert equal_bytes(data, other)
    positions, triangles = np.zeros((3, 3), np.float32), np.array([(0, 1, 2)], np.uint32)
    for writeable in (True, False):
        positions.flags.writeable = triangles.flags.writeable = writeable
        vertex_normals(positions, triangles)
        assert positions.flags.writeable == writeable
    assert len(equal_arrays.signatures) == 1
    assert len(sum_normals.signatures) == 1
