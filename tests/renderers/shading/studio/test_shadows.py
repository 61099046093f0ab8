"""Shadow maps against rays towards the light."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from renderers.camera import Camera
from renderers.drawlist import AlphaMode, DrawList, Image, Instance, LightKind, Sampler, Texture
from renderers.raster import CpuRenderer
from renderers.shading.studio.shadows import casters, light_camera, map_side, shadow_map_of
from renderers.visibility_buffer import Visibility
from tests.renderers.shading.reference import ball, hits
from tests.renderers.shading.studio import reference as ref
from tests.renderers.shading.studio.scenes import DARK, from_above, rendered, sheet, slab_over_floor, translation

RIG = replace(DARK, shadow_size=1024)


def occluded(scene: DrawList, visible: ref.VisibleSurfaces) -> np.ndarray:
    """Return the pixels whose ray to the first light is occluded, (H, W) bool."""
    camera = from_above()
    points = visible.point[visible.instance >= 0]
    l, _ = ref.incident_light(scene.lights[0], camera, points)
    hidden = np.zeros(len(points), np.bool_)
    for instance in scene.instances:
        X = camera.X_camera_world @ instance.X_world_mesh
        p = instance.mesh.positions @ X[:3, :3].T + X[:3, 3]
        for k in range(len(points)):
            z, _ = hits(l[k : k + 1], p[instance.mesh.elements] - points[k])
            hidden[k] |= bool(((z > 1e-4) & (z < np.inf)).any())
    result = np.zeros(len(visible.instance), np.bool_)
    result[visible.instance >= 0] = hidden
    return result.reshape(camera.height, camera.width)


@pytest.mark.parametrize("kind", [LightKind.DIRECTIONAL, LightKind.SPOT])
def test_shadows_match_ray_casting(renderer: CpuRenderer, kind: LightKind) -> None:
    scene, camera = slab_over_floor(kind), from_above()
    visible = ref.cast_rays(scene, camera)
    which = visible.instance.reshape(camera.height, camera.width)
    dark = occluded(scene, visible)
    lit = rendered(renderer, scene, camera, replace(RIG, shadow_size=0)).astype(float)
    color = rendered(renderer, scene, camera, RIG).astype(float)
    # Apart from borders of shadows, three pixels wide here, and of instances, pixels are lit or dark.
    clear = which >= 0
    for axis in (0, 1):
        for shift in (-2, -1, 1, 2):
            clear &= (np.roll(dark, shift, axis) == dark) & (np.roll(which, shift, axis) == which)
    assert (dark & clear).sum() > 150
    assert (~dark & clear).sum() > 1000
    assert (color[dark & clear] == 0).all()
    # At the corners of shadows, borders are a little wider.
    assert (color[~dark & clear] != lit[~dark & clear]).any(-1).sum() <= 2
    assert (color[~dark & clear] >= 0.9 * lit[~dark & clear]).all()
    # Borders are filtered: some pixels are neither.
    lit_share = color.sum(-1) / np.maximum(lit.sum(-1), 1)
    assert ((lit_share > 0.1) & (lit_share < 0.9) & (which == 0)).sum() > 20


def test_a_curved_surface_does_not_shadow_itself(renderer: CpuRenderer) -> None:
    """Where it faces the light, it stays as bright as without shadows."""
    scene = replace(slab_over_floor(LightKind.DIRECTIONAL), instances=())
    mesh = ball(24, 0.8)
    instances = (
        Instance(mesh, slab_over_floor(LightKind.DIRECTIONAL).instances[0].material, translation(0.0, 0.3, 4.5)),
    )
    scene = replace(scene, instances=instances)
    camera = from_above()
    lit = rendered(renderer, scene, camera, replace(RIG, shadow_size=0)).astype(float)
    color = rendered(renderer, scene, camera, RIG).astype(float)
    bright = lit[..., 0] > 0.5 * lit.max()
    assert bright.sum() > 150
    assert np.abs(color - lit)[bright].max() <= 1.0


def test_instances_that_cast_shadows() -> None:
    scene = slab_over_floor(LightKind.SPOT)
    glass = replace(scene.instances[0], material=replace(scene.instances[0].material, alpha_mode=AlphaMode.BLEND))
    dots = replace(scene.instances[0], mesh=replace(scene.instances[0].mesh, elements=np.zeros((1, 1), np.uint32)))
    assert casters((*scene.instances, glass, dots)).tolist() == [True, True, False, False]


def test_without_casters_the_scene_is_rasterized_once(renderer: CpuRenderer, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = slab_over_floor(LightKind.DIRECTIONAL)
    dots = [replace(i, mesh=replace(i.mesh, elements=np.zeros((1, 1), np.uint32))) for i in scene.instances]
    cloud, camera = replace(scene, instances=tuple(dots)), from_above()
    rig = replace(RIG, auto_exposure=False)
    expected = rendered(renderer, cloud, camera, replace(rig, shadow_size=0), samples=4)
    monkeypatch.delattr(CpuRenderer, "visibility")
    np.testing.assert_array_equal(rendered(renderer, cloud, camera, rig, samples=4), expected)


def test_scenes_without_shadow_map() -> None:
    point = replace(slab_over_floor(LightKind.SPOT).lights[0], kind=LightKind.POINT)
    assert light_camera(point, np.ones((3, 3)), 64, 0.0) is None
    assert light_camera(slab_over_floor(LightKind.SPOT).lights[0], np.zeros((0, 3)), 64, 0.0) is None


@pytest.mark.parametrize("kind", [LightKind.DIRECTIONAL, LightKind.SPOT])
def test_light_camera_contains_all_points(kind: LightKind) -> None:
    rng = np.random.default_rng(0)
    light = slab_over_floor(kind).lights[0]
    points = rng.uniform((-1, 0, 3), (1, 1, 5), (500, 3))
    camera = light_camera(light, points, 512, 0.0)
    p = points @ camera.X_camera_world[:3, :3].T + camera.X_camera_world[:3, 3]
    pixels = p[:, :2] / p[:, 2:] * camera.fx + camera.cx
    assert (p[:, 2] > camera.near).all()
    if kind is LightKind.DIRECTIONAL:
        assert pixels.min() >= 0
        assert pixels.max() <= 512
        assert np.ptp(pixels, axis=0).max() > 0.7 * 512  # size and centre change in steps


def test_shadow_map_is_reused_for_small_camera_motion(renderer: CpuRenderer) -> None:
    """The map does not depend on which camera came first."""
    scene = slab_over_floor(LightKind.DIRECTIONAL)
    whole = np.zeros(len(scene.instances), np.bool_)

    def never(view: Visibility, camera: Camera) -> np.ndarray[Any, Any]:
        raise AssertionError

    rng = np.random.default_rng(0)
    points = rng.uniform((-1, 0, 3), (1, 1, 5), (500, 3))
    cameras = [light_camera(scene.lights[0], points + shift, 256, 0.0) for shift in (0.0, 1e-3, 4.0)]
    assert all(camera is not None for camera in cameras)
    here, near, far = (shadow_map_of(renderer, scene, camera, whole, never) for camera in cameras if camera is not None)
    assert here is near
    assert far is not here
    again = replace(scene)  # not cached
    assert np.array_equal(shadow_map_of(renderer, again, here.camera, whole, never).inv_z, here.inv_z)


@pytest.mark.parametrize("kind", [LightKind.DIRECTIONAL, LightKind.SPOT])
def test_cached_shadow_maps_do_not_change_the_image(renderer: CpuRenderer, kind: LightKind) -> None:
    camera = from_above()
    other = replace(camera, X_world_camera=camera.X_world_camera @ translation(0.3, 0.1, -0.5))
    scene = slab_over_floor(kind)
    rendered(renderer, scene, other, RIG)
    assert np.array_equal(rendered(renderer, scene, camera, RIG), rendered(renderer, replace(scene), camera, RIG))


def test_shadow_map_resolution_follows_the_image() -> None:
    assert map_side(2048, 2.0, 0.0) == 2048
    assert map_side(2048, 2.0, 0.001) == 2048
    assert map_side(2048, 2.0, 0.002) == 1024
    assert map_side(2048, 2.0, 1.0) == 512
    assert map_side(64, 2.0, 1.0) == 64
    assert map_side(3000, 2.0, 0.002) == 1500


@pytest.mark.parametrize("kind", [LightKind.DIRECTIONAL, LightKind.SPOT])
@pytest.mark.parametrize("above", [False, True])
def test_alpha_masked_texels_cast_no_shadow(renderer: CpuRenderer, kind: LightKind, above: bool) -> None:
    """A slab with one half masked out casts the shadow of the other half, also below a second slab with the opposite
    half masked out."""
    scene, camera = slab_over_floor(kind), from_above()
    floor, slab = scene.instances

    def half(first: bool, y: float) -> Instance:
        pixels = np.zeros((2, 2, 4), np.uint8)
        pixels[:, 0 if first else 1] = 255
        sampler = Sampler(mag_linear=False, min_linear=False, mipmaps=False)
        texture = Texture(Image(bytes((first, 9)), lambda: pixels), sampler)
        material = replace(slab.material, base_color_texture=texture, alpha_mode=AlphaMode.MASK)
        return replace(slab, material=material, X_world_mesh=translation(0.0, y, 0.0))

    corners = [(-0.7, 0.2, 4.0), (0.0, 0.2, 4.0), (0.0, 0.2, 5.4), (-0.7, 0.2, 5.4)]
    left = replace(slab, mesh=sheet(corners))
    right = replace(slab, mesh=sheet([(x + 0.7, y - 0.01, z) for x, y, z in corners]))
    cut_out = (half(True, 0.0), half(False, -0.01)) if above else (half(True, 0.0),)
    whole = (left, right) if above else (left,)
    images = [
        rendered(renderer, replace(scene, instances=(floor, *parts)), camera, RIG).astype(float)
        for parts in (cut_out, whole, (slab,))
    ]
    # Apart from borders, since cut-out texels do not change where maps lie.
    assert (np.abs(images[0] - images[1]).max(axis=-1) > 100).sum() <= 8
    if not above:
        assert (np.abs(images[0] - images[2]).max(axis=-1) > 100).sum() > 80
