"""Arbitrary coordinates and matrices: no crash, no out-of-bounds access, valid images."""

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from renderers.camera import Camera
from renderers.drawlist import DrawList, Instance, Material, Mesh
from renderers.interface import Output
from renderers.raster import CpuRenderer
from tests.renderers.scenes import pose, soup

RENDERER = CpuRenderer(threads=1)
LARGE = (0.0, 1.0, -1.0, 1e-3, 0.5, 3.0, 1e-30, 1e-45, 1e9, -1e9, 1e20, 3e38, -3e38, float("inf"), float("nan"))
number = st.one_of(st.sampled_from(LARGE), st.floats(width=32), st.floats(-3.0, 3.0, width=32))
positive = st.one_of(st.sampled_from((1e-300, 1e-30, 1e-3, 1.0, 40.0, 1e6, 1e30, 1e300)), st.floats(1e-2, 100.0))
centre = st.one_of(st.sampled_from((0.0, 16.0, -1e9, 1e9, 1e300, -1e300)), st.floats(-64.0, 64.0))


@settings(deadline=None, max_examples=150)
@given(
    st.lists(number, min_size=9, max_size=30),
    st.lists(number, min_size=12, max_size=12),
    st.tuples(positive, positive, centre, centre),
    st.sampled_from(((1, 1), (7, 3), (8, 40), (33, 65))),
    st.sampled_from(((1e-300, 1e300), (1e-3, 1e3), (0.1, float("inf")), (1.0, 1.0000001), (1e30, 1e31))),
)
@example([0.0] * 9, [1.0] * 12, (1.0, 1.0, 0.0, 0.0), (8, 40), (0.1, float("inf")))
def test_arbitrary_numbers_do_not_crash(
    coordinates: list[float],
    matrix: list[float],
    lens: tuple[float, float, float, float],
    size: tuple[int, int],
    planes: tuple[float, float],
) -> None:
    points = np.array(coordinates[: len(coordinates) // 3 * 3], np.float32).reshape(-1, 3)
    order = np.arange(len(points), dtype=np.uint32)
    moved = np.eye(4)
    moved[:3] = np.array(matrix).reshape(3, 4)
    meshes = (
        Mesh(points, np.stack((order, np.roll(order, 1), np.roll(order, 2)), axis=1).copy()),
        Mesh(points, np.stack((order, np.roll(order, 1)), axis=1).copy()),
        Mesh(points, order[:, None].copy()),
    )
    look = Material(point_size=3.0, line_width=2.5)
    scene = DrawList(tuple(Instance(m, look, X, 5, k) for k, m in enumerate(meshes) for X in (np.eye(4), moved)))
    camera = Camera(*size, *lens, *planes, np.eye(4))
    outputs = Output.DEPTH | Output.LABEL | Output.INSTANCE | Output.NORMAL
    frame = RENDERER.render(scene, camera, outputs)
    seen = RENDERER.visibility(scene, camera)
    assert frame.label is not None
    assert frame.normal is not None
    hit = seen.ids >= 0
    assert seen.ids.max() < seen.first_ids[-1]
    assert np.array_equal(frame.label == 5, hit)
    assert np.isin(frame.instance, (-1, 0, 1, 2)).all()
    assert np.array_equal(frame.instance >= 0, hit)
    assert not np.isnan(frame.depth).any()
    assert np.isinf(frame.depth[~hit]).all()
    assert np.isfinite(frame.normal).all()
    behind = RENDERER.visibility(scene, camera, behind=seen)
    assert (behind.inv_z[behind.ids >= 0] <= seen.inv_z[behind.ids >= 0]).all()


def test_a_million_triangles_and_a_large_picture() -> None:
    rng = np.random.default_rng(0)
    scene = DrawList(
        (Instance(soup(rng, 1_000_000, size=0.003, low=(-2, -2, 1), high=(2, 2, 5)), Material(), np.eye(4), 1, 1),)
    )
    camera = Camera(4096, 4096, 3000.0, 3000.0, 2048.0, 2048.0, 0.1, 10.0, np.eye(4))
    renderer = CpuRenderer(threads=2)
    frame = renderer.render(scene, camera, Output.DEPTH | Output.LABEL)
    assert frame.depth is not None
    assert 0.05 < np.isfinite(frame.depth).mean() < 1.0
    renderer.close()


def test_two_thousand_instances_of_one_mesh() -> None:
    rng = np.random.default_rng(0)
    part = soup(rng, 30, size=0.05, low=(-0.05, -0.05, -0.05), high=(0.05, 0.05, 0.05))
    instances = []
    for k in range(2000):
        X = pose(rng)
        X[:3, 3] = rng.uniform((-3, -3, 2), (3, 3, 9))
        instances.append(Instance(part, Material(), X, k, k))
    camera = Camera(320, 240, 300.0, 300.0, 160.0, 120.0, 0.1, 20.0, np.eye(4))
    frame = RENDERER.render(DrawList(tuple(instances)), camera, Output.LABEL | Output.INSTANCE)
    shown = frame.instance >= 0
    assert np.array_equal(frame.label[shown], frame.instance[shown])
    assert len(np.unique(frame.instance)) > 500
