"""The rasterizer against the slow oracle, and invariants that hold for any scene."""

from typing import Any

import numpy as np
import pytest

from renderers.camera import Camera
from renderers.drawlist import LABEL_NONE, DrawList, Instance, Material
from renderers.interface import Output
from renderers.raster import CpuRenderer
from tests.renderers import oracle
from tests.renderers.scenes import camera, draw_list, grid, mesh, pose, soup, sphere

GEOMETRY = Output.DEPTH | Output.LABEL | Output.INSTANCE | Output.NORMAL


@pytest.fixture(scope="module")
def renderer() -> CpuRenderer:
    return CpuRenderer(threads=1)


def agree(renderer: CpuRenderer, scene: DrawList, view: Camera, *, pixels: int = 1) -> oracle.Picture:
    """Compare with the oracle: coverage, depth, and records where depths are not too near to tell."""
    expected = oracle.draw(scene, view)
    seen = renderer.visibility(scene, view)
    frame = renderer.render(scene, view, Output.DEPTH)
    ids, depth = seen.ids.astype(np.int64), frame.depth.astype(np.float64)
    assert np.array_equal(ids >= 0, np.isfinite(depth))
    assert np.count_nonzero((ids >= 0) != (expected.ids >= 0)) <= pixels
    same = (ids == expected.ids) & (ids >= 0)
    error = np.abs(depth[same] / expected.depth[same] - 1.0)
    if error.size:
        assert np.quantile(error, 0.99) < 1e-6, np.quantile(error, (0.5, 0.99, 1.0))
    other = (ids != expected.ids) & (ids >= 0) & (expected.ids >= 0)
    # Intersecting surfaces: another record only where both are at the same depth, but for the edge pixel allowed.
    apart = np.abs(depth[other] / expected.depth[other] - 1.0) > 2e-6
    assert np.count_nonzero(apart) <= pixels
    return expected


@pytest.mark.parametrize("seed", range(6))
def test_random_triangles(renderer: CpuRenderer, seed: int) -> None:
    rng = np.random.default_rng(seed)
    size = (1.0, 0.3, 0.05, 0.02, 2.0, 0.005)[seed]
    scene = draw_list(
        soup(rng, 60, size=size, low=(-2, -2, 1), high=(2, 2, 5)),
        Instance(soup(rng, 40, size=size, low=(-1, -1, -1), high=(1, 1, 1)), Material(), pose(rng, z=3.0), 5, 6),
    )
    picture = agree(renderer, scene, camera())
    assert (picture.ids >= 0).any()


