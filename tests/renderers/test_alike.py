"""Scenes of the same meshes and materials share what was made of the first; others do not."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from renderers.alike import KEPT_PER_MESH, Alike

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


def test_only_the_same_meshes_and_materials_are_alike() -> None:
    red, blue = Material((1.0, 0.0, 0.0, 1.0)), Material((0.0, 0.0, 1.0, 1.0))
    kept: Alike[str] = Alike(1000)
    first = instances(red, blue)
    assert kept.get(first) is None
    kept.put(first, "red, blue", 10)
    assert kept.get(moved(first, 1.0)) == "red, blue"
    assert kept.get(tuple(replace(i, material=replace(i.material)) for i in first)) == "red, blue"
    assert kept.get(first[:1]) is None
    assert kept.get(first[::-1]) is None
    assert kept.get((first[0], replace(first[1], material=red))) is None
    assert kept.get((first[0], replace(first[1], mesh=quad()))) is None
    assert kept.get(()) is None
    kept.put((), "nothing", 1)
    assert kept.get(()) is None


def test_few_are_kept_for_a_mesh_and_none_without_it() -> None:
    kept: Alike[int] = Alike(1000)
    colors = [Material((k / 10, 0.0, 0.0, 1.0)) for k in range(KEPT_PER_MESH + 2)]
    mesh = ball(4)
    scenes = [(Instance(mesh, color, np.eye(4)),) for color in colors]
    for k, scene in enumerate(scenes):
        kept.put(scene, k, 10)
    assert [kept.get(scene) for scene in scenes] == [None, None, 2, 3, 4, 5]
    assert kept.nbytes == 10 * KEPT_PER_MESH
    gone = weakref.ref(mesh)
    del mesh, scenes, scene
    gc.collect()
    assert gone() is None
    assert kept.nbytes == 0


def test_a_moved_scene_shares_its_tables_and_is_drawn_where_it_is() -> None:
    given = instances(Material((1.0, 0.5, 0.2, 1.0)))
    renderer = CpuRenderer(1)
    camera = Camera(64, 48, 50.0, 50.0, 32.0, 24.0, 0.1, 10.0, np.eye(4))
    pictures = []
    scenes = [DrawList(moved(given, x)) for x in (-0.5, 0.5)]
    assert prepare(scenes[0]).cast.structure is prepare(scenes[1]).cast.structure
    assert prepare(scenes[0]).X_world_mesh[0, 0, 3] == -0.5
    for scene in scenes:
        with renderer.render(scene, camera, Output.COLOR | Output.LABEL, Look()) as frame:
            assert frame.color is not None
            assert frame.label is not None
            assert set(np.unique(frame.label)) == {1, 0xFFFFFF}
            pictures.append(frame.color.copy())
    assert (pictures[0] != pictures[1]).any()
    fresh = DrawList(tuple(replace(i, mesh=replace(i.mesh)) for i in scenes[1].instances))
    with renderer.render(fresh, camera, Output.COLOR, Look()) as frame:
        assert (frame.color == pictures[1]).all()
    # The shading's tables do not keep a scene's meshes alive.
    gone = weakref.ref(given[0].mesh)
    del given, scenes, scene
    gc.collect()
    assert gone() is None


def as_placed(given: Sequence[Instance]) -> PosedInstances:
    cast = InstanceSet(tuple(i.mesh for i in given), tuple(i.material for i in given), tuple(i.label for i in given))
    return PosedInstances(cast, np.array([i.X_world_mesh for i in given]).reshape(-1, 4, 4))


def test_a_cast_at_places_is_a_sequence_of_instances() -> None:
    given = moved(instances(Material(), Material(metallic=0.5)), 0.25)
    placed = as_placed(given)
    assert len(placed) == 2
    for a, b in zip(placed, given, strict=True):
        assert (a.mesh, a.material, a.label) == (b.mesh, b.material, b.label)
        assert (a.X_world_mesh == b.X_world_mesh).all()
    assert [i.instance_id for i in placed] == [0, 1]
    assert placed[-1].instance_id == 1
    assert [i.instance_id for i in placed[1:]] == [1]
    with pytest.raises(IndexError):
        placed[2]
    with pytest.raises(ValueError, match="2 instances"):
        PosedInstances(placed.set, np.zeros((3, 4, 4)))
    assert DrawList(given).identity is not DrawList(given).identity
    assert DrawList(placed).identity is placed.set


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("look", [Look(), Look("pbr"), Look("pbr", samples=4)])
def test_a_cast_that_moves_is_prepared_once_and_looks_like_any_other_list(look: Look, threads: int) -> None:
    given = instances(Material((1.0, 0.5, 0.2, 1.0)), Material((0.1, 0.5, 0.2, 1.0)))
    placed = as_placed(given)
    renderer, other = CpuRenderer(threads), CpuRenderer(1)
    camera = Camera(64, 48, 50.0, 50.0, 32.0, 24.0, 0.1, 10.0, np.eye(4))
    outputs = Output.COLOR | Output.DEPTH | Output.LABEL | Output.INSTANCE
    prepared = []
    for number in range(6):
        where = np.tile(np.eye(4), (2, 1, 1))
        where[:, :3, 3] = (0.1 * number - 0.3, 0.0, 3.0), (0.0, 0.2 * number - 0.5, 2.5)
        scene = DrawList(PosedInstances(placed.set, where))
        plain = DrawList(tuple(scene.instances))
        prepared.append(prepare(scene).cast)
        for wanted in (Output.COLOR, outputs, Output.DEPTH):
            with renderer.render(scene, camera, wanted, look) as a, other.render(plain, camera, wanted, look) as b:
                for picture in ("color", "depth", "label", "instance"):
                    np.testing.assert_array_equal(getattr(a, picture), getattr(b, picture))
    assert all(each is prepared[0] for each in prepared)
    # What is kept of a cast does not keep it, nor its meshes.
    gone = weakref.ref(given[0].mesh)
    del given, placed, scene, plain
    gc.collect()
    assert gone() is None
    with renderer.render(DrawList(PosedInstances(InstanceSet((), (), ()), np.zeros((0, 4, 4)))), camera, Output.DEPTH) as frame:
        assert frame.depth is not None
        assert np.isinf(frame.depth).all()
