"""Back-face culling of convex meshes: which meshes qualify, and that the image stays the same."""

from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from renderers import primitives
from renderers.camera import Camera
from renderers.drawlist import DrawList, Instance, Material, Mesh
from renderers.interface import Look, LookName, Output
from renderers.light_rig import STUDIO
from renderers.raster import CpuRenderer
from renderers.raster import renderer as renderer_module
from renderers.raster.convex_culling import cullable_mesh
from renderers.raster.frame import FrameJob
from renderers.raster.scene import prepare

ALL = Output.COLOR | Output.DEPTH | Output.LABEL | Output.INSTANCE


def bumpy(columns: int, rows: int, bumps: float, dtype: type = np.float64) -> Mesh:
    """A ball with a seam and poles of several vertices each, up to 1e-16 apart by rounding."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, columns + 1), np.linspace(0, np.pi, rows + 1))
    n = np.stack((np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)), axis=-1)
    n = n * (1 + bumps * np.sin(4 * u) * np.sin(3 * v))[..., None]
    a = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    below = a + columns + 1
    elements = np.concatenate((np.stack((a, below, a + 1), 1), np.stack((a + 1, below, below + 1), 1)))
    return Mesh(n.reshape(-1, 3).astype(np.float32), elements.astype(np.uint32))


def changed(mesh: Mesh, positions: NDArray[Any] | None = None, elements: NDArray[Any] | None = None) -> Mesh:
    p = mesh.positions if positions is None else np.ascontiguousarray(positions, np.float32)
    e = mesh.elements if elements is None else np.ascontiguousarray(elements, np.uint32)
    return Mesh(p, e)


def torus() -> Mesh:
    u, v = np.meshgrid(np.arange(12) * np.pi / 6, np.arange(8) * np.pi / 4, indexing="ij")
    r = 1.0 + 0.3 * np.cos(v)
    points = np.stack((r * np.cos(u), r * np.sin(u), 0.3 * np.sin(v)), axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(12), np.arange(8), indexing="ij")
    a, b = i * 8 + j, (i + 1) % 12 * 8 + j
    c, d = i * 8 + (j + 1) % 8, (i + 1) % 12 * 8 + (j + 1) % 8
    quads = np.concatenate((np.stack((a, b, d), -1).reshape(-1, 3), np.stack((a, d, c), -1).reshape(-1, 3)))
    return Mesh(points.astype(np.float32), quads.astype(np.uint32))


SOLIDS = {
    "box": primitives.box(),
    "sphere": primitives.sphere(),
    "cylinder": primitives.cylinder(),
    "capsule": primitives.capsule(2.0),
    "cone": primitives.cone(),
    "ball with a seam": bumpy(16, 9, 0.0),
    "bumpy ball": bumpy(40, 30, 0.2),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_common_simulator_meshes_are_convex(name: str) -> None:
    mesh = SOLIDS[name]
    known = cullable_mesh(mesh.positions, mesh.elements)
    bounds, positions = known
    low, high = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
    np.testing.assert_allclose(bounds, (*(low + high) / 2, *(high - low) / 2), atol=1e-7)
    assert np.abs(positions - mesh.positions).max() < 1e-12
    flipped = np.ascontiguousarray(mesh.elements[:, ::-1])
    assert cullable_mesh(mesh.positions, flipped) is None
    one = len(mesh.elements) // 2  # not at a pole, where some have no area
    assert cullable_mesh(mesh.positions, np.delete(mesh.elements, one, axis=0)) is None
    assert cullable_mesh(mesh.positions, np.concatenate((mesh.elements, mesh.elements[one : one + 1]))) is None


def test_a_seam_is_closed_where_its_vertices_are_drawn() -> None:
    mesh = SOLIDS["ball with a seam"]
    assert len(np.unique(mesh.positions, axis=0)) > 2 + 16 * 8
    known = cullable_mesh(mesh.positions, mesh.elements)
    assert len(np.unique(known[1], axis=0)) == 2 + 16 * 8


ball = SOLIDS["sphere"]
REFUSED = {
    "a bowl": changed(ball, elements=ball.elements[ball.positions[ball.elements].mean(axis=1)[:, 1] > -0.1]),
    "a ring, which hides its back from nobody": torus(),
    "a vertex moved apart": changed(bumpy(16, 9, 0.0), positions=bumpy(16, 9, 0.0).positions + np.eye(170, 3) * 1e-3),
    "two balls beside one another": changed(
        ball,
        np.concatenate((ball.positions, ball.positions + 3.0)),
        np.concatenate((ball.elements, ball.elements + len(ball.positions))),
    ),
    "not numbers": changed(ball, positions=np.where(np.arange(len(ball.positions))[:, None] == 3, np.nan, 1.0)),
    "infinite": changed(ball, positions=np.where(np.arange(len(ball.positions))[:, None] == 3, np.inf, 1.0)),
    "flat": changed(ball, positions=ball.positions * (1, 1, 0)),
    "no vertices": Mesh(np.empty((0, 3), np.float32), np.empty((0, 3), np.uint32)),
    "no triangles": Mesh(np.ones((3, 3), np.float32), np.empty((0, 3), np.uint32)),
}


@pytest.mark.parametrize("name", REFUSED)
def test_other_meshes_are_not_convex(name: str) -> None:
    mesh = REFUSED[name]
    assert cullable_mesh(mesh.positions, mesh.elements) is None


def drawn_both_ways(
    scene: DrawList, view: Camera, look: Look = Look()
) -> tuple[list[NDArray[Any]], list[NDArray[Any]]]:
    """Colour, depth, label and instance images, with culling and with all back faces drawn."""
    pictures = []
    frame = CpuRenderer(1).render(scene, view, ALL, look)
    pictures.append([a.copy() for a in (frame.color, frame.depth, frame.label, frame.instance) if a is not None])

    def everything(*arguments: Any, opaque: bool, **others: Any) -> FrameJob:
        assert opaque
        return FrameJob(*arguments, **others)

    with patch.object(renderer_module, "FrameJob", everything):
        frame = CpuRenderer(1).render(scene, view, ALL, look)
        pictures.append([a.copy() for a in (frame.color, frame.depth, frame.label, frame.instance) if a is not None])
    return pictures[0], pictures[1]


def some_solids(rng: np.random.Generator, count: int, spread: float) -> DrawList:
    """Solids in random poses and proportions, some mirrored, some intersecting."""
    instances = []
    for k in range(count):
        X = np.eye(4)
        X[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0] @ np.diag(rng.uniform(0.05, 0.8, 3))
        X[:3, 3] = rng.uniform(-spread, spread, 3)
        mesh = list(SOLIDS.values())[rng.integers(len(SOLIDS))]
        instances.append(Instance(mesh, Material((*rng.random(3), 1.0)), X, k, k))
    return DrawList(tuple(instances))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 12))
def test_culling_changes_a_few_silhouette_pixels_only(seed: int, count: int) -> None:
    """At silhouettes, the front face may replace an edge of the back face that snapping moved in front of it."""
    rng = np.random.default_rng(seed)
    scene = some_solids(rng, count, 1.0)
    assert (prepare(scene).instances.structure.instances[:-1]["box_half_extents"] >= 0.0).all()
    X = np.eye(4)
    X[:3, 3] = (*rng.uniform(-0.2, 0.2, 2), -3.0)
    view = Camera(157, 120, 140.0, 150.0, 78.0, 60.0, 0.05, 50.0, X)
    new, old = drawn_both_ways(scene, view)
    other = new[1] != old[1]
    assert np.count_nonzero(other) <= 8
    assert (new[1][other] > old[1][other]).all()
    assert (new[1][other] < old[1][other] * 1.1).all()
    assert (new[0] == old[0]).all()
    for a, b in ((new[2], old[2]), (new[3], old[3])):
        assert (a[~other] == b[~other]).all()


@pytest.mark.parametrize("name", ["gltf", "studio"])
def test_culling_with_several_samples_changes_a_few_silhouette_pixels_only(name: LookName) -> None:
    scene = some_solids(np.random.default_rng(3), 8, 1.0)
    X = np.eye(4)
    X[2, 3] = -3.0
    view = Camera(157, 120, 140.0, 150.0, 78.0, 60.0, 0.05, 50.0, X)
    new, old = drawn_both_ways(scene, view, Look(name, samples=4, rig=replace(STUDIO, shadow_size=0)))
    assert np.count_nonzero((new[0] != old[0]).any(axis=-1)) <= 20


@pytest.mark.parametrize("z", [0.0, 0.4, 0.52])
def test_back_faces_are_drawn_from_inside_and_behind_the_near_plane(z: float) -> None:
    X = np.eye(4)
    X[2, 3] = -z
    scene = DrawList((Instance(primitives.box(), Material(), np.eye(4), 1, 1),))
    view = Camera(64, 48, 40.0, 40.0, 32.0, 24.0, 0.05, 50.0, X)
    new, old = drawn_both_ways(scene, view)
    assert all((a == b).all() for a, b in zip(new, old, strict=True))
    assert (new[2] == 1).all()
