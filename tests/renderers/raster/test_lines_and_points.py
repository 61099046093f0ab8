"""Lines and points: which pixels they cover, at which depth."""

from typing import Any

import numpy as np
import pytest

from renderers.drawlist import DrawList
from renderers.interface import Output
from renderers.raster import CpuRenderer
from tests.renderers import oracle
from tests.renderers.scenes import camera, draw_list, mesh


@pytest.fixture(scope="module")
def renderer() -> CpuRenderer:
    return CpuRenderer(threads=1)


def depth_of(renderer: CpuRenderer, scene: DrawList, **view: Any) -> np.ndarray:
    frame = renderer.render(scene, camera(**view), Output.DEPTH)
    return frame.depth.copy()


@pytest.mark.parametrize("width", [0.5, 1.0, 2.0, 3.5, 40.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_lines_agree_with_the_oracle(renderer: CpuRenderer, width: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    ends = rng.uniform((-2, -2, -1), (2, 2, 5), size=(60, 3))
    scene = draw_list(mesh(ends, np.arange(60).reshape(-1, 2)), line_width=width)
    expected = oracle.draw(scene, camera())
    depth = depth_of(renderer, scene)
    covered = np.isfinite(depth)
    # The oracle knows no guard band: clipped lines may differ by an edge pixel.
    assert np.count_nonzero(covered != np.isfinite(expected.depth)) <= 1
    seen = renderer.visibility(scene, camera())
    same = (seen.ids == expected.ids) & covered
    assert same.sum() > 0.99 * covered.sum() > 0
    # Where the line ends, rounding the ends to 1/256 px lets a pixel be sampled past them.
    np.testing.assert_allclose(depth[same], expected.depth[same], rtol=2e-6)


def test_a_thin_line_has_one_pixel_per_step_and_joins_its_neighbour(renderer: CpuRenderer) -> None:
    points = ((-0.8, -0.5, 2), (0.1, -0.2, 2), (0.9, 0.35, 2.0), (0.95, 0.36, 2.0))
    scene = draw_list(mesh(points, ((0, 1), (1, 2), (2, 3))))
    covered = np.isfinite(depth_of(renderer, scene))
    view = camera()
    first, last = (view.fx * points[k][0] / 2 + view.cx for k in (0, -1))
    columns = np.arange(view.width) + 0.5
    assert np.array_equal(covered.sum(axis=0), ((columns >= first) & (columns < last)).astype(int))


@pytest.mark.parametrize("size", [1.0, 2.0, 3.0, 7.0])
def test_points_agree_with_the_oracle(renderer: CpuRenderer, size: float) -> None:
    rng = np.random.default_rng(3)
    cloud = mesh(rng.uniform((-3, -3, -1), (3, 3, 5), size=(300, 3)), np.arange(300)[:, None])
    scene = draw_list(cloud, point_size=size)
    expected = oracle.draw(scene, camera())
    seen = renderer.visibility(scene, camera())
    assert np.array_equal(seen.ids, expected.ids)
    np.testing.assert_allclose(depth_of(renderer, scene), expected.depth, rtol=2e-7)


def test_near_and_far_remove_points_and_parts_of_lines(renderer: CpuRenderer) -> None:
    cloud = mesh(((0, 0, 0.05), (0.1, 0, 0.2), (0, 0.5, 5), (0, 1, 11), (0, 0, -1)), np.arange(5)[:, None])
    assert np.isfinite(depth_of(renderer, draw_list(cloud, point_size=2))).sum() == 8
    ray = mesh(((0, 0.05, -5), (0, 0.05, 50)), ((0, 1),))
    seen = depth_of(renderer, draw_list(ray))
    finite = seen[np.isfinite(seen)]
    assert finite.size > 10
    assert finite.min() >= 0.1 * (1 - 1e-6)
    assert finite.max() <= 10.0


def test_line_and_point_sizes_are_clamped(renderer: CpuRenderer) -> None:
    for size in (0.0, -4.0, float("nan"), 1e30, float("inf")):
        scene = draw_list(
            mesh(((0, 0, 2),), ((0,),)), mesh(((-1, 0, 2), (1, 0, 2)), ((0, 1),)), point_size=size, line_width=size
        )
        assert np.isfinite(depth_of(renderer, scene)).any()
