"""A stopped frame ends soon, is never returned, and does not affect later frames."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from renderers.drawlist import AlphaMode, DrawList, Image, Instance, Material, Mesh, Texture
from renderers.encode import png_rgb
from renderers.fxaa import fxaa
from renderers.images import decode_image
from renderers.interface import Look, LookName, Output
from renderers.raster import CpuRenderer
from renderers.raster.frame_threads import FrameThreads
from renderers.shading.mikktspace import corner_tangents
from renderers.shading.mipmaps import make_chain
from renderers.stop import StopFlag, check_stop, current_stop, run_within
from tests.renderers import scenes
from tests.support.slow import covering
from tests.support.waiting import SECONDS


class Enough(Exception):
    pass


@contextmanager
def soon(seconds: float = 0.1) -> Iterator[StopFlag]:
    """A flag that is set while what it is for is under way."""
    flag = StopFlag()
    timer = threading.Timer(seconds, flag.set, (Enough("enough"),))
    timer.start()
    yield flag
    timer.cancel()


def endless(triangles: int = 10_000, instances: int = 200, **material: object) -> DrawList:
    """A scene that takes minutes at 1024 x 1024."""
    positions = covering(triangles)[:, [0, 1, 2]] * np.array([1, -1, -1], np.float32)
    mesh = Mesh(np.ascontiguousarray(positions), np.arange(3 * triangles, dtype=np.uint32).reshape(-1, 3))
    shown = Material(double_sided=True, **material)  # type: ignore[arg-type]  # by name
    return DrawList(tuple(Instance(mesh, shown, np.eye(4)) for _ in range(instances)))


def test_the_first_error_counts_and_is_raised_anew_each_time() -> None:
    flag = StopFlag()
    flag.check()
    was_set = flag.is_set
    flag.set(Enough("one"))
    assert (was_set, flag.is_set) == (False, True)
    flag.set(ValueError("two"))
    found = []
    for _ in range(2):
        with pytest.raises(Enough, match="one") as caught:
            flag.run(check_stop)
        found.append(caught.value)
    assert found[0] is not found[1]
    check_stop()  # that of this test is another one


def test_flags_nest_and_do_not_leak() -> None:
    outer, inner = StopFlag(), StopFlag()
    before = current_stop()
    assert outer.run(lambda: (current_stop(), inner.run(current_stop), current_stop())) == (outer, inner, outer)
    with pytest.raises(ZeroDivisionError):
        outer.run(lambda: 1 // 0)
    assert current_stop() is before


def test_a_time_limit_sets_the_flag() -> None:
    def work() -> None:
        while True:
            check_stop()

    with pytest.raises(Enough, match="too slow"):
        run_within(0.05, work, Enough("too slow"))
    assert run_within(60.0, lambda: 5, Enough()) == 5
    assert run_within(0.0, lambda: 6, Enough()) == 6


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize(
    "outputs", [Output.DEPTH | Output.LABEL | Output.NORMAL, Output.COLOR, Output.COLOR | Output.DEPTH]
)
@pytest.mark.parametrize(("name", "samples"), [("phong", 1), ("pbr", 8), ("studio", 1), ("studio", 4)])
def test_setting_the_flag_ends_a_frame(threads: int, outputs: Output, name: LookName, samples: int) -> None:
    renderer = CpuRenderer(threads)
    look = Look(name, samples=samples)  # type: ignore[arg-type]  # 1, 4 or 8
    with soon() as flag, pytest.raises(Enough):
        flag.run(lambda: renderer.render(endless(), scenes.camera(1024, 1024), outputs, look))
    scene, camera = DrawList(endless(50, 1).instances), scenes.camera(97, 71)
    drawn = renderer.render(scene, camera, outputs, look)
    other = CpuRenderer(1).render(scene, camera, outputs, look)
    for array, expected in ((drawn.color, other.color), (drawn.depth, other.depth), (drawn.label, other.label)):
        assert array is None if expected is None else np.array_equal(array, expected)
    renderer.close()


@pytest.mark.parametrize(("name", "samples"), [("phong", 1), ("pbr", 4), ("studio", 1)])
def test_setting_the_flag_ends_depth_peeling(name: LookName, samples: int) -> None:
    renderer, look = CpuRenderer(2), Look(name, samples=samples)  # type: ignore[arg-type]  # 1, 4 or 8
    scene = endless(alpha_mode=AlphaMode.BLEND, base_color=(1.0, 0.0, 0.0, 0.1))
    with soon() as flag, pytest.raises(Enough):
        flag.run(lambda: renderer.render(scene, scenes.camera(1024, 1024), Output.COLOR, look))
    renderer.close()


def test_repeated_frames_use_their_own_flag() -> None:
    """Tables of a frame are reused for the next one, which must not keep the old flag."""
    renderer, scene, look = CpuRenderer(1), endless(50, 3), Look("phong")
    camera = scenes.camera(97, 71)
    frame = renderer.render(scene, camera, Output.COLOR, look)
    expected = frame.color.copy()
    flag = StopFlag()
    flag.set(Enough())
    with pytest.raises(Enough):
        flag.run(lambda: renderer.render(scene, camera, Output.COLOR, look))
    frame = renderer.render(scene, camera, Output.COLOR, look)
    assert frame.color is not None
    assert np.array_equal(frame.color, expected)


@pytest.mark.parametrize("name", ["phong", "pbr", "studio"])
def test_incomplete_preparation_is_not_cached(name: LookName) -> None:
    """The flag is set while the second of three textures is decoded: tables must not be kept without the others."""
    flag = StopFlag()
    number = 0

    def image(value: int) -> Image:
        def decode() -> NDArray[np.uint8]:
            nonlocal number
            number += 1
            if number == 2:
                flag.set(Enough())
            return np.full((4, 4, 4), (value, 0, 0, 255), np.uint8)

        return Image(bytes([value]), decode)

    def scene(images: list[Image]) -> DrawList:
        mesh = replace(scenes.grid(2, 2, [(-1, -1, 2), (1, -1, 2), (1, 1, 2), (-1, 1, 2)]))
        mesh = replace(
            mesh, uv0=np.zeros((len(mesh.positions), 2), np.float32), normals=np.zeros_like(mesh.positions) - 1
        )
        return DrawList(
            tuple(
                Instance(mesh, Material(base_color_texture=Texture(each), double_sided=True), np.eye(4))
                for each in images
            ),
            tuple(images),
        )

    images = [image(value) for value in (50, 100, 150)]
    drawn, camera, renderer = scene(images), scenes.camera(32, 32), CpuRenderer(1)
    with pytest.raises(Enough):
        flag.run(lambda: renderer.render(drawn, camera, Output.COLOR, Look(name)))
    frame = renderer.render(drawn, camera, Output.COLOR, Look(name))
    assert frame.color is not None
    other = CpuRenderer(1).render(scene([image(v) for v in (50, 100, 150)]), camera, Output.COLOR, Look(name))
    assert np.array_equal(frame.color, other.color)


def test_units_of_work_run_under_the_callers_flag_in_every_thread() -> None:
    crew, flag, seen = FrameThreads(3), StopFlag(), set[StopFlag]()
    meeting = threading.Barrier(3)

    def work(_: int) -> None:
        seen.add(current_stop())
        meeting.wait(SECONDS)

    flag.run(lambda: crew.run(3, work))
    assert seen == {flag}
    flag.set(Enough())
    with pytest.raises(Enough):
        flag.run(lambda: crew.run(3, work))
    crew.close()


_MESH = scenes.sphere(20, 20)
_UV = np.zeros((len(_MESH.positions), 2), np.float32)
STEPS: dict[str, Callable[[], object]] = {
    "fxaa": lambda: fxaa(np.zeros((8, 8, 3), np.uint8)),
    "mip levels": lambda: list(make_chain(np.zeros((8, 8, 4), np.uint8), (8, 8), True)),
    "tangents": lambda: corner_tangents(_MESH.positions, _MESH.positions, _UV, _MESH.elements),
    "an image": lambda: decode_image(png_rgb(np.zeros((8, 8, 3), np.uint8))),
    "preparing a mesh": lambda: CpuRenderer(1).render(
        scenes.draw_list(scenes.sphere(20, 20)), scenes.camera(), Output.DEPTH
    ),
}


@pytest.mark.parametrize("step", STEPS)
def test_long_steps_check_the_flag(step: str) -> None:
    STEPS[step]()
    flag = StopFlag()
    flag.set(Enough())
    with pytest.raises(Enough):
        flag.run(STEPS[step])
