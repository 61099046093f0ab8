"""Multisampling: each sample equals the pixel of an image with a shifted principal point."""

import weakref
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import DrawList, Instance, Material, Mesh
from renderers.interface import Look, Output
from renderers.msaa import sample_cameras, sample_offsets
from renderers.raster import CpuRenderer
from renderers.raster import frame as cpu_frame
from renderers.raster import renderer as cpu_renderer
from renderers.raster.frame_phases import run_phases
from renderers.raster.msaa.resolve import mixing_shader
from tests.renderers.scenes import camera, grid, mesh, pose, soup, sphere

BACKGROUND = (10, 200, 90)


def color(renderer: CpuRenderer, scene: DrawList, view: Camera, name: Any, samples: Any = 1) -> NDArray[np.float64]:
    frame = renderer.render(scene, view, Output.COLOR, Look(name, BACKGROUND, samples))
    return frame.color.astype(np.float64)


def unlit(*meshes: Mesh, **material: Any) -> DrawList:
    """Each in a colour of its own, wherever it is seen."""
    rng = np.random.default_rng(5)
    return DrawList(
        tuple(Instance(m, Material((*rng.uniform(0, 1, 3), 1.0), unlit=True, **material), np.eye(4)) for m in meshes)
    )


def _scenes() -> dict[str, DrawList]:
    rng = np.random.default_rng(7)
    low, high = (-1.5, -1.2, 1.0), (1.5, 1.2, 4.0)
    points = rng.uniform(low, high, (40, 3))
    strokes = [mesh(points, np.arange(40).reshape(-1, 2)), mesh(points + 0.1, np.arange(40).reshape(-1, 1))]
    return {
        "tiny triangles": unlit(*(soup(rng, 300, size=0.01, low=low, high=high) for _ in range(3))),
        "small triangles": unlit(*(soup(rng, 60, size=0.1, low=low, high=high) for _ in range(5)), double_sided=True),
        "large triangles": unlit(*(soup(rng, 4, size=1.0, low=low, high=high) for _ in range(5)), double_sided=True),
        "through the near plane": unlit(
            *(soup(rng, 4, size=2.0, low=(-1, -1, -1), high=(1, 1, 1)) for _ in range(4)), double_sided=True
        ),
        "lines and points": DrawList(
            tuple(
                Instance(m, Material((*rng.uniform(0, 1, 3), 1.0), point_size=size, line_width=size), np.eye(4))
                for size, m in zip((1.0, 5.0, 2.5, 8.0), (*strokes, *strokes[::-1]), strict=True)
            )
        ),
        "cloud": unlit(mesh(rng.uniform(low, high, (4000, 3)), np.arange(4000).reshape(-1, 1)), point_size=3.0),
        "surfaces": DrawList(
            (
                Instance(sphere(24, 12), Material((0.9, 0.1, 0.3, 1.0), unlit=True), pose(rng, z=3.0)),
                Instance(
                    grid(5, 4, [(-3, -3, 3.2), (3, -3, 2.6), (3, 3, 2.4), (-1, 3, 3.1)]),
                    Material((0.2, 0.9, 0.7, 1.0), unlit=True, double_sided=True),
                    np.eye(4),
                ),
            )
        ),
    }


@pytest.mark.parametrize("samples", [4, 8])
@pytest.mark.parametrize("name", list(_scenes()))
def test_samples_equal_separate_images(renderer: CpuRenderer, name: str, samples: int) -> None:
    """Vertices are rounded to 1/256 pixel before the sample offsets are added, in separate images after: few samples
    within 1/256 pixel of an edge may differ."""
    scene, view = _scenes()[name], camera()
    each = [color(renderer, scene, c, "phong") for c in sample_cameras(view, samples)]
    got = color(renderer, scene, view, "phong", samples)
    assert np.abs(each[0] - each[1]).max() > 20
    wrong = np.abs(got - np.mean(each, axis=0)).max(axis=-1) > 0.501
    assert wrong.mean() < 2e-3


@pytest.mark.parametrize("look", ["phong", "pbr"])
def test_smooth_surfaces_are_shaded_once(renderer: CpuRenderer, look: str) -> None:
    """Pixels in which triangles of a smooth mesh meet look like those beside them; creases and outlines are mixed."""
    view = camera(160, 120)
    X = np.eye(4)
    X[2, 3] = 3.0
    for smooth in (True, False):
        ball = DrawList((Instance(sphere(40, 20, smooth=smooth), Material((0.8, 0.6, 0.9, 1.0)), X),))
        mean = np.mean([color(renderer, ball, c, look) for c in sample_cameras(view, 8)], axis=0)
        wrong = np.abs(color(renderer, ball, view, look, 8) - mean).max(axis=-1)
        assert wrong.mean() < 0.5
        assert (wrong > 6).mean() < 0.004


