"""Meshes of the demo scene: shapes with texture coordinates, and curves."""

import math

import numpy as np
from numpy.typing import NDArray

from gateway.scene.draw.image_meshes import rectangle
from renderers import primitives
from renderers.drawlist import Mesh
from renderers.tubes import tube


def tile(half_side: float, repeats: float) -> Mesh:
    """Return a square at z = 0, centred on the origin, with copies of the texture along each side."""
    return rectangle(2.0 * half_side, 2.0 * half_side, repeats)


def textured_box(x: float, y: float, z: float) -> Mesh:
    """Return a box with these side lengths in metres, and the whole texture on each face."""
    unit = primitives.box()
    uv = np.tile(np.array(((0, 1), (1, 1), (1, 0), (0, 0)), np.float32), (6, 1))
    return Mesh(unit.positions * np.array((x, y, z), np.float32), unit.elements, normals=unit.normals, uv0=uv)


def globe(radius: float = 0.05, segments: int = 32, rings: int = 16) -> Mesh:
    """Return a sphere with a seam of doubled vertices, so that a texture wraps around it. ``radius`` is in metres."""
    azimuth, polar = np.meshgrid(np.linspace(0.0, math.tau, segments + 1), np.linspace(0.0, math.pi, rings + 1))
    normals = np.stack(
        (np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)), axis=2
    ).reshape(-1, 3)
    uv = np.stack((azimuth / math.tau, polar / math.pi), axis=2).reshape(-1, 2)
    index = np.arange((rings + 1) * (segments + 1)).reshape(rings + 1, segments + 1)
    above, below = index[:-1], index[1:]
    return Mesh(
        (normals * radius).astype(np.float32),
        _triangles_between(below, above),
        normals=normals.astype(np.float32),
        uv0=uv.astype(np.float32),
    )


def knot() -> Mesh:
    """Return a trefoil knot."""
    t = np.linspace(0.0, math.tau, 120, endpoint=False)
    points = np.stack((np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)), axis=1)
    mesh = tube(points * 0.022, 0.009, closed=True)
    assert mesh is not None
    return mesh


def relief(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the depth of the wall's waves in metres; u runs across the wall (-1 to 1), v up (0 to 1)."""
    waves: NDArray[np.float64] = 0.08 * np.sin(5.0 * u) * np.cos(7.0 * v) + 0.05 * np.cos(9.0 * u + 4.0 * v)
    return waves


def wall(columns: int = 64, rows: int = 40) -> Mesh:
    """Return the wall that the demo's point cloud samples, 8 mm behind the points so that it does not cover them."""
    u, v = np.meshgrid(np.linspace(-1.0, 1.0, columns), np.linspace(0.0, 1.0, rows))
    slope_across = (relief(u + 1e-4, v) - relief(u - 1e-4, v)) / 2e-4
    slope_up = (relief(u, v + 1e-4) - relief(u, v - 1e-4)) / 2.6e-4  # the wall is 1.3 m high
    positions = np.stack((-0.258 - relief(u, v), u, 1.3 * v), axis=2).reshape(-1, 3)
    normals = np.stack((np.ones_like(u), slope_across, slope_up), axis=2).reshape(-1, 3)
    index = np.arange(rows * columns).reshape(rows, columns)
    below, above = index[:-1], index[1:]
    return Mesh(
        positions.astype(np.float32),
        _triangles_between(below, above),
        normals=(normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32),
    )


def _triangles_between(below: NDArray[np.int64], above: NDArray[np.int64]) -> NDArray[np.uint32]:
    """Return the triangles between rows of vertices with (R, C) indices, (2 R (C - 1), 3) uint32."""
    quads = np.stack((below[:, :-1], below[:, 1:], above[:, 1:], below[:, :-1], above[:, 1:], above[:, :-1]), axis=2)
    return np.ascontiguousarray(quads.reshape(-1, 3), np.uint32)


def ring(centre: tuple[float, float, float], radius: float) -> NDArray[np.float32]:
    """Return points of a horizontal circle, (96, 3) float32, metres."""
    angle = np.linspace(0.0, math.tau, 96, endpoint=False)
    points = np.stack((np.cos(angle), np.sin(angle), np.zeros(96)), axis=1) * radius + np.array(centre)
    return np.asarray(points, np.float32)
