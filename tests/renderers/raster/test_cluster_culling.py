"""Cluster culling: no visible triangle is culled, and most invisible ones are."""

from __future__ import annotations

from unittest.mock import patch

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.compiler.pointers import address_of
from renderers.drawlist import DrawList, Instance, Material, Mesh
from renderers.interface import Look, Output
from renderers.raster import CpuRenderer, scene
from renderers.raster.cluster_culling import (
    CLUSTER,
    MIN_TRIANGLES,
    VIEW,
    bound_clusters,
    cluster_values,
    view_clusters,
    visible_clusters,
)
from renderers.raster.layout import DRAW, FRAME
from renderers.stop import current_stop
from tests.renderers.raster.test_convex_culling import bumpy, changed

ALL = Output.COLOR | Output.DEPTH | Output.LABEL | Output.INSTANCE
LENS = np.array((500.0, 450.0, 300.0, 200.0, 0.1, 100.0))
WIDTH, HEIGHT = 640, 480


frame_at, draw_at, view_at = FRAME.at, DRAW.at, VIEW.at


@njit(error_model="numpy")
def _seen(frame_address, draw_address, count, view_address, out):  # type: ignore[no-untyped-def]
    view = view_at(view_address)
    view_clusters(frame_at(frame_address), draw_at(draw_address), view)
    if view.clusters == 0:
        return False
    for k in range(0, count, 8):
        out[k // 8] = visible_clusters(view, k)
    return True


def seen(mesh: Mesh, X_camera_mesh: NDArray[np.float64], cull: int, hidden: int, apart: int) -> NDArray[np.bool_]:
    """Return whether each cluster may be visible; empty if nothing can be culled."""
    count = -(-len(mesh.elements) // CLUSTER)
    values = np.zeros(cluster_values(len(mesh.elements)), np.float32)
    addresses = address_of(mesh.positions, np.float32), address_of(mesh.elements, np.uint32)
    bound_clusters(*addresses, len(mesh.elements), address_of(values, np.float32), current_stop().address)
    frame, draw, view = np.zeros(1, FRAME.dtype), np.zeros(1, DRAW.dtype), np.zeros(1, VIEW.dtype)
    for field, value in zip(("fx", "fy", "cx", "cy", "near", "far"), LENS, strict=True):
        frame[field] = value
    frame["width"], frame["height"] = WIDTH, HEIGHT
    frame["band_count"], frame["bin_count"] = 15, 15 + apart
    draw["clusters"], draw["culled_sign"], draw["hidden_sign"] = address_of(values, np.float32), cull, hidden
    draw["X_camera_mesh"] = X_camera_mesh[:3].ravel()
    out = np.zeros(-(-count // 8), np.uint8)
    said = _seen(frame.ctypes.data, draw.ctypes.data, count, view.ctypes.data, out)
    return np.unpackbits(out, bitorder="little")[: count if said else 0].astype(bool)


def visible(mesh: Mesh, X_camera_mesh: NDArray[np.float64], mirrored: bool) -> tuple[NDArray[np.bool_], ...]:
    """Return for each triangle, in exact arithmetic on snapped corners, whether its box overlaps the image and whether
    it is front-facing. All must lie in front of the camera."""
    points = mesh.positions.astype(np.float64) @ X_camera_mesh[:3, :3].T + X_camera_mesh[:3, 3]
    fx, fy, cx, cy, near, _ = LENS
    assert (points[:, 2] > near).all()
    pixels = np.stack((fx * points[:, 0] / points[:, 2] + cx, fy * points[:, 1] / points[:, 2] + cy), 1)
    grid = np.rint(256 * pixels.astype(np.float32)).astype(np.int64)[mesh.elements]
    low, high = grid.min(axis=1) - 128, grid.max(axis=1) + 128
    inside = (high >= 0).all(axis=1) & (low[:, 0] <= 256 * WIDTH) & (low[:, 1] <= 256 * HEIGHT)
    u, v = grid[:, 1] - grid[:, 0], grid[:, 2] - grid[:, 0]
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    return inside, area > 0 if mirrored else area < 0


def anywhere(rng: np.random.Generator, mirror: bool) -> NDArray[np.float64]:
    """A ball of radius 1 in front of the camera, turned and stretched."""
    rotation, stretch = np.linalg.qr(rng.normal(size=(3, 3)))[0], np.diag(rng.uniform(0.5, 2.0, 3))
    X = np.eye(4)
    X[:3, :3] = rotation @ stretch @ np.linalg.qr(rng.normal(size=(3, 3)))[0] * 10.0 ** rng.uniform(-2.0, 0.0)
    if (np.linalg.det(X[:3, :3]) < 0.0) != mirror:
        X[:3, 0] *= -1.0
    X[:3, 3] = rng.uniform(-1.5, 1.5), rng.uniform(-1.5, 1.5), rng.uniform(5.0, 8.0)
    return X


@pytest.mark.parametrize("seed", range(30))
def test_no_visible_triangle_is_culled(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mirror = bool(seed & 1)
    mesh = bumpy(int(rng.integers(20, 400)), int(rng.integers(20, 200)), float(rng.choice((0.0, 0.1, 0.3))))
    X = anywhere(rng, mirror)
    side = -1 if mirror else 1
    inside, front = visible(mesh, X, mirror)
    missing = -len(front) % CLUSTER

    def clusters_of(triangles: NDArray[np.bool_]) -> NDArray[np.bool_]:
        return np.asarray(np.pad(triangles, (0, missing)).reshape(-1, CLUSTER).any(axis=1))

    for cull, hidden, apart, wanted in (
        (side, 0, 0, inside & front),
        (0, side, 9, inside & front),
        (side, 0, 9, inside),
    ):
        said = seen(mesh, X, cull, hidden, apart)
        assert len(said) > 0
        assert not (clusters_of(wanted) & ~said).any()


def test_most_back_facing_triangles_are_culled() -> None:
    X = np.eye(4)
    X[2, 3] = 3.0
    for mesh, most in ((bumpy(500, 250, 0.0), 0.45), (bumpy(500, 250, 0.1), 0.6)):
        assert 0.2 < seen(mesh, X, 1, 0, 0).mean() < most
    assert seen(mesh, X, 0, 0, 0).all()  # both sides are drawn
    X[0, 3] = 30.0
    beside = seen(mesh, X, 0, 0, 0)
    assert len(beside) > 0
    assert not beside.any()


def test_invalid_transforms_and_positions_cull_nothing() -> None:
    mesh = bumpy(40, 20, 0.0)
    X = np.eye(4)
    for nowhere in (np.diag((1.0, 1.0, 0.0, 1.0)), np.full((4, 4), np.nan)):
        assert len(seen(mesh, nowhere, 1, 0, 0)) == 0
    X[2, 3] = 3.0
    positions = mesh.positions.copy()
    positions[:: CLUSTER // 2] = np.nan
    assert seen(changed(mesh, positions), X, 1, 0, 0).all()


@pytest.mark.parametrize("seed", range(8))
def test_cluster_culling_does_not_change_the_image(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    soup = Mesh(rng.normal(size=(90, 3)).astype(np.float32), rng.integers(0, 90, (150, 3)).astype(np.uint32))
    meshes = soup, bumpy(200, 60, 0.2), changed(bumpy(60, 90, 0.1), elements=bumpy(60, 90, 0.1).elements[:-35])
    poses = [anywhere(rng, bool(rng.integers(2))) for _ in meshes]
    f = rng.uniform(60.0, 400.0)
    camera = Camera(150, 110, f, 1.2 * f, 70.0, 60.0, 0.05, 100.0, np.eye(4))
    look = Look("phong", samples=4 if seed % 4 == 3 else 1)
    material = Material((0.4, 0.6, 0.8, 1.0), double_sided=bool(seed & 1))

    def pictures() -> list[bytes]:
        own = [Mesh(m.positions, m.elements) for m in meshes]  # prepared anew
        instances = tuple(Instance(m, material, X, k, k) for k, (m, X) in enumerate(zip(own, poses, strict=True)))
        with CpuRenderer(1).render(DrawList(instances), camera, ALL, look) as frame:
            arrays = frame.color, frame.depth, frame.label, frame.instance
            return [array.tobytes() for array in arrays if array is not None]

    quick = pictures()
    with patch.object(scene, "MIN_TRIANGLES", 10**9):
        assert pictures() == quick


@pytest.mark.parametrize("seed", [2246, *range(20)])
def test_normal_cones_wider_than_a_half_turn(seed: int) -> None:
    """A blunt spike seen from its axis: the normals of its sides and of its tip spread over more than a half turn."""
    rng = np.random.default_rng(seed)
    height, top, n = rng.uniform(0.5, 4), rng.uniform(0.1, 0.8), 7
    u = 2 * np.pi * np.arange(n) / n + rng.random()
    around = np.stack((np.cos(u), np.sin(u), np.zeros(n)), axis=-1)
    tip = (0, 0, height + rng.uniform(0, 0.3))
    points = np.concatenate((around, around * (top, top, 0) + (0, 0, height), [tip])).astype(np.float32)
    k = np.arange(n)
    after = (k + 1) % n
    sides = np.stack((np.stack((n + k, n + after, np.full(n, 2 * n)), 1), np.stack((k, after, n + after), 1)), 1)
    elements = np.concatenate((sides.reshape(-1, 3), [(0, 1, n + 1), (n, n + 1, 2 * n)]))
    X = np.diag((1.0, -1.0, -1.0, 1.0))
    away = height + 10.0 ** rng.uniform(-1, 1)
    X[:3, 3] = rng.normal() * 0.05, rng.normal() * 0.05, away
    view = Camera(64, 48, 30.0, 30.0, 32.0, 24.0, 0.01, 100.0, np.eye(4))
    pictures = []
    for worth in (MIN_TRIANGLES, 10**9):
        mesh = Mesh(points, np.tile(elements, (4, 1)).astype(np.uint32))
        with (
            patch.object(scene, "MIN_TRIANGLES", worth),
            CpuRenderer(1).render(DrawList((Instance(mesh, Material(), X, 1, 1),)), view, Output.COLOR) as frame,
        ):
            assert frame.color is not None
            pictures.append(frame.color.copy())
    culled, whole = pictures
    np.testing.assert_array_equal(culled, whole)