def test_pixels_with_many_triangles_and_mirrored_poses(renderer: CpuRenderer) -> None:
    """Pixels that see many triangles, in poses that mirror; odd widths."""
    rng = np.random.default_rng(11)
    scene = DrawList(
        tuple(
            Instance(soup(rng, 2000, size=0.02, low=(-1, -1, -1), high=(1, 1, 1)), Material((*c, 1.0), unlit=True), X)
            for c, X in ((rng.uniform(0, 1, 3), pose(rng, z=2.5)) for _ in range(3))
        )
    )
    view = camera(43, 35)
    mean = np.mean([color(renderer, scene, c, "phong") for c in sample_cameras(view, 8)], axis=0)
    assert (np.abs(color(renderer, scene, view, "phong", 8) - mean).max(axis=-1) > 0.501).mean() < 0.02


def test_thread_count_and_repetition_do_not_change_the_image() -> None:
    scene, view = _scenes()["surfaces"], camera(400, 301)
    pictures = []
    for threads in (1, 3):
        renderer = CpuRenderer(threads)
        pictures += [color(renderer, scene, view, "pbr", 8) for _ in range(3)]
        renderer.close()
    assert all(np.array_equal(pictures[0], other) for other in pictures)


@pytest.mark.parametrize("samples", [4, 8])
def test_equal_depth_shows_the_last_primitive(renderer: CpuRenderer, samples: int) -> None:
    """Regardless of the drawing order: large triangles are drawn after small ones."""
    wall = grid(1, 1, [(-3, -3, 2.0), (3, -3, 2.0), (3, 3, 2.0), (-3, 3, 2.0)])
    rng = np.random.default_rng(3)
    points = rng.uniform(-1, 1, (200, 1, 3)) + rng.normal(scale=0.05, size=(200, 3, 3))
    points[:, :, 2] = 2.0
    small = mesh(points.reshape(-1, 3), np.arange(600).reshape(-1, 3))
    view = camera(333, 217)
    nothing = mesh(np.zeros((3, 3)), np.zeros((0, 3)))  # its place decides the other's colour
    only_wall = color(renderer, unlit(nothing, wall, double_sided=True), view, "phong", samples)
    assert np.array_equal(color(renderer, unlit(small, wall, double_sided=True), view, "phong", samples), only_wall)
    # In the colour of the second mesh: wherever small triangles cover all samples.
    only_small = color(renderer, unlit(nothing, small, double_sided=True), view, "phong", samples)
    covered = (only_small == only_wall[108, 160]).all(-1)
    assert 1000 < covered.sum() < covered.size / 2
    both = color(renderer, unlit(wall, small, double_sided=True), view, "phong", samples)
    assert (both[covered] == only_wall[108, 160]).all()


def test_memory_read_by_kernels_outlives_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """The task holds addresses only."""
    made: list[weakref.ref[NDArray[np.int64]]] = []
    alive: list[bool] = []

    def remember(*arguments: Any) -> Any:
        shader: Any = mixing_shader(*arguments)
        made.append(weakref.ref(shader.keep[0]))
        return shader

    def check_and_run(address: int, until_finished: bool) -> None:
        alive.append(made[-1]() is not None)
        if alive[-1]:
            run_phases(address, until_finished)

    monkeypatch.setattr(cpu_renderer, "mixing_shader", remember)
    monkeypatch.setattr(cpu_frame, "run_phases", check_and_run)
    renderer = CpuRenderer(1)
    color(renderer, _scenes()["surfaces"], camera(), "phong", 8)
    renderer.close()
    assert alive == [True]


def test_sample_offsets() -> None:
    view = camera()
    for samples in (4, 8):
        cameras = sample_cameras(view, samples)
        for k, (x, y) in enumerate(sample_offsets(samples).T):
            one = cameras[k % samples]
            assert (view.cx - one.cx, view.cy - one.cy) == pytest.approx((x / 256, y / 256))
    with pytest.raises(ValueError, match="samples must be 4 or 8, not 1"):
        sample_offsets(1)
