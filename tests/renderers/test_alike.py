"""Scenes of the same meshes and materials share what was made of the first; others do not."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace

import numpy as np

from renderers.alike import KEPT_PER_MESH, Alike
from renderers.camera import Camera
from renderers.cpu import CpuRenderer
from renderers.cpu.scene import prepare
from renderers.drawlist import DrawList, Instance, Material
from renderers.port import Look, Output
from tests.renderers.shading_reference import ball, quad


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
    assert prepare(scenes[0]).table is prepare(scenes[1]).table
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
