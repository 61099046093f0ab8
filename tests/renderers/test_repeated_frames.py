"""Frames that follow each other on one renderer, of the same scene or of others; and pictures of any height."""

import gc
import itertools
import weakref
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import DrawList, Instance, Material
from renderers.interface import Frame, Look, LookName, Output, SampleCount
from renderers.raster import CpuRenderer
from tests.renderers.scenes import pose, sphere
from tests.renderers.shading.test_pixels import random_scene

ALL = Output.COLOR | Output.DEPTH | Output.LABEL
LOOKS: tuple[LookName, ...] = ("phong", "gltf", "studio")
SAMPLES: tuple[SampleCount, ...] = (1, 4, 8)
CAMERA = Camera(160, 100, 140.0, 140.0, 80.3, 50.0, 0.05, 50.0, np.eye(4))


@pytest.fixture
def renderer() -> Iterator[CpuRenderer]:
    each = CpuRenderer(2)
    yield each
    each.close()


def _taken(frame: Frame) -> tuple[NDArray[np.generic], ...]:
    """Return the images of a frame."""
    return tuple(image for image in (frame.color, frame.depth, frame.label) if image is not None)


def _fresh(drawn: DrawList, camera: Camera, outputs: Output, look: Look) -> tuple[NDArray[np.generic], ...]:
    """Render with a new renderer."""
    own = CpuRenderer(1)
    pictures = _taken(own.render(drawn, camera, outputs, look))
    own.close()
    return pictures


def _at(z: float) -> Camera:
    X = np.eye(4)
    X[:3, 3] = 0.02, -0.03, z
    return replace(CAMERA, X_world_camera=X)


def test_frames_do_not_depend_on_earlier_frames(renderer: CpuRenderer) -> None:
    drawn, other = random_scene(np.random.default_rng(7)), random_scene(np.random.default_rng(8))
    looks = Look("phong"), Look("pbr"), Look("phong", background=(1, 2, 3)), Look("phong", samples=4)
    wide = replace(CAMERA, width=203, cx=100.0)
    near = replace(CAMERA, near=2.5)
    for turn, camera in enumerate((_at(0.0), _at(0.1), wide, _at(0.2), near, _at(-0.3))):
        for which in (drawn, other, drawn):
            for outputs in (ALL, Output.COLOR):
                look = looks[(turn + (which is other)) % len(looks)]
                expected = _fresh(which, camera, outputs, look)
                for got, wanted in zip(_taken(renderer.render(which, camera, outputs, look)), expected, strict=True):
                    np.testing.assert_array_equal(got, wanted)


def test_a_frame_keeps_no_scene_alive(renderer: CpuRenderer) -> None:
    drawn = random_scene(np.random.default_rng(7))
    for _ in range(2):
        renderer.render(drawn, CAMERA, ALL)
    mesh = weakref.ref(drawn.instances[0].mesh)
    del drawn
    gc.collect()
    assert mesh() is None


def test_memory_of_a_frame_does_not_wait_for_the_garbage_collector(renderer: CpuRenderer) -> None:
    """Freed at once, it is in use again for the next frame; otherwise each frame takes new pages from the system."""
    gc.collect()
    gc.disable()
    gc.set_debug(gc.DEBUG_SAVEALL)
    try:
        for opacity in (1.0, 0.5):
            ball = Instance(sphere(24, 12), Material((0.4, 0.5, 0.6, opacity)), pose(np.random.default_rng(4)))
            for name, samples in itertools.product(LOOKS, SAMPLES):
                renderer.render(DrawList((ball,)), CAMERA, ALL, Look(name, samples=samples))
        gc.collect()
        in_cycles = [type(each).__name__ for each in gc.garbage if type(each).__module__.startswith("renderers.")]
    finally:
        gc.set_debug(0)
        gc.garbage.clear()
        gc.enable()
    assert in_cycles == []


@pytest.mark.parametrize("triangles", [(200, 150), (24, 12)], ids=["tiny", "small"])
def test_last_rows_equal_those_of_a_taller_image(triangles: tuple[int, int], renderer: CpuRenderer) -> None:
    """The last band may have fewer rows."""
    rng = np.random.default_rng(4)
    fronts = Material((0.4, 0.5, 0.6, 1.0))
    balls = [Instance(sphere(*triangles), fronts, pose(rng, z=3.0, scale=0.9), k, k) for k in range(4)]
    drawn = DrawList((*balls, Instance(sphere(6, 4), fronts, pose(rng, z=1.2, scale=1.5), 9, 9)))
    high = _taken(renderer.render(drawn, replace(CAMERA, height=160), ALL))
    seen = 0
    for height in (1, 15, 16, 17, 31, 32, 33, 48, 63, 64, 65, 80, 81, 96, 97, 113, 159):
        color, depth, label = _taken(renderer.render(drawn, replace(CAMERA, height=height), ALL))
        np.testing.assert_array_equal(depth, high[1][:height])
        np.testing.assert_array_equal(label, high[2][:height])
        # Shading remembers within a unit of work what it found at a triangle's first pixel.
        assert np.abs(color.astype(int) - high[0][:height].astype(int)).max() <= 1
        seen += np.isfinite(depth[-1].astype(float)).any()
    assert seen > 10
