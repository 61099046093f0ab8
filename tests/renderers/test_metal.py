"""Metals that are nothing but factors take ways of their own: one root for three channels, and no unit normals where
they are as rough as glTF's default. They are held against the scalar formulae, and against all but the same metal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numba import njit

from renderers import simd as vec
from renderers.camera import Camera
from renderers.drawlist import DrawList, Instance, Material, Mesh
from renderers.pointers import address_of, f32_at
from renderers.port import Look, Output
from renderers.shading.transfer import ENCODED, ROOTS, root
from tests.renderers.shading_reference import ball, placed, quad
from tests.renderers.test_shading_scalar import RENDERER, both, view

TABLE = address_of(ENCODED, np.float32)
NEARLY = float(np.nextafter(np.float32(1.0), np.float32(0.0)))


@njit
def _roots(values, out, count):
    low, high = vec.load(f32_at(TABLE), ROOTS), vec.load(f32_at(TABLE), ROOTS + vec.LANES)
    for k in range(0, count, 8):
        vec.store(f32_at(out), k, root(vec.load(f32_at(values), k), low, high))


def roots(values: np.ndarray) -> np.ndarray:
    given, out = values.astype(np.float32), np.empty(len(values), np.float32)
    _roots(given.ctypes.data, out.ctypes.data, len(given))
    return out


def test_roots() -> None:
    c = np.concatenate((np.linspace(0.001, 1, 5000), 2.0 ** np.linspace(-40, 0, 4000)))
    np.testing.assert_allclose(roots(c), c.astype(np.float32).astype(np.float64) ** (1 / 2.2), rtol=1.3e-5)


def test_roots_of_odd_values() -> None:
    least = 2.0 ** (-40 / 2.2)
    odd = np.array((np.nan, 0.0, -1.0, -np.inf, 1e-30, 1.0, 2.0, np.inf))
    np.testing.assert_allclose(roots(odd), [least] * 5 + [1.0] * 3, rtol=1.3e-5)


@pytest.mark.parametrize("roughness", [1.0, 0.97, 0.5, 0.1, 0.0])
@pytest.mark.parametrize("cells", [4, 30, 90])
def test_balls_to_a_level(roughness: float, cells: int) -> None:
    """Of few large triangles, whose normals turn much, and of many."""
    for color in ((0.9, 0.3, 0.0, 1.0), (1.0, 1.0, 1.0, 1.0), (1.7, -0.2, 1e-5, 1.0)):
        gold = Material(color, metallic=1.0, roughness=roughness, double_sided=True)
        drawn = DrawList((placed(ball(cells, 0.9), gold, z=3.0),))
        ours, scalar = both(drawn, view(83, 61), Look("pbr"))
        differences = np.abs(ours - scalar)
        assert differences.max() <= 1
        assert (differences != 0).mean() < 0.02


def pictures(mesh: Mesh, material: Material, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Of a metal, and of one that takes the general way."""
    found = []
    for metallic in (1.0, NEARLY):
        drawn = DrawList((placed(mesh, replace(material, metallic=metallic), z=3.0),))
        with RENDERER.render(drawn, camera, Output.COLOR, Look("pbr")) as frame:
            assert frame.color is not None
            found.append(frame.color.astype(np.int64))
    return found[0], found[1]


@pytest.mark.parametrize("roughness", [1.0, 0.6, 0.05])
@pytest.mark.parametrize("focal", [400.0, 90.0, 25.0])
def test_as_the_general_way(roughness: float, focal: float) -> None:
    """Narrow views and wide ones, where Schlick's term is seen; curved surfaces, and a wall whose normals lean."""
    camera = Camera(160, 120, focal, focal, 80.0, 60.0, 0.05, 50.0, np.eye(4))
    leaning = np.array(((0.5, 0.2, -1.0), (-0.3, 0.4, -1.0), (0.1, -0.9, -0.4), (0.7, 0.7, -0.1)), np.float32)
    leaning /= np.linalg.norm(leaning, axis=1, keepdims=True)
    for mesh in (ball(24, 1.1), quad(4.0, 3.0), replace(quad(4.0, 3.0), normals=leaning)):
        ours, general = pictures(mesh, Material((1.0, 0.6, 0.2, 1.0), roughness=roughness), camera)
        differences = np.abs(ours - general)
        assert differences.max() <= 1
        assert (differences != 0).mean() < 0.02
        assert ours.max() > 0


@pytest.mark.parametrize("focal", [300.0, 80.0])
def test_neighbours(focal: float) -> None:
    """Rows see many metals, one after the other, and other materials and narrow ones between them."""
    rng = np.random.default_rng(3)
    camera = Camera(161, 120, focal, focal, 80.0, 60.0, 0.05, 50.0, np.eye(4))
    instances = []
    for _ in range(40):
        kind = Material((*rng.uniform(0.0, 1.0, 3), 1.0), metallic=float(rng.choice((1.0, 1.0, 1.0, 0.3))))
        X = np.eye(4)
        X[:3, 3] = rng.uniform((-1.5, -1.0, 3.0), (1.5, 1.0, 5.0))
        instances.append(Instance(ball(int(rng.choice((4, 9, 40))), float(rng.choice((0.02, 0.3, 0.6)))), kind, X))
    instances.append(placed(quad(9.0, 9.0), Material((1.0, 0.0, 0.5, 1.0), double_sided=True), z=5.5))
    generally = [replace(each, material=replace(each.material, roughness=NEARLY)) for each in instances]
    found = []
    for drawn in (DrawList(tuple(instances)), DrawList(tuple(generally))):
        with RENDERER.render(drawn, camera, Output.COLOR, Look("pbr")) as frame:
            assert frame.color is not None
            found.append(frame.color.astype(np.int64))
    differences = np.abs(found[0] - found[1])
    assert differences.max() <= 1
    assert (differences != 0).mean() < 0.02