@pytest.mark.parametrize("seed", range(4))
def test_triangles_through_the_near_plane(renderer: CpuRenderer, seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    scene = draw_list(soup(rng, 30, size=2.0, low=(-1, -1, -1), high=(1, 1, 3)))
    agree(renderer, scene, camera(near=0.05))


@pytest.mark.parametrize("height", [0.02, 0.5, 3.0])
def test_large_ground_under_the_camera(renderer: CpuRenderer, height: float) -> None:
    """100 m quads reach far behind the near plane and far out of the guard band."""
    ground = mesh(((-50, height, -50), (50, height, -50), (50, height, 50), (-50, height, 50)), ((0, 1, 2), (0, 2, 3)))
    view = camera(near=0.01, far=1000.0)
    expected = agree(renderer, draw_list(ground), view)
    rows = np.nonzero((expected.ids >= 0).all(axis=1))[0]
    assert rows.size > 10
    # And against the formula: z = height / ray.
    frame = renderer.render(draw_list(ground), view, Output.DEPTH)
    z = height / ((rows + 0.5 - view.cy) / view.fy)
    np.testing.assert_allclose(frame.depth[rows], np.broadcast_to(z[:, None], (rows.size, view.width)), rtol=3e-7)


def test_camera_inside_a_sphere(renderer: CpuRenderer) -> None:
    scene = draw_list(Instance(sphere(24, 12, 0.3), Material(), np.eye(4), 3, 4))
    expected = agree(renderer, scene, camera(near=0.05))
    assert (expected.ids >= 0).all()


def test_far_plane_shows_what_is_behind_nothing(renderer: CpuRenderer) -> None:
    slope = mesh(((-9, 2, 1), (9, 2, 1), (9, -6, 9), (-9, -6, 9)), ((0, 1, 2), (0, 2, 3)))
    for far in (2.5, 3.5, 4.5):
        expected = agree(renderer, draw_list(slope), camera(far=far))
        assert np.isfinite(expected.depth).any()
        assert np.isinf(expected.depth).any()
        frame = renderer.render(draw_list(slope), camera(far=far), GEOMETRY)
        gone = np.isinf(frame.depth)
        assert (frame.label[gone] == LABEL_NONE).all()
        assert frame.depth[~gone].max() <= far


def test_near_plane_shows_what_is_behind(renderer: CpuRenderer) -> None:
    plate = ((-1, -1, 0.5), (1, -1, 0.5), (1, 1, 0.5), (-1, 1, 0.5))
    scene = draw_list(mesh(plate, ((0, 1, 2), (0, 2, 3))), mesh(np.array(plate) * 4, ((0, 1, 2), (0, 2, 3))))
    frame = renderer.render(scene, camera(near=0.6), GEOMETRY)
    assert (frame.label == 2).all()
    frame = renderer.render(scene, camera(near=0.5), GEOMETRY)
    assert frame.label[35, 48] == 1


@pytest.mark.parametrize("seed", range(3))
def test_slivers_and_tiny_triangles(renderer: CpuRenderer, seed: int) -> None:
    rng = np.random.default_rng(200 + seed)
    ends = rng.uniform((-2, -2, 1), (2, 2, 5), size=(50, 2, 3))
    third = ends.mean(axis=1) + rng.normal(scale=10.0 ** rng.uniform(-7, -2, size=(50, 1)), size=(50, 3))
    corners = np.concatenate((ends, third[:, None]), axis=1).reshape(-1, 3)
    agree(renderer, draw_list(mesh(corners, np.arange(150).reshape(-1, 3))), camera())


@pytest.mark.parametrize(("columns", "rows", "seed"), [(1, 1, 0), (7, 5, 1), (40, 30, 2), (150, 90, 3)])
def test_shared_edges_neither_leak_nor_overlap(renderer: CpuRenderer, columns: int, rows: int, seed: int) -> None:
    """Peeling a subdivided quad that fills the picture: the first layer is everywhere, the second nowhere."""
    rng = np.random.default_rng(seed)
    corners = np.array(((-3, -3, 2), (3, -3, 2), (3, 3, 2), (-3, 3, 2))) + rng.normal(scale=0.1, size=(4, 3))
    scene = draw_list(grid(columns, rows, corners))
    first = renderer.visibility(scene, camera())
    assert (first.ids >= 0).all()
    second = renderer.visibility(scene, camera(), behind=first)
    assert (second.ids < 0).all()


def test_shared_edges_across_near_plane_and_guard_band(renderer: CpuRenderer) -> None:
    ground = grid(13, 11, ((-60, 0.3, -60), (60, 0.3, -60), (60, 0.3, 60), (-60, 0.3, 60)))
    view = camera(near=0.01, far=1000.0)
    below = np.arange(view.height) > view.cy + 2
    first = renderer.visibility(draw_list(ground), view)
    assert (first.ids[below] >= 0).all()
    second = renderer.visibility(draw_list(ground), view, behind=first)
    assert (second.ids < 0).all()


@pytest.mark.parametrize("threads", [2, 4])
@pytest.mark.parametrize(("width", "height"), [(1, 1), (33, 65), (320, 240)])
def test_any_number_of_threads_gives_the_same_bytes(
    renderer: CpuRenderer, threads: int, width: int, height: int
) -> None:
    rng = np.random.default_rng(9)
    scene = draw_list(
        soup(rng, 3000, size=0.2, low=(-2, -2, 0), high=(2, 2, 5)),
        sphere(200, 100),
        Instance(sphere(60, 30, 2.0), Material(), pose(rng, z=4.0), 8, 9),
        mesh(rng.uniform((-2, -2, 0), (2, 2, 5), size=(900, 3)), np.arange(900).reshape(-1, 2)),
        mesh(rng.uniform((-2, -2, 0), (2, 2, 5), size=(900, 3)), np.arange(900).reshape(-1, 1)),
        line_width=2.0,
        point_size=3.0,
    )
    view = camera(width, height, near=0.05)
    several = CpuRenderer(threads)
    for _ in range(3):
        one = renderer.render(scene, view, GEOMETRY)
        other = several.render(scene, view, GEOMETRY)
        a = renderer.visibility(scene, view)
        b = several.visibility(scene, view)
        assert np.array_equal(a.ids, b.ids)
        for name in ("depth", "label", "instance", "normal"):
            assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name
    several.close()


def test_culling_agrees_on_the_clipped_path(renderer: CpuRenderer) -> None:
    """A floor seen from above is a front, seen from below a back, also where the near plane cuts it."""
    up = mesh(((-50, 1, -50), (-50, 1, 50), (50, 1, 50), (50, 1, -50)), ((0, 1, 2), (0, 2, 3)))
    down = mesh(up.positions, up.elements[:, ::-1])
    for floor in (up, down):
        small = mesh(floor.positions * np.float32(0.02) + np.array((0, 1, 3), np.float32), floor.elements)
        large = renderer.visibility(draw_list(floor), camera(), cull_back=np.array((True,)))
        little = renderer.visibility(draw_list(small), camera(), cull_back=np.array((True,)))
        assert (large.ids >= 0).any() == (little.ids >= 0).any()


def test_depth_peeling_yields_layers_in_depth_order(renderer: CpuRenderer) -> None:
    rng = np.random.default_rng(5)
    scene = draw_list(soup(rng, 40, size=1.0, low=(-1, -1, 1), high=(1, 1, 4)), sphere(16, 8, 2.5))
    view = camera(near=0.05)
    hits = oracle.draw(scene, view).hits
    count = np.zeros((view.height, view.width), dtype=int)
    layer = renderer.visibility(scene, view)
    while (layer.ids >= 0).any():
        count += layer.ids >= 0
        following = renderer.visibility(scene, view, behind=layer)
        both = following.ids >= 0
        assert (layer.ids[both] >= 0).all()
        assert (following.inv_z[both] <= layer.inv_z[both]).all()
        tied = both & (following.inv_z == layer.inv_z)
        assert (following.ids[tied] < layer.ids[tied]).all()
        layer = following
    assert np.count_nonzero(count != hits) <= 3


def test_before_draws_only_in_front_of_a_layer(renderer: CpuRenderer) -> None:
    rng = np.random.default_rng(6)
    scene = draw_list(soup(rng, 40, size=1.0, low=(-1, -1, 1), high=(1, 1, 4)), sphere(16, 8, 2.5))
    view = camera(near=0.05)
    ball = np.array((False, True))
    shell = renderer.visibility(scene, view, select=ball)
    inside = renderer.visibility(scene, view, select=~ball, in_front_of=shell)
    everything = renderer.visibility(scene, view)
    merged = np.where(inside.ids >= 0, inside.ids, shell.ids)
    assert np.array_equal(merged, everything.ids)
    assert (inside.ids >= 0).any()
    assert (merged == shell.ids).any()


def test_layers_in_drawing_order_are_those_by_distance(renderer: CpuRenderer) -> None:
    """Every pixel sees the same primitives, the last first, and below an id the nearest of those drawn before."""
    rng = np.random.default_rng(8)
    ends = rng.uniform((-1, -1, 1), (1, 1, 4), (20, 3))
    lines = mesh(ends, np.arange(20).reshape(-1, 2))
    scene = draw_list(soup(rng, 40, size=1.0, low=(-1, -1, 1), high=(1, 1, 4)), sphere(64, 32, 2.5), lines)
    view = camera(near=0.05)
    by_distance: list[np.ndarray] = []
    layer = renderer.visibility(scene, view)
    while (layer.ids >= 0).any():
        by_distance.append(layer.ids.copy())
        layer = renderer.visibility(scene, view, behind=layer)
    seen = np.array(by_distance)
    earlier = None
    for expected in np.sort(seen, axis=0)[::-1]:
        layer = renderer.visibility(scene, view, id_limits=earlier, latest=True)
        np.testing.assert_array_equal(layer.ids, expected)
        earlier = layer.ids.copy()
    bound = rng.integers(0, seen.max(), seen.shape[1:]).astype(np.int32)
    is_earlier = (seen >= 0) & (seen < bound)
    nearest = np.where(is_earlier.any(axis=0), np.take_along_axis(seen, is_earlier.argmax(axis=0)[None], 0)[0], -1)
    layer = renderer.visibility(scene, view, id_limits=bound)
    np.testing.assert_array_equal(layer.ids, nearest)


def test_normals_face_the_camera_and_follow_the_mesh(renderer: CpuRenderer) -> None:
    X = np.diag((1.0, 0.5, 1.5, 1.0))
    X[:3, 3] = 0.1, 0.2, 3.0
    view = camera()
    i, j = np.meshgrid(np.arange(view.width), np.arange(view.height))
    rays = np.stack(((i + 0.5 - view.cx) / view.fx, (j + 0.5 - view.cy) / view.fy, np.ones(i.shape)), axis=-1)
    for mirror in (1.0, -1.0):
        scene = DrawList((Instance(sphere(400, 200), Material(), X @ np.diag((mirror, 1.0, 1.0, 1.0)), 1, 1),))
        frame = renderer.render(scene, view, GEOMETRY)
        seen = np.isfinite(frame.depth)
        points = rays[seen] * frame.depth[seen][:, None]
        exact = (points - X[:3, 3]) / np.diag(X)[:3] ** 2
        exact /= np.linalg.norm(exact, axis=1, keepdims=True)
        inner = -np.einsum("ij,ij->i", exact, rays[seen]) > 0.1
        assert np.einsum("ij,ij->i", exact, frame.normal[seen])[inner].min() > 0.9995
        assert (frame.normal[~seen] == 0).all()
        np.testing.assert_allclose(np.linalg.norm(frame.normal[seen], axis=1), 1.0, atol=1e-6)


def test_flat_normals_without_mesh_normals(renderer: CpuRenderer) -> None:
    plate = mesh(((-9, -9, 3), (9, -9, 3), (9, 9, 6), (-9, 9, 6)), ((0, 1, 2), (0, 3, 2)))
    frame = renderer.render(draw_list(plate), camera(), Output.NORMAL)
    n = np.cross((1, 0, 0), (0, 18, 3)).astype(float)
    n /= np.linalg.norm(n) * (1 if n[2] < 0 else -1)
    np.testing.assert_allclose(frame.normal[40, 40], n, atol=1e-6)


def test_non_finite_poses_and_positions_draw_nothing(renderer: CpuRenderer) -> None:
    good = mesh(((-1, -1, 3), (1, -1, 3), (0, 1, 3)), ((0, 1, 2),))
    bad = mesh(
        ((np.nan, -1, 3), (1, np.inf, 3), (0, 1, np.nan), (1, 1, 3), (2, 2, -3)), ((0, 1, 2), (0, 3, 4), (1, 3, 4))
    )
    broken = np.eye(4)
    broken[0, 0] = np.nan
    infinite = np.eye(4)
    infinite[2, 3] = np.inf
    huge = np.diag((1e300, 1e300, 1.0, 1.0))
    scene = DrawList(
        (
            Instance(bad, Material(), np.eye(4), 1, 1),
            Instance(good, Material(), broken, 2, 2),
            Instance(good, Material(), infinite, 3, 3),
            Instance(good, Material(), huge, 4, 4),
            Instance(good, Material(), np.eye(4), 5, 5),
        )
    )
    frame = renderer.render(scene, camera(), Output.LABEL)
    assert frame.label is not None
    assert {5, LABEL_NONE} <= set(np.unique(frame.label)) <= {4, 5, LABEL_NONE}


def test_empty_scenes_and_meshes(renderer: CpuRenderer) -> None:
    nothing = mesh(np.zeros((0, 3)), np.zeros((0, 3)))
    for scene in (
        DrawList(),
        draw_list(nothing),
        draw_list(nothing, mesh(np.zeros((1, 3)), np.zeros((0, 1))), nothing),
    ):
        frame = renderer.render(scene, camera(), GEOMETRY)
        assert frame.depth is not None
        assert np.isinf(frame.depth).all()


@pytest.mark.parametrize(
    ("positions", "elements", "message"),
    [
        (((0, 0, 1),) * 3, ((0, 1, 3),), r"index 3 is out of range \(3 vertices\)"),
        (((0, 0),) * 3, ((0, 1, 2),), r"positions must be \(N, 3\)"),
        (((0, 0, 1),) * 3, ((0, 1, 2, 2),), r"elements must be \(M, 1 \| 2 \| 3\)"),
    ],
)
def test_rejects_invalid_meshes(renderer: CpuRenderer, positions: Any, elements: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        renderer.render(draw_list(mesh(positions, elements)), camera(), Output.DEPTH)


def test_rejects_too_large_images(renderer: CpuRenderer) -> None:
    with pytest.raises(ValueError, match="camera size 20000x1 is larger than 16384x16384"):
        renderer.render(DrawList(), camera(20000, 1), Output.DEPTH)
