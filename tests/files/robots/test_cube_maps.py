"""Meshes that are cut for a cube map."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from gateway.files.robots.cube_maps import cube_mapped
from renderers import primitives
from renderers.drawlist import Mesh


def test_triangles_that_share_an_edge_are_cut_at_the_same_points() -> None:
    """Points that differ in their last bit leave holes."""
    sphere = primitives.sphere()
    directions = sphere.positions * np.array((1.0, 1.3, 0.7), np.float32) + np.array((0.1, 0.05, 0.02), np.float32)
    mapped = cube_mapped(replace(sphere, positions=directions), directions, 8, 6, lambda count: None)
    assert len(mapped.elements) > len(sphere.elements)
    assert mapped.uv0 is not None
    edges: Counter[tuple[bytes, bytes]] = Counter()
    for triangle in mapped.positions[mapped.elements] + np.float32(0.0):
        a, b, c = (corner.tobytes() for corner in triangle)
        edges.update(((a, b), (b, c), (c, a)))
    assert all(edges[end, start] == count for (start, end), count in edges.items())


def test_long_triangles_show_straight_lines() -> None:
    """Places on a face of the map are quotients: between the corners of a long triangle they are not linear."""
    corners = np.array([(0.5, -0.5, -0.5), (1.0, -0.5, -1.0), (1.0, -0.5, 1.0), (0.5, -0.5, 0.5)], np.float32)
    mesh = Mesh(corners, np.array([(0, 1, 2), (0, 2, 3)], np.uint32), corners)
    mapped = cube_mapped(mesh, corners, 1 << 20, 1, lambda count: None)
    assert mapped.uv0 is not None
    x, y, z = mapped.positions[mapped.elements].mean(axis=1).T
    shown = mapped.uv0[mapped.elements].mean(axis=1)  # row towards -z, column towards -y
    np.testing.assert_allclose(shown, np.stack((0.5 - 0.5 * z / x, 0.5 - 0.5 * y / x), axis=1), atol=0.01)


def test_vertices_are_checked_before_they_are_too_many() -> None:
    """Triangles around the middle of the map become hundreds each."""
    positions = np.random.default_rng(0).uniform(-1.0, 1.0, (3000, 3)).astype(np.float32)
    mesh = Mesh(positions, np.arange(3000, dtype=np.uint32).reshape(-1, 3), positions)
    counts: list[int] = []

    def check(count: int) -> None:
        counts.append(count)
        if count > 20_000:
            raise OverflowError

    with pytest.raises(OverflowError):
        cube_mapped(mesh, positions, 8, 6, check)
    assert counts[-1] < 60_000
