"""Helper threads, array pools, and tables that are collected with their scene."""

from __future__ import annotations

import gc
import os
import threading
import weakref
from collections.abc import Callable

import numpy as np
import pytest

from renderers.drawlist import DrawList
from renderers.interface import Output
from renderers.raster import CpuRenderer, buffer_pool
from renderers.raster.buffer_pool import ArrayPool, ArrayShapes, Scratch, ScratchPool
from renderers.raster.frame_threads import FrameThreads
from renderers.raster.scene import prepare
from tests.renderers.scenes import camera, draw_list, images, mesh, sphere
from tests.support.waiting import SECONDS


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_every_unit_runs_once_and_before_the_call_returns(threads: int) -> None:
    crew = FrameThreads(threads)
    for _ in range(20):
        for units in (7, 0, 13, 1):
            done: list[int] = []
            crew.run(units, done.append)
            assert sorted(done) == [*range(units)]
    crew.close()


def test_helpers_work_at_the_same_time() -> None:
    crew = FrameThreads(3)
    meeting = threading.Barrier(3)
    crew.run(3, lambda _: meeting.wait(timeout=SECONDS))
    crew.close()


def test_callers_count_as_threads() -> None:
    """With as many callers as threads, no helper runs."""
    crew = FrameThreads(2)
    with crew, crew:
        seen: set[int] = set()
        crew.run(50, lambda _: seen.add(threading.get_ident()))
        assert seen == {threading.get_ident()}
    crew.close()


def test_helpers_run_only_on_idle_processors() -> None:
    spare = 0
    crew = FrameThreads(3, lambda: spare)
    seen: set[int] = set()
    crew.run(50, lambda _: seen.add(threading.get_ident()))
    assert seen == {threading.get_ident()}
    spare = 1
    meeting = threading.Barrier(2)
    crew.run(2, lambda _: meeting.wait(timeout=SECONDS))
    crew.close()


@pytest.mark.parametrize("threads", [1, 3])
def test_an_error_reaches_the_caller_and_skips_the_remaining_units(threads: int) -> None:
    crew = FrameThreads(threads)
    started: list[int] = []

    def fail(unit: int) -> None:
        started.append(unit)
        if unit == 2:
            raise ArithmeticError("unit 2")

    with pytest.raises(ArithmeticError, match="unit 2"):
        crew.run(5000, fail)
    assert {0, 1, 2} <= set(started)
    assert len(started) < 5000
    done: list[int] = []
    crew.run(2, done.append)
    assert sorted(done) == [0, 1]
    crew.close()


def test_an_interrupted_caller_still_completes_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    crew = FrameThreads(3)
    jobs, done = crew._jobs, list[int]()  # noqa: SLF001 - the interrupt is to come between two of its puts
    crew.run(3, lambda _: None)  # starts the helpers

    class Interrupted:
        def put(self, work: Callable[[], object]) -> None:
            jobs.put(work)
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(crew, "_jobs", Interrupted())
        with pytest.raises(KeyboardInterrupt):
            crew.run(50, done.append)
    assert sorted(done) == [*range(50)]
    crew.close()


def test_rejects_zero_threads() -> None:
    with pytest.raises(ValueError, match="threads must be at least 1, got 0"):
        CpuRenderer(threads=0)


def test_arrays_of_closed_frames_are_reused() -> None:
    renderer = CpuRenderer(1)
    scene = draw_list(sphere(8, 4))
    first = renderer.render(scene, camera(), Output.DEPTH)
    array = first.depth
    second = renderer.render(scene, camera(), Output.DEPTH)
    assert second.depth is not array
    first.close()
    first.close()
    assert first.depth is None
    third = renderer.render(scene, camera(), Output.DEPTH)
    fourth = renderer.render(scene, camera(), Output.DEPTH)
    assert third.depth is array
    assert fourth.depth is not array
    for frame in (second, third, fourth):
        frame.close()


def test_reused_arrays_are_overwritten() -> None:
    renderer = CpuRenderer(1)
    full = draw_list(mesh(((-9, -9, 2), (9, -9, 2), (0, 9, 2)), ((0, 1, 2),)))
    with renderer.render(full, camera(), Output.DEPTH | Output.LABEL | Output.INSTANCE | Output.NORMAL) as frame:
        assert frame.depth is not None
    with renderer.render(DrawList(), camera(), Output.DEPTH | Output.LABEL | Output.INSTANCE | Output.NORMAL) as frame:
        empty = images(frame)
        assert np.isinf(empty["depth"]).all()
        assert (empty["label"] == 0xFFFFFF).all()
        assert (empty["instance"] == -1).all()
        assert (empty["normal"] == 0).all()


def test_pool_size_is_limited() -> None:
    pool = ArrayPool(max_bytes=1000)
    few, more, many = ((((count,), np.float32),) for count in (100, 200, 500))
    first, second = pool.take(few), pool.take(more)
    pool.give(first)
    pool.give(second)
    assert pool.take(few) is not first
    assert pool.take(more) is second
    huge = pool.take(many)
    pool.give(huge)
    assert pool.take(many) is not huge


