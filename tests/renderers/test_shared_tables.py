"""Draw lists with the same meshes and materials share their tables; others do not."""

import gc
import weakref
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from renderers.camera import Camera
from renderers.drawlist import DrawList, Instance, InstanceSet, Material, PosedInstances
from renderers.interface import Look, Output
from renderers.raster import CpuRenderer
from renderers.raster.scene import prepare
from tests.renderers.shading.reference import ball, quad


def instances(*materials: Material) -> tuple[Instance, ...]:
    mesh = ball(5)
    return tuple(Instance(mesh, material, np.eye(4), k) for k, material in enumerate(materials))


def moved(given: tuple[Instance, ...], x: float) -> tuple[Instance, ...]:
    X = np.eye(4)
    X[:3, 3] = x, 0.0, 3.0
    return tuple(replace(i, X_world_mesh=X, label=i.label + 1) for i in given)


def test_other_materials_get_their_own_tables() -> None:
    red, blue = Material((1.0, 0.0, 0.0, 1.0)), Material((0.0, 0.0, 1.0, 1.0))
    first = instances(red, blue)

    def structure(given: tuple[Instance, ...]) -> object:
        return prepare(DrawList(given)).instances.structure

    shared = structure(first)
    assert structure(moved(first, 1.0)) is shared
    assert structure(tuple(replace(i, material=replace(i.material)) for i in first)) is shared
    assert structure(first[:1]) is not shared
    assert structure((first[0], replace(first[1], mesh=quad()))) is not shared
    assert structure((first[0], replace(first[1], material=replace(red, point_size=3.0)))) is not shared


def test_a_moved_scene_shares_its_tables_and_is_drawn_where_it_is() -> None:
    given = instances(Material((1.0, 0.5, 0.2, 1.0)))
    renderer = CpuRenderer(1)
    camera = Camera(64, 48, 50.0, 50.0, 32.0, 24.0, 0.1, 10.0, np.eye(4))
    images = []
    scenes = [DrawList(moved(given, x)) for x in (-0.5, 0.5)]
    assert prepare(scenes[0]).instances.structure is prepare(scenes[1]).instances.structure
    assert prepare(scenes[0]).X_world_mesh[0, 0, 3] == -0.5
    for scene in scenes:
        frame = renderer.render(scene, camera, Output.COLOR | Output.LABEL, Look())
        assert frame.label is not None
        assert set(np.unique(frame.label)) == {1, 0xFFFFFF}
        images.append(frame.color.copy())
    assert (images[0] != images[1]).any()
    fresh = DrawList(tuple(replace(i, mesh=replace(i.mesh)) for i in scenes[1].instances))
    frame = renderer.render(fresh, camera, Output.COLOR, Look())
    assert frame.color is not None
    assert (frame.color == images[1]).all()
    # The shading's tables do not keep a scene's meshes alive.
    gone = weakref.ref(given[0].mesh)
    del given, scenes, scene
    gc.collect()
    assert gone() is None


def as_posed(given: Sequence[Instance]) -> PosedInstances:
    own = InstanceSet(tuple(i.mesh for i in given), tuple(i.material for i in given), tuple(i.label for i in given))
    return PosedInstances(own, np.array([i.X_world_mesh for i in given]).reshape(-1, 4, 4))


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("look", [Look(), Look("pbr"), Look("pbr", samples=4)])
def test_an_instance_set_is_prepared_once_and_renders_like_a_list(look: Look, threads: int) -> None:
    given = instances(Material((1.0, 0.5, 0.2, 1.0)), Material((0.1, 0.5, 0.2, 1.0)))
    posed = as_posed(given)
    renderer, other = CpuRenderer(threads), CpuRenderer(1)
    camera = Camera(64, 48, 50.0, 50.0, 32.0, 24.0, 0.1, 10.0, np.eye(4))
    outputs = Output.COLOR | Output.DEPTH | Output.LABEL | Output.INSTANCE
    prepared = []
    for number in range(6):
        where = np.tile(np.eye(4), (2, 1, 1))
        where[:, :3, 3] = (0.1 * number - 0.3, 0.0, 3.0), (0.0, 0.2 * number - 0.5, 2.5)
        scene = DrawList(PosedInstances(posed.set, where))
        plain = DrawList(tuple(scene.instances))
        prepared.append(prepare(scene).instances)
        for wanted in (Output.COLOR, outputs, Output.DEPTH):
            a = renderer.render(scene, camera, wanted, look)
            b = other.render(plain, camera, wanted, look)
            for output in ("color", "depth", "label", "instance"):
                np.testing.assert_array_equal(getattr(a, output), getattr(b, output))
    assert all(each is prepared[0] for each in prepared)
    # The tables keep neither the set nor its meshes.
    gone = weakref.ref(given[0].mesh)
    del given, posed, scene, plain
    gc.collect()
    assert gone() is None
    empty = DrawList(PosedInstances(InstanceSet((), (), ()), np.zeros((0, 4, 4))))
    frame = renderer.render(empty, camera, Output.DEPTH)
    assert frame.depth is not None
    assert np.isinf(frame.depth).all()
