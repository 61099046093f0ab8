"""Shadow maps against rays towards the light."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from renderers.cpu import CpuRenderer
from renderers.drawlist import AlphaMode, DrawList, Instance, LightKind
from renderers.studio.shadows import casters, light_camera
from tests.renderers.shading_reference import ball, hits
from tests.renderers.studio import reference as ref
from tests.renderers.studio.scenes import DARK, at, drawn, from_above, shadowed

RIG = replace(DARK, shadow_size=1024)


@pytest.fixture(scope="module")
def renderer() -> Iterator[CpuRenderer]:
    renderer = CpuRenderer(2)
    yield renderer
    renderer.close()


def in_the_dark(scene: DrawList, seen: ref.Seen) -> np.ndarray:
    """(H, W): whose ray to the first light meets a surface."""
    camera = from_above()
    points = seen.point[seen.instance >= 0]
    l, _ = ref.arriving(scene.lights[0], camera, points)
    hidden = np.zeros(len(points), np.bool_)
    for instance in scene.instances:
        X = camera.X_camera_world @ instance.X_world_mesh
        p = instance.mesh.positions @ X[:3, :3].T + X[:3, 3]
        for corners in instance.mesh.elements:
            for k in range(len(points)):
                z, _ = hits(l[k : k + 1], p[corners] - points[k])
                reach = np.inf
                hidden[k] |= bool(1e-4 < z[0] < reach)
    result = np.zeros(len(seen.instance), np.bool_)
    result[seen.instance >= 0] = hidden
    return result.reshape(camera.height, camera.width)


@pytest.mark.parametrize("kind", [LightKind.DIRECTIONAL, LightKind.SPOT])
def test_shadows_lie_where_rays_meet_something(renderer: CpuRenderer, kind: LightKind) -> None:
    scene, camera = shadowed(kind), from_above()
    seen = ref.look(scene, camera)
    which = seen.instance.reshape(camera.height, camera.width)
    dark = in_the_dark(scene, seen)
    lit = drawn(renderer, scene, camera, replace(RIG, shadow_size=0)).astype(float)
    color = drawn(renderer, scene, camera, RIG).astype(float)
    # Apart from borders (of shadows, three pixels wide here, and of things) all is light or dark.
    clear = which >= 0
    for axis in (0, 1):
        for shift in (-2, -1, 1, 2):
            clear &= (np.roll(dark, shift, axis) == dark) & (np.roll(which, shift, axis) == which)
    assert (dark & clear).sum() > 150
    assert (~dark & clear).sum() > 1000
    assert (color[dark & clear] == 0).all()
    assert (color[~dark & clear] == lit[~dark & clear]).all()
    # Borders are filtered: some are neither.
    part = color.sum(-1) / np.maximum(lit.sum(-1), 1)
    assert ((part > 0.1) & (part < 0.9) & (which == 0)).sum() > 20


def test_a_curved_surface_does_not_shadow_itself(renderer: CpuRenderer) -> None:
    """Facing the light it stays as bright as without shadows."""
    scene = replace(shadowed(LightKind.DIRECTIONAL), instances=())
    mesh = ball(24, 0.8)
    instances = (Instance(mesh, shadowed(LightKind.DIRECTIONAL).instances[0].material, at(0.0, 0.3, 4.5)),)
    scene = replace(scene, instances=instances)
    camera = from_above()
    lit = drawn(renderer, scene, camera, replace(RIG, shadow_size=0)).astype(float)
    color = drawn(renderer, scene, camera, RIG).astype(float)
    bright = lit[..., 0] > 0.5 * lit.max()
    assert bright.sum() > 150
    assert np.abs(color - lit)[bright].max() <= 1.0


def test_who_casts() -> None:
    scene = shadowed(LightKind.SPOT)
    glass = replace(scene.instances[0], material=replace(scene.instances[0].material, alpha_mode=AlphaMode.BLEND))
    dots = replace(scene.instances[0], mesh=replace(scene.instances[0].mesh, elements=np.zeros((1, 1), np.uint32)))
    assert casters((*scene.instances, glass, dots)).tolist() == [True, True, False, False]


def test_no_map() -> None:
    point = replace(shadowed(LightKind.SPOT).lights[0], kind=LightKind.POINT)
    assert light_camera(point, np.ones((3, 3)), 64) is None
    assert light_camera(shadowed(LightKind.SPOT).lights[0], np.zeros((0, 3)), 64) is None


@pytest.mark.parametrize("kind", [LightKind.DIRECTIONAL, LightKind.SPOT])
def test_the_map_holds_what_is_seen(kind: LightKind) -> None:
    rng = np.random.default_rng(0)
    light = shadowed(kind).lights[0]
    points = rng.uniform((-1, 0, 3), (1, 1, 5), (500, 3))
    camera = light_camera(light, points, 512)
    assert camera is not None
    p = points @ camera.X_camera_world[:3, :3].T + camera.X_camera_world[:3, 3]
    pixels = p[:, :2] / p[:, 2:] * camera.fx + camera.cx
    assert (p[:, 2] > camera.near).all()
    if kind is LightKind.DIRECTIONAL:
        assert pixels.min() >= 0
        assert pixels.max() <= 512
        assert np.ptp(pixels, axis=0).max() > 0.9 * 512
