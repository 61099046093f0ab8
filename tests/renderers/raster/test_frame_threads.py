"""Helper threads, array pools, and tables that are collected with their scene."""

import gc
import os
import threading
import weakref
from collections.abc import Callable

import numpy as np
import pytest

from renderers.drawlist import DrawList
from renderers.interface import Output
from renderers.raster import CpuRenderer
from renderers.raster.frame_threads import FrameThreads
from renderers.raster.scene import prepare
from tests.renderers.scenes import camera, draw_list, images, mesh, sphere
from tests.support.waiting import SECONDS


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_every_unit_runs_once_and_before_the_call_returns(threads: int) -> None:
    frame_threads = FrameThreads(threads)
    for _ in range(20):
        for units in (7, 0, 13, 1):
            done: list[int] = []
            frame_threads.run(units, done.append)
            assert sorted(done) == [*range(units)]
    frame_threads.close()


def test_helpers_work_at_the_same_time() -> None:
    frame_threads = FrameThreads(3)
    meeting = threading.Barrier(3)
    frame_threads.run(3, lambda _: meeting.wait(timeout=SECONDS))
    frame_threads.close()


def test_callers_count_as_threads() -> None:
    """With as many callers as threads, no helper runs."""
    frame_threads = FrameThreads(2)
    seen: set[int] = set()
    frame_threads.run(1, lambda _: frame_threads.run(50, lambda _: seen.add(threading.get_ident())))
    assert seen == {threading.get_ident()}
    frame_threads.close()


def test_helpers_run_only_on_idle_processors() -> None:
    spare = 0
    frame_threads = FrameThreads(3, lambda: spare)
    seen: set[int] = set()
    frame_threads.run(50, lambda _: seen.add(threading.get_ident()))
    assert seen == {threading.get_ident()}
    spare = 1
    meeting = threading.Barrier(2)
    frame_threads.run(2, lambda _: meeting.wait(timeout=SECONDS))
    frame_threads.close()


@pytest.mark.parametrize("threads", [1, 3])
def test_an_error_reaches_the_caller_and_skips_the_remaining_units(threads: int) -> None:
    frame_threads = FrameThreads(threads)
    started: list[int] = []

    def fail(unit: int) -> None:
        started.append(unit)
        if unit == 2:
            raise ArithmeticError("unit 2")

    with pytest.raises(ArithmeticError, match="unit 2"):
        frame_threads.run(5000, fail)
    assert {0, 1, 2} <= set(started)
    assert len(started) < 5000
    done: list[int] = []
    frame_threads.run(2, done.append)
    assert sorted(done) == [0, 1]
    frame_threads.close()


def test_an_interrupted_caller_still_completes_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    frame_threads = FrameThreads(3)
    jobs, done = frame_threads._jobs, list[int]()  # noqa: SLF001 - the interrupt is to come between two of its puts
    frame_threads.run(3, lambda _: None)  # starts the helpers

    class Interrupted:
        def put(self, work: Callable[[], object]) -> None:
            jobs.put(work)
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(frame_threads, "_jobs", Interrupted())
        with pytest.raises(KeyboardInterrupt):
            frame_threads.run(50, done.append)
    assert sorted(done) == [*range(50)]
    frame_threads.close()


def test_rejects_zero_threads() -> None:
    with pytest.raises(ValueError, match="threads must be at least 1, got 0"):
        CpuRenderer(threads=0)


def test_outputs_do_not_depend_on_what_the_memory_held() -> None:
    renderer = CpuRenderer(1)
    full = draw_list(mesh(((-9, -9, 2), (9, -9, 2), (0, 9, 2)), ((0, 1, 2),)))
    frame = renderer.render(full, camera(), Output.DEPTH | Output.LABEL | Output.INSTANCE | Output.NORMAL)
    assert frame.depth is not None
    frame = renderer.render(DrawList(), camera(), Output.DEPTH | Output.LABEL | Output.INSTANCE | Output.NORMAL)
    empty = images(frame)
    assert np.isinf(empty["depth"]).all()
    assert (empty["label"] == 0xFFFFFF).all()
    assert (empty["instance"] == -1).all()
    assert (empty["normal"] == 0).all()


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
    a = renderer.render(shared, camera(), outputs)
    b = renderer.render(own, camera(), outputs)
    for name, image in images(a).items():
        np.testing.assert_array_equal(image, images(b)[name], err_msg=name)


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="threads cannot be placed here")
def test_helpers_run_on_another_processor_than_the_caller() -> None:
    allowed = os.sched_getaffinity(0)
    if len(allowed) < 2:
        pytest.skip("there is one processor")
    processor = min(allowed)
    frame_threads, taken = FrameThreads(2), threading.Barrier(2)
    affinities: dict[int, set[int]] = {}

    def note(_: int) -> None:
        affinities[threading.get_ident()] = os.sched_getaffinity(0)
        taken.wait()

    try:
        os.sched_setaffinity(0, {processor})
        frame_threads.run(2, note)
        assert affinities.pop(threading.get_ident()) == {processor}
        os.sched_setaffinity(0, allowed)
        affinities.clear()
        frame_threads.run(2, note)
        assert affinities.pop(threading.get_ident()) == allowed
        (helper,) = affinities.values()
        assert len(helper) == len(allowed) - 1
    finally:
        os.sched_setaffinity(0, allowed)
        frame_threads.close()