def test_pool_forgets_shapes_without_free_arrays() -> None:
    """Clients choose image sizes, so that shapes must not accumulate."""
    pool = ArrayPool()
    for width in range(1, 50):
        kinds: ArrayShapes = (((width,), np.float32), ((width, 3), np.uint8))
        pool.give(pool.take(kinds))
        pool.take(kinds)
    assert not pool._free  # noqa: SLF001 - memory of forgotten shapes shows nowhere else


def test_scratch_grows_and_large_scratch_is_dropped() -> None:
    pool = ScratchPool(max_bytes=1000)
    scratch = pool.take()
    small, address = scratch.take("x", 10, np.float32)
    assert address == small.ctypes.data
    assert scratch.take("x", 5, np.float32)[0] is small
    assert scratch.take("x", 100, np.float32)[0].size >= 100
    assert scratch.nbytes == scratch.take("x", 100, np.float32)[0].nbytes
    pool.give(scratch)
    assert pool.take() is scratch
    scratch.take("x", 10_000, np.float32)
    pool.give(scratch)
    assert pool.take() is not scratch


def test_scratch_drops_an_array_before_it_allocates_a_larger_one(monkeypatch: pytest.MonkeyPatch) -> None:
    scratch = Scratch()
    scratch.take("x", 100, np.float32)

    def no_memory(*_: object) -> None:
        raise MemoryError

    with monkeypatch.context() as patched:
        patched.setattr(buffer_pool, "aligned", no_memory)
        with pytest.raises(MemoryError):
            scratch.take("x", 10_000, np.float32)
    assert scratch.nbytes == 0
    assert scratch.take("x", 100, np.float32)[0].size >= 100


def test_tables_count_as_scratch() -> None:
    scratch = Scratch()
    scratch.table("x", 1000)
    assert scratch.nbytes == 8000
    scratch.table("x", 10)
    assert scratch.nbytes == 8000
    scratch.table("x", 3000)
    assert scratch.nbytes == 24_000


def test_concurrent_frames() -> None:
    """Concurrent callers of one renderer get the images that they get alone."""
    renderer = CpuRenderer(2)
    scene = draw_list(sphere(60, 30, 2.5), mesh(((-1, -1, 2), (1, -1, 2), (0, 1, 2)), ((0, 1, 2),)))
    views = [camera(200 + 10 * k, 150) for k in range(4)]
    expected = []
    for view in views:
        with renderer.render(scene, view, Output.DEPTH) as frame:
            assert frame.depth is not None
            expected.append(frame.depth.copy())
    wrong: list[int] = []

    def work(k: int) -> None:
        for _ in range(20):
            with renderer.render(scene, views[k], Output.DEPTH) as frame:
                if frame.depth is None or not np.array_equal(frame.depth, expected[k]):
                    wrong.append(k)

    threads = [threading.Thread(target=work, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []
    renderer.close()


def test_tables_are_prepared_once_and_collected_with_their_scene() -> None:
    scene = draw_list(sphere(8, 4), sphere(6, 4))
    table = prepare(scene)
    assert prepare(scene) is table
    meshes = [weakref.ref(i.mesh) for i in scene.instances]
    gc.collect()
    poses = weakref.ref(table.X_world_mesh)
    del scene, table
    gc.collect()
    prepare(DrawList())  # entries of collected scenes are dropped at the next look-up
    assert poses() is None
    assert [m() for m in meshes] == [None, None]


def test_primitives_that_share_a_long_vertex_array_transform_only_their_own() -> None:
    points = np.random.default_rng(0).uniform((-1, -1, 2), (1, 1, 4), size=(5000, 3)).astype(np.float32)
    elements = np.array(((4000, 10, 20), (30, 4000, 4999)), dtype=np.uint32)
    shared = draw_list(mesh(points, elements))
    assert prepare(shared).instances.structure.instances["first_vertex"][1] == 5
    own = draw_list(mesh(points[elements.ravel()], np.arange(6).reshape(2, 3)))
    renderer = CpuRenderer(1)
    outputs = Output.DEPTH | Output.NORMAL
    with renderer.render(shared, camera(), outputs) as a, renderer.render(own, camera(), outputs) as b:
        for name, image in images(a).items():
            np.testing.assert_array_equal(image, images(b)[name], err_msg=name)


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="threads cannot be placed here")
def test_helpers_run_on_another_processor_than_the_caller() -> None:
    allowed = os.sched_getaffinity(0)
    if len(allowed) < 2:
        pytest.skip("there is one processor")
    here = min(allowed)
    crew, taken = FrameThreads(2), threading.Barrier(2)
    places: dict[int, set[int]] = {}

    def note(_: int) -> None:
        places[threading.get_ident()] = os.sched_getaffinity(0)
        taken.wait()

    try:
        os.sched_setaffinity(0, {here})
        with crew:
            crew.run(2, note)
        assert places.pop(threading.get_ident()) == {here}
        os.sched_setaffinity(0, allowed)
        places.clear()
        with crew:
            crew.run(2, note)
        assert places.pop(threading.get_ident()) == allowed
        (helper,) = places.values()
        assert len(helper) == len(allowed) - 1
    finally:
        os.sched_setaffinity(0, allowed)
        crew.close()
